"""The paper's MPC as two problems of one kind: x and y in their regions, z in its band (paper, section V-B).

The printed equality z = z0 asks for unbounded snap, since the sampled chain has a zero at -9.9; z is a penalty here and
a soft band round the desired height, within the altitudes of the region where it has some (floors). x and y never meet
z, so each problem is solved on its own, by the solver that `mpc.solver` names.

Recursive feasibility. The QP itself always has an answer, because only its input is bounded hard. What is carried
from tick to tick is the stronger statement of `assurance`: the plan in force ends at rest inside proven regions, or
nearer to them than it began when the vehicle has been put outside. A tick either accepts a new plan that has been
checked to do so, or goes on with the old one, which still does: regions do not move, and the rest of a motion that
keeps them keeps them. So the statement holds at every tick once it has held at one, whatever the solver returns; the
first tick starts at rest, where standing still is such a plan. It is a statement about the command and the offset that
was foreseen when the plan was looked at: wind that comes later moves the vehicle beside it until a new plan is accepted.

Places are handed to the solvers relative to the command's own, so that a world's distance from its origin costs no digits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, radians, tan

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import MpcConfig
from sandwich_sitl.control.horizon import FAILED, FREE, SOLVED, Horizon, HorizonSolver, HorizonTick, MotionLimits
from sandwich_sitl.control.solvers.registry import solver_for_flight

Array = NDArray[np.float64]

_Z_WEIGHT = 20.0
_GRAVITY_MPS2 = 9.80665
_UP_DOWN = np.array([1.0, -1.0])
_SERIOUS = (FREE, SOLVED, FAILED)  # from the best status to the worst


@dataclass(frozen=True)
class MpcSolution:
    """Snap (n, 3) over the horizon, predicted states (n, 12), slack per step (n,) in metres, t (n,) by which motion
    limits are passed (share), the worse status and the iterations of both problems. All nan when not `usable`.
    """

    snap: Array
    states: Array
    slack_m: Array
    excess: Array
    status: int
    iterations: int
    usable: bool


def motion_limits(config: MpcConfig) -> MotionLimits:
    """Limits of the plane: the acceleration is also held below what the tilt limit gives in level flight."""
    by_tilt = _GRAVITY_MPS2 * tan(radians(config.tilt_deg))
    return MotionLimits(config.speed_mps, min(config.acceleration_mps2, by_tilt), config.jerk_mps3, config.snap_mps4)


class Mpc:
    """Both problems for a horizon; `faces` half-planes a step. `mode` paper: Euler model and no limits, as printed."""

    def __init__(
        self,
        config: MpcConfig,
        mode: str,
        faces: int,
        make_solver: Callable[[str, Horizon], HorizonSolver] = solver_for_flight,
    ) -> None:
        self.n_tau, self.step_s = config.horizon_steps, config.step_s
        printed = mode == "paper"
        limits = MotionLimits() if printed else motion_limits(config)
        level = (
            MotionLimits()
            if printed
            else MotionLimits(config.climb_mps, config.acceleration_mps2, config.jerk_mps3, config.snap_mps4)
        )
        kind = "euler" if printed else "zoh"
        self._band_m = inf if printed else config.height_band_m
        omega = config.bandwidth_radps
        self.plane = Horizon(self.n_tau, self.step_s, kind, omega, 2, faces, limits)  # type: ignore[arg-type]
        self.height = Horizon(self.n_tau, self.step_s, kind, omega, 1, 2, level, _Z_WEIGHT)  # type: ignore[arg-type]
        self._solvers = (make_solver(config.solver, self.plane), make_solver(config.solver, self.height))
        self._z_normals = np.ascontiguousarray(np.broadcast_to(np.array([[1.0], [-1.0]]), (self.n_tau, 2, 1)))

    def ticks(
        self, x: Array, desired_m: Array, Lambda: Array, Gamma: Array, z_m: Array | None = None
    ) -> tuple[HorizonTick, HorizonTick]:
        """The two problems of state x (12,), desired positions (n, 3), half-planes Lambda (n, F, 2), Gamma (n, F), all
        relative to the position in x.

        Regions that have altitudes bring the lowest and highest, `z_m` (n, 2).
        """
        state, here = x.reshape(4, 3).copy(), x[:3]
        state[0] = 0.0
        desired_m = desired_m - here
        z = desired_m[:, 2:]
        far = self._band_m if np.isfinite(self._band_m) else 1e6
        band = np.concatenate([z + far, far - z], axis=1)
        if z_m is not None:
            band = np.minimum(band, (z_m[:, ::-1] - here[2]) * _UP_DOWN)
        return (
            HorizonTick(state[:, :2], desired_m[:, :2], Lambda, Gamma - Lambda @ here[:2]),
            HorizonTick(state[:, 2:], z, self._z_normals, band),
        )

    def solve(self, x: Array, desired_m: Array, Lambda: Array, Gamma: Array, z_m: Array | None = None) -> MpcSolution:
        """One tick; arguments as of `ticks`."""
        plane, height = (
            solver.solve(tick)
            for solver, tick in zip(self._solvers, self.ticks(x, desired_m, Lambda, Gamma, z_m), strict=True)
        )
        n = self.n_tau
        states = np.concatenate([plane.motion, height.motion], axis=2).transpose(1, 0, 2).reshape(n, 12)
        states[:, :3] += x[:3]
        return MpcSolution(
            np.concatenate([plane.snap, height.snap], axis=1),
            states,
            np.maximum(plane.slack_m, height.slack_m),
            np.maximum(plane.excess, height.excess),
            max(plane.status, height.status, key=_SERIOUS.index),
            plane.iterations + height.iterations,
            FAILED not in (plane.status, height.status) and bool(np.isfinite(states).all()),
        )

    def no_solution(self) -> MpcSolution:
        """What stands in for an answer in a tick that asked for none."""
        n = self.n_tau
        return MpcSolution(
            np.full((n, 3), np.nan), np.full((n, 12), np.nan), np.full(n, np.nan), np.full(n, np.nan), 0, 0, False
        )
