"""A small flight plan, a configuration round it, and solvers that fail when they are told to."""

from collections.abc import Callable

import numpy as np

from sandwich_sitl.config import MpcConfig, PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.control.horizon import Horizon, HorizonAnswer, HorizonSolver, HorizonTick
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.solvers.registry import solver_for_flight
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference

RATE_HZ = 50.0
DT = 1.0 / RATE_HZ
MPC = MpcConfig(rate_hz=RATE_HZ, solver="active_set")


def quintic(share: np.ndarray) -> np.ndarray:
    return share**3 * (10 - 15 * share + 6 * share**2)


def boxes(xyz: np.ndarray, region: np.ndarray, half_width_m: float) -> Corridor:
    """Axis-aligned boxes round each region's stretch and its neighbours' first samples."""
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    count, faces = int(region.max()) + 1, np.minimum(np.arange(FACES), 3)
    Lambda, Gamma, rings = np.empty((count, FACES, 2)), np.empty((count, FACES)), []
    for m in range(count):
        at = np.flatnonzero(region == m)
        stretch = xyz[max(0, at[0] - 1) : at[-1] + 2, :2]
        low, high = stretch.min(axis=0) - half_width_m, stretch.max(axis=0) + half_width_m
        Lambda[m] = normals[faces]
        Gamma[m] = np.array([high[0], high[1], -low[0], -low[1]])[faces]
        rings.append(np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]))
    return Corridor(Lambda, Gamma, tuple(rings), np.array(rings))


def flight(duration_s: float = 12.0, half_width_m: float = 0.6) -> tuple[Reference, Corridor]:
    """A gentle curve of 20 m from rest to rest at 10 m, in overlapping boxes along it."""
    t = np.arange(0, duration_s + DT / 2, DT)
    s = quintic(t / duration_s)
    xyz = np.column_stack([20 * s, 2 * np.sin(np.pi * s), np.full_like(s, 10.0)])
    region = np.minimum((s * 10).astype(np.int64), 9)
    return Reference(t, xyz, region), boxes(xyz, region, half_width_m)


def run_config(**changes: object) -> RunConfig:
    return RunConfig(
        world=WorldConfig(bounds_m=(-5, -5, 30, 10)),
        start_m=(0, 0),
        goal_m=(20, 0),
        altitude_m=10,
        planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6),
        **({"mpc": MPC} | changes),  # type: ignore[arg-type]
    )


def mpc_of(config: RunConfig) -> Mpc:
    return Mpc(config.mpc, config.mode, FACES)


class FailingWhen:
    """A solver that gives no answer while `broken(k)` holds for its k-th tick."""

    def __init__(self, solver: HorizonSolver, horizon: Horizon, broken: Callable[[int], bool]) -> None:
        self._solver, self._horizon, self._broken, self._k = solver, horizon, broken, -1

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        self._k += 1
        return self._horizon.failed() if self._broken(self._k) else self._solver.solve(tick)


def failing_when(broken: Callable[[int], bool]) -> Callable[[str, Horizon], HorizonSolver]:
    """What builds such solvers, for the port of `fly`, `Pilot` and `Mpc`."""
    return lambda name, horizon: FailingWhen(solver_for_flight(name, horizon), horizon, broken)
