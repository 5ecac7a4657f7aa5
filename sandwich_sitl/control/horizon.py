"""The tracking problem of one tick over the horizon, for axes that share regions: (x, y), or z alone.

    minimise    sum_h  u_h^2 / (2 beta) + f |r_h - p_h|^2 / 2  +  rho_1 s_h + rho_2 s_h^2 / 2  +  the same in t_h
    subject to  Lambda_h r_h <= Gamma_h + s_h                                    h = 1 .. n
                |v_h| <= v_max (1 + t_h),  |a_h| <= a_max (1 + t_h),  |j_h| <= j_max (1 + t_h)
                |u_h| <= u_max,  s_h >= 0,  t_h >= 0                              u_0 .. u_{n-1}

r, v, a, j follow the quadruple integrator. The cost is the paper's divided by beta, in metres. Only the input is
bounded hard, so every tick has an answer; the linear terms rho_1 make the penalty exact, so a problem that has a hard
answer keeps it as long as no multiplier sum of a step exceeds rho_1. Norms are replaced by inscribed polygons: eight
sides for v and a, four for j and u, so a plan within them is within the limits.

How far that carries, at bandwidth 8 and limits 12, 3.2, 40, 600: with the desired positions inside their regions, as in
flight, no row is broken in any of 938 random ticks of 20 steps of 0.1 s whose rows can all be kept with a millimetre of
room (and 0.1 % of the limits); with less room, by up to 1.1 mm. At rest in a box of 1 m, asked to a place d outside, the
plan stays in until d = 4 m and leaves by 7, 11, 47, 211, 507 mm at 5, 10, 15, 25, 40 m; with 40 steps of 0.05 s until
1 m, by 1, 11, 48, 188, 483 mm. Where no hard answer exists, the penalties come to at most 0.3 more than their least
(15 mm outside for one step; median 0.01), which the cheaper plan outweighs. The height has weight 20 and penalties that
are as much higher: its plan stays in its band until 5 m outside, with 40 steps until 2 m and then leaves by 1 mm.

The axes couple through the regions alone and have one and the same response, so every matrix here is that of one
axis. With xi = L' u and W1 / beta = L L' the Hessian becomes the identity; the rows are then

    quantity k at step h  =  drift + M[k n + h] xi,   k = r, v, a, j, u,   v .. u as shares of their limit

and all that a dual method needs of the Hessian is the constant table M M'.
"""

from dataclasses import dataclass
from math import cos, inf, isfinite, pi, sqrt
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.model import quadruple_integrator
from sandwich_sitl.control.stacking import cost_matrix, stack

Array = NDArray[np.float64]

REGION_PENALTY = (20.0, 50.0)  # rho_1 in m, rho_2 at weight one: cost of a metre outside, against half a squared metre
MOTION_PENALTY = (20.0, 20.0)  # the same per share of the limit
QUANTITIES = 5  # r, v, a, j, u
INSCRIBED = cos(pi / 8)  # radius of what the eight sides of speed and acceleration leave in every direction
FARTHEST_M = 1e4
SOLVED, FREE, FAILED = 1, 2, -1  # statuses every solver is translated to


@dataclass(frozen=True)
class MotionLimits:
    """Largest speed, acceleration, jerk and snap (norms, SI); inf where there is none."""

    speed_mps: float = inf
    acceleration_mps2: float = inf
    jerk_mps3: float = inf
    snap_mps4: float = inf


@dataclass(frozen=True)
class HorizonTick:
    """What changes from tick to tick: state (4, axes) = r, v, a, j now; desired (n, axes); normals (n, F, axes) of unit
    length and offsets (n, F) of the regions in metres.
    """

    state: Array
    desired: Array
    normals: Array
    offsets: Array


@dataclass(frozen=True)
class HorizonAnswer:
    """Snap (n, axes) and the motion it leads to, (4, n, axes) = r, v, a, j at steps 1 .. n; slack s (n,) in metres and
    t (n,) as share of the limits; status (`SOLVED`, `FREE`: no row binds, `FAILED`).
    """

    snap: Array
    motion: Array
    slack_m: Array
    excess: Array
    status: int
    iterations: int


