"""Recursive feasibility by simulation: whatever the corridor and whenever the solver fails, the plan in force ends at
rest inside its regions, and so does the vehicle.
"""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sandwich_sitl.control.assurance import GRID_S, Rung, outside
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.tracker import Tick, Tracker
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference

from .flights import DT, MPC, boxes, failing_when, quintic, run_config

TOLERANCE_M = 0.02 + 0.002  # the configured one, and what lies between two grids
ASIDE_M = 0.06  # the same for the vehicle, whose delay and offset are still being learned


def random_corridor(rng: np.random.Generator) -> tuple[Reference, Corridor]:
    """A smooth path through random way-points, flown from rest to rest at up to about 5 m/s, in boxes of random width."""
    count = rng.integers(4, 7)
    turns = np.cumsum(rng.uniform(-0.8, 0.8, count - 1))
    legs = rng.uniform(1.5, 3.5, count - 1)
    points = np.vstack(
        [np.zeros(2), np.cumsum(legs[:, None] * np.column_stack([np.cos(turns), np.sin(turns)]), axis=0)]
    )
    curve = CubicSpline(np.concatenate([[0.0], np.cumsum(legs)]), points)
    length = legs.sum()
    duration = 1.875 * length / rng.uniform(1.5, 5.0)
    t = np.arange(0.0, max(duration, 2.5), DT)
    xy = curve(length * quintic(t / t[-1]))
    region = np.minimum((length * quintic(t / t[-1]) / rng.uniform(0.5, 2.0)).astype(np.int64), 200)
    _, region = np.unique(region, return_inverse=True)
    xyz = np.column_stack([xy, np.full(len(t), 10.0)])
    return Reference(t, xyz, region.astype(np.int64)), boxes(xyz, region, rng.uniform(0.05, 0.6))


def fly_random(seed: int) -> set[Rung]:
    """One corridor, with a solver that fails in a twentieth of the ticks and, in every third corridor, for good: the
    default one in every other corridor.
    """
    rng = np.random.default_rng(seed)
    reference, corridor = random_corridor(rng)
    config = run_config(mpc=dataclasses.replace(MPC, solver="osqp" if seed % 2 else "active_set"))
    fails = rng.random(4000) < 0.05
    fails[:2] = False  # without a first plan there is no flight
    if seed % 3 == 0:
        fails[rng.integers(20, len(reference.t_s)) :] = True
    mpc = Mpc(config.mpc, config.mode, FACES, failing_when(lambda k: k >= 0 and bool(fails[k])))
    tracker = Tracker(config, mpc, reference, corridor, reference.xyz_m[0])
    state, rungs = np.concatenate([reference.xyz_m[0], np.zeros(9)]), set()
    accepted = None
    for k in range(len(reference.t_s) + 150):
        tick = tracker.tick(k * DT, state[:3], state[3:6], 0.0)
        aside = (corridor.Lambda[tick.region] @ state[:2] - corridor.Gamma[tick.region]).max()
        assert aside <= ASIDE_M, f"seed {seed}, tick {k}: the vehicle is {aside:.3f} m outside"
        state = tick.setpoint
        rungs.add(tick.rung)
        accepted = tick if tick.rung is Rung.PLAN else accepted
        worst = 0.0 if k % 4 else _rest_of_the_plan(tracker, accepted, reference, corridor, k * DT)
        assert worst <= TOLERANCE_M, f"seed {seed}, tick {k}: {worst:.3f} m outside"
    assert np.linalg.norm(state[3:6]) < 0.05
    if seed % 3:
        assert np.linalg.norm(state[:3] - reference.xyz_m[-1]) < 0.05
    return rungs


def _rest_of_the_plan(
    tracker: Tracker, accepted: Tick | None, reference: Reference, corridor: Corridor, t_s: float
) -> float:
    """How far outside what is left of the plan in force comes, and that it ends at rest; by the regions of its own time
    and by what was known of the vehicle when it was accepted.
    """
    stop = tracker._stop
    if accepted is None:
        return 0.0
    times = np.arange(t_s - tracker._stop_began_s, stop.stop_s + GRID_S, GRID_S)
    if len(times) == 0:
        return 0.0
    states = stop.states(times)
    np.testing.assert_allclose(stop.states(np.array([stop.stop_s]))[0, 3:], 0.0, atol=1e-9)
    sigma = tracker._stop_sigma(stop.progress(times)[0] + accepted.delay_s)
    index = np.clip(np.rint(sigma / DT), 0, len(reference.t_s) - 1).astype(np.int64)
    aimed = states[:, :3] + accepted.offset_m
    return outside(aimed, corridor.Lambda, corridor.Gamma, reference.region[index]).max()


def test_forty_random_corridors() -> None:
    rungs = [fly_random(seed) for seed in [*range(40), 126]]  # 126: even the first plan is refused
    assert any(Rung.SHIFTED in seen for seen in rungs)
    assert any(Rung.BRAKE in seen for seen in rungs)
    assert Rung.BRAKE not in set().union(*(seen for seed, seen in enumerate(rungs[:40]) if seed % 3))


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_thousand_random_corridors() -> None:
    for seed in range(40, 1040):
        rungs = fly_random(seed)
        assert seed % 3 == 0 or Rung.BRAKE not in rungs
