"""Stacked prediction and the condensed cost (paper, section V-B; its indices mended: the cost pairs x_{k+h} with p_{k+h}, and H's
diagonal blocks are there).

    Y_k = G x_k + H U_k,   Y_k = [x_{k+1} .. x_{k+n}],   U_k = [u_k .. u_{k+n-1}],   H_{i,j} = A_p^{i-j} B_p for j <= i
    J_k = 1/2 U' W1 U + w2' U,   W1 = I + beta H' C' F C H,   w2 = beta (C G x_k - P_k)' F C H

C picks the tracked coordinates of every step: (x, y) as in the paper's C_p, or z.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.model import LinearModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prediction:
    """G (12 n, 12) and H (12 n, 3 n)."""

    G: Array
    H: Array


def stack(model: LinearModel, n_tau: int) -> Prediction:
    """Prediction matrices over `n_tau` steps."""
    powers = [np.eye(12)]
    for _ in range(n_tau):
        powers.append(model.A_p @ powers[-1])
    G = np.concatenate(powers[1:])
    H = np.zeros((12 * n_tau, 3 * n_tau))
    for i in range(n_tau):
        for j in range(i + 1):
            H[12 * i : 12 * i + 12, 3 * j : 3 * j + 3] = powers[i - j] @ model.B_p
    return Prediction(G, H)


def selector(n_tau: int, coordinates: tuple[int, ...]) -> Array:
    """C (len(coordinates) n, 12 n): picks coordinates of the position at every step; (0, 1) is the paper's C_p."""
    pick = np.zeros((len(coordinates), 12))
    pick[np.arange(len(coordinates)), coordinates] = 1.0
    return np.kron(np.eye(n_tau), pick).astype(np.float64)


def cost_matrix(CH: Array, F: Array, beta: float) -> Array:
    """W1 for inputs that move the tracked coordinates by `CH` = C H; F is the diagonal (len(CH),) of weights."""
    return np.asarray(np.eye(CH.shape[1]) + beta * CH.T @ (F[:, None] * CH))


def cost_vector(CH: Array, F: Array, beta: float, deviation: Array) -> Array:
    """w2 for `deviation` = C G x - P (len(CH),): what the tracked coordinates would miss by without inputs."""
    return np.asarray(beta * CH.T @ (F * deviation))