class HorizonSolver(Protocol):
    """Port of a solver: built once for a `Horizon`, called once a tick, free to start warm from its last answer."""

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """Answer of one tick. A tick without a finite answer has status `FAILED` and must not spoil the next."""
        ...


def polygon_normals(sides: int, axes: int) -> Array:
    """Unit normals (sides, axes) of a regular polygon; +1 and -1 for one axis."""
    if axes == 1:
        return np.array([[1.0], [-1.0]])
    angle = 2 * pi * np.arange(sides) / sides
    return np.column_stack([np.cos(angle), np.sin(angle)])


class Horizon:
    """Constants of the problem: `n_tau` steps of `step_s`, `axes` 1 or 2, at most `faces` half-planes a step.

    `scales` (5,) are what r, v, a, j, u come to where a metre is made good at the bandwidth omega: omega^k, with which
    the costs of r and u weigh the same. `penalties` (2, 2) = rho_1, rho_2 of regions and of motion limits. They grow
    with `weight`, as the multipliers do.
    """

    def __init__(
        self,
        n_tau: int,
        step_s: float,
        discretisation: Literal["euler", "zoh"],
        bandwidth_radps: float,
        axes: int,
        faces: int,
        limits: MotionLimits,
        weight: float = 1.0,
    ) -> None:
        self.n_tau, self.step_s, self.axes, self.faces, self.weight = n_tau, step_s, axes, faces, weight
        self.beta = bandwidth_radps**8
        self.scales = bandwidth_radps ** np.arange(5.0)
        self.penalties = weight * np.array([REGION_PENALTY, MOTION_PENALTY])
        model = quadruple_integrator(step_s, discretisation)
        self.chain, self.drive = model.A_p[::3, ::3], model.B_p[::3, 0]
        self.edges = tuple(polygon_normals(sides, axes) for sides in (8, 8, 4, 4))  # of v, a, j, u
        shrink = (INSCRIBED, INSCRIBED, sqrt(0.5), sqrt(0.5)) if axes == 2 else (1.0, 1.0, 1.0, 1.0)
        given = (limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3, limits.snap_mps4)
        self.bounded = tuple(isfinite(limit) for limit in given)
        self.units = np.array(
            [1.0, *(limit * part if isfinite(limit) else 1.0 for limit, part in zip(given, shrink, strict=True))]
        )
        prediction = stack(model, n_tau)
        G, H = prediction.G[:, ::3], prediction.H[:, ::3]
        response = np.concatenate([*(H[3 * k :: 12] for k in range(4)), np.eye(n_tau)])
        drift = np.concatenate([*(G[3 * k :: 12] for k in range(4)), np.zeros((n_tau, 4))])
        W1 = cost_matrix(response[:n_tau], np.full(n_tau, weight), self.beta)
        self.factor = np.linalg.cholesky(W1 / self.beta)
        self.unit_of_row = unit = np.repeat(self.units, n_tau)[:, None]
        self.M = np.linalg.solve(self.factor, response.T).T / unit
        self.table = np.ascontiguousarray(self.M @ self.M.T)
        to_position = weight * self.table[:, :n_tau]
        self.free_of_state = drift / unit - to_position @ drift[:n_tau]
        self.free_of_desired = np.ascontiguousarray(to_position)

    def free(self, tick: HorizonTick) -> Array:
        """Shares (5 n, axes) of r, v, a, j, u at the optimum without any row, in closed form."""
        return np.asarray(self.free_of_state @ tick.state + self.free_of_desired @ tick.desired)

    def settling(self, period_s: float) -> float:
        """Spectral radius of the motion from one tick to the next, `period_s` later, when each begins with a free plan to
        rest at one place: below 1 the plans settle there, else each is good on its own and together they run away. inf
        when a plan ends before the next tick.
        """
        n, steps = self.n_tau, int(period_s / self.step_s + 1e-9)
        if steps >= n:
            return inf
        planned = (self.free_of_state * self.unit_of_row).reshape(QUANTITIES, n, 4)
        whole = planned[:4, steps - 1] if steps else np.eye(4)
        rest = quadruple_integrator(period_s - steps * self.step_s, "zoh")
        moved = rest.A_p[::3, ::3] @ whole + np.outer(rest.B_p[::3, 0], planned[4, steps])
        return float(np.abs(np.linalg.eigvals(moved)).max())

    def sane(self, tick: HorizonTick, shares: Array) -> bool:
        """Whether a tick's numbers are finite, and the free optimum that `shares` (5 n, axes) belong to is not far away.

        Farther, the solvers' tolerances are below the rounding of the numbers, and nobody flies there in one horizon.
        """
        finite = np.isfinite(shares).all() and np.isfinite(tick.offsets).all() and np.isfinite(tick.normals).all()
        return bool(finite and np.abs(shares[: self.n_tau]).max() < FARTHEST_M)

    def excesses(self, shares: Array, tick: HorizonTick) -> tuple[Array, Array]:
        """How far regions (n,) in metres and motion limits (n,) as a share are passed at each step; 0 where kept."""
        n = self.n_tau
        by_kind = shares.reshape(QUANTITIES, n, self.axes)
        outside = (tick.normals @ by_kind[0][..., None])[..., 0] - tick.offsets
        beyond = [(by_kind[k + 1] @ self.edges[k].T).max(axis=1) - 1.0 for k in range(3) if self.bounded[k]] or [
            np.zeros(n)
        ]
        return np.maximum(outside.max(axis=1), 0.0), np.maximum(np.max(beyond, axis=0), 0.0)

    def answer(self, shares: Array, tick: HorizonTick, status: int, iterations: int) -> HorizonAnswer:
        """The answer that belongs to shares (5 n, axes) of an optimum."""
        return self._answer(shares, *self.excesses(shares, tick), status, iterations)

    def free_answer(self, shares: Array) -> HorizonAnswer:
        """The answer that belongs to shares (5 n, axes) that keep every row."""
        kept = np.zeros(self.n_tau)
        return self._answer(shares, kept, kept, FREE, 0)

    def _answer(self, shares: Array, slack: Array, excess: Array, status: int, iterations: int) -> HorizonAnswer:
        values = (shares * self.unit_of_row).reshape(QUANTITIES, self.n_tau, self.axes)
        return HorizonAnswer(values[4], values[:4], slack, excess, status, iterations)

    def answer_of_snap(self, snap: Array, tick: HorizonTick, status: int, iterations: int) -> HorizonAnswer:
        """The answer of a solver that returns snap (n, axes); motion and slacks are those that the snap leads to."""
        motion = np.empty((4, self.n_tau, self.axes))
        state = tick.state
        for h in range(self.n_tau):
            state = self.chain @ state + self.drive[:, None] * snap[h]
            motion[:, h] = state
        shares = np.concatenate([motion.reshape(4 * self.n_tau, self.axes), snap])
        return self.answer(shares / self.unit_of_row, tick, status, iterations)

    def failed(self, iterations: int = 0) -> HorizonAnswer:
        """The answer of a tick that has none."""
        n, axes = self.n_tau, self.axes
        nan = np.full(n, np.nan)
        return HorizonAnswer(np.full((n, axes), np.nan), np.full((4, n, axes), np.nan), nan, nan, FAILED, iterations)

    def cost(self, snap: Array, tick: HorizonTick) -> float:
        """Value of the objective at snap (n, axes) with the least slacks that it needs."""
        reached = self.answer_of_snap(snap, tick, SOLVED, 0)
        s, t = reached.slack_m, reached.excess
        tracking = self.weight * float(((reached.motion[0] - tick.desired) ** 2).sum()) / 2
        penalty: float = sum(
            rho_1 * float(value.sum()) + rho_2 * float(value @ value) / 2
            for (rho_1, rho_2), value in zip(self.penalties, (s, t), strict=True)
        )
        return float((snap**2).sum()) / (2 * self.beta) + tracking + penalty
