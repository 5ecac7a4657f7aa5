"""`Tracker`: one control tick from reference, corridor and telemetry to a set-point (paper, section V)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import MpcConfig
from sandwich_sitl.control.mpc import Mpc, MpcSolution
from sandwich_sitl.control.observer import Observer
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tick:
    """Result of one tick: the state (12,) to command, the snap (3,) that leads there, and the solver's answer.

    `desired_m` (3,) is the reference and `region` its corridor index at the time of the tick.
    """

    setpoint: Array
    snap: Array
    desired_m: Array
    region: int
    solution: MpcSolution


class Tracker:
    """Tracks a reference from its first sample on; the vehicle is taken to be at rest at `r_m` (3,) then."""

    def __init__(self, config: MpcConfig, mode: str, reference: Reference, corridor: Corridor, r_m: Array) -> None:
        self._reference, self._corridor = reference, corridor
        self._period_s, self._delay_s = 1.0 / config.rate_hz, config.delay_s
        self._mpc = Mpc(
            config.horizon_steps,
            config.step_s,
            "euler" if mode == "paper" else "zoh",
            config.bandwidth_radps,
            FACES,
        )
        self._ahead = np.arange(1, config.horizon_steps + 1, dtype=np.float64) * config.step_s
        self._step_s, self._planned_s = config.step_s, 0.0
        self.observer = Observer(self._period_s, config.observer_radps, r_m)

    @property
    def duration_s(self) -> float:
        """Length of the reference."""
        return float(self._reference.t_s[-1])

    def tick(self, t_s: float, r_m: Array, v_mps: Array, age_s: float) -> Tick:
        """Tick at reference time `t_s` with the measured position and velocity (3,), `age_s` old.

        What is commanded now is flown `delay_s` later: the set-point is the plan's state at `t_s + delay_s`, and the
        observer, one period before it advances, lives at `t_s + delay_s - period`.
        """
        lead_s = self._delay_s - self._period_s
        self.observer.correct(r_m, v_mps, age_s + lead_s)
        desired, region = self._sample(t_s + lead_s + self._ahead)
        solution = self._mpc.solve(
            self.observer.x, desired, self._corridor.Lambda[region], self._corridor.Gamma[region]
        )
        if solution.usable:
            self._planned_s = t_s
        snap = self._planned_snap(solution, t_s - self._planned_s)
        setpoint = self.observer.advance(snap).copy()
        now, now_region = self._sample(np.array([t_s]))
        return Tick(setpoint, snap, now[0], int(now_region[0]), solution)

    def _planned_snap(self, solution: MpcSolution, age_s: float) -> Array:
        """Snap (3,) of a plan that is `age_s` old: an unusable answer leaves the last plan running, then none."""
        step = int(age_s / self._step_s + 1e-9)
        return solution.snap[step] if step < len(solution.snap) else np.zeros(3)

    def _sample(self, t_s: Array) -> tuple[Array, NDArray[np.int64]]:
        """Desired positions (n, 3) and regions (n,) at times (n,), held at the end."""
        at = np.clip(t_s / self._period_s, 0.0, len(self._reference.t_s) - 1)
        below = np.minimum(at.astype(np.int64), len(self._reference.t_s) - 2)
        share = (at - below)[:, None]
        xyz = self._reference.xyz_m
        return (1 - share) * xyz[below] + share * xyz[below + 1], self._reference.region[np.rint(at).astype(np.int64)]
