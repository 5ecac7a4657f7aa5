"""The quadruple integrator: position driven by snap (paper, Eq. EXTDYN).

State x = [r, v, a, j] (12,), input u = snap (3,), all ENU SI:  x_{k+1} = A_p x_k + B_p u_k.
"""

from dataclasses import dataclass
from math import factorial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearModel:
    """A_p (12, 12) and B_p (12, 3) for one step of `step_s`."""

    A_p: Array
    B_p: Array
    step_s: float


def quadruple_integrator(step_s: float, discretisation: Literal["euler", "zoh"]) -> LinearModel:
    """`euler`: A_p = I + dT shift, as the paper prints; `zoh`: exact for snap held constant over the step."""
    if discretisation == "euler":
        chain = np.eye(4) + step_s * np.eye(4, k=1)
        drive = np.array([0.0, 0.0, 0.0, step_s])
    else:
        chain = sum((step_s**k / factorial(k) * np.eye(4, k=k) for k in range(4)), np.zeros((4, 4)))
        drive = np.array([step_s ** (4 - row) / factorial(4 - row) for row in range(4)])
    A_p, B_p = np.kron(chain, np.eye(3)), np.kron(drive[:, None], np.eye(3))
    return LinearModel(A_p.astype(np.float64), B_p.astype(np.float64), step_s)
