"""A new reference in flight, and a stop: nothing steps where one takes over from the other."""

from functools import cache

import numpy as np
import pytest
import shapely
from shapely import box

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.config import MpcConfig, PlannerConfig, RunConfig
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.handover import handover, state_at, stop_reference
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import Ground, ground_of, limits_of, timed_reference
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.world import Obstacle, World
from sandwich_sitl.world_config import WorldConfig

BOUNDS = (0.0, 0.0, 60.0, 40.0)
BODIES = [box(20, 12, 30, 20), box(38, 21, 46, 30)]
ROUTE = np.array([[4.0, 16.0], [19.0, 21.0], [31.0, 21.0], [56.0, 18.0]])
PLANNER = PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6)
CONFIG = RunConfig(
    world=WorldConfig(bounds_m=BOUNDS), start_m=(4, 16), goal_m=(56, 18), altitude_m=5, planner=PLANNER, mpc=MpcConfig()
)
LIMITS = limits_of(PLANNER)
DT_S = 0.02
ALLOWED = np.array([1.02, 1.03, 1.04, 1.06]) * [3.0, 2.0, 10.0, 60.0]


@cache
def flown() -> tuple[Ground, Reference, Corridor]:
    grown = grow(World(BOUNDS, tuple(Obstacle(f"o{k}", body) for k, body in enumerate(BODIES))), 1.0, 0.1)
    ground = ground_of(CONFIG, build_channel_map(grown, 1.0, 5), BODIES)
    reference, corridor, _ = timed_reference(CONFIG, ground, ROUTE)
    return ground, reference, corridor


def rings() -> list[np.ndarray]:
    return [shapely.get_coordinates(shapely.orient_polygons(body).exterior)[:-1] for body in BODIES]


def largest_derivatives(before: Reference, t_s: float, after: Reference) -> np.ndarray:
    """Norms (4,) of differences over what was flown, then the new reference: a step in any would be enormous."""
    k = int(np.searchsorted(before.t_s, t_s - 1e-9))
    np.testing.assert_allclose(after.xyz_m[0], before.xyz_m[k], atol=1e-9)
    whole = np.concatenate([before.xyz_m[: k + 1], after.xyz_m[1:], np.repeat(after.xyz_m[-1:], 4, axis=0)])
    return np.array([np.linalg.norm(np.diff(whole, n=n, axis=0), axis=1).max() / DT_S**n for n in (1, 2, 3, 4)])


TIMES_S = [1.0, 6.0, 10.0, 11.0, 11.6, 13.0, 15.0, 18.0, 22.0, 26.0, 29.0]
GOALS = {"ahead": (55.0, 8.0), "aside": (34.0, 36.0), "behind": (5.0, 34.0)}


@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS)
@pytest.mark.parametrize("t_s", TIMES_S)
def test_handover_steps_in_nothing_and_its_corridor_is_proven(t_s: float, goal: tuple[float, float]) -> None:
    ground, reference, _ = flown()
    here = state_at(reference, t_s).r_m[:2]
    # By way of the free lanes above and below the obstacles.
    lane = [[33.0, 20.5]] if goal[1] > 30 and here[0] > 34 else []
    if goal == GOALS["ahead"] and here[0] < 33:
        lane = [[19.0, 21.1], [31.0, 21.1]] if here[0] < 18 else [[31.0, 21.3]]
    route = np.array([here, *lane, goal])
    if not ground.outlines.keeps(route, 0.3):
        route = np.array([here, [33.0, 20.0], goal])
    if not ground.outlines.keeps(route, 0.3):
        pytest.skip("no simple route from here")
    new, corridor = handover(CONFIG, ground, reference, t_s, route)
    assert (largest_derivatives(reference, t_s, new) <= ALLOWED).all()
    np.testing.assert_allclose(new.xyz_m[-1], [*goal, 5.0], atol=1e-6)
    proof = prove_corridor(new, corridor, rings(), 0.4, CONFIG.mpc.step_s)
    assert proof.proven, proof.problem


def test_handover_to_the_same_route_costs_no_time() -> None:
    ground, reference, _ = flown()
    t_s = 15.0
    here = state_at(reference, t_s).r_m[:2]
    ahead = ROUTE[ROUTE[:, 0] > here[0] + 0.5]
    new, _ = handover(CONFIG, ground, reference, t_s, np.concatenate([here[None], ahead]))
    assert new.t_s[-1] <= (reference.t_s[-1] - t_s) * 1.05


@pytest.mark.parametrize("t_s", TIMES_S)
def test_stop_keeps_limits_stays_on_the_curve_and_in_its_proven_regions(t_s: float) -> None:
    _, reference, corridor = flown()
    stop = stop_reference(reference, t_s, LIMITS)
    assert stop.limits_kept
    assert (largest_derivatives(reference, t_s, stop.reference) <= ALLOWED).all()
    curve = shapely.LineString(reference.xyz_m[:, :2])
    assert shapely.distance(shapely.points(stop.reference.xyz_m[:, :2]), curve).max() < 1e-4
    excess = np.einsum("kfd,kd->kf", corridor.Lambda[stop.reference.region], stop.reference.xyz_m[:, :2])
    assert (excess - corridor.Gamma[stop.reference.region]).max() < 0
    proof = prove_corridor(stop.reference, corridor, rings(), 0.4, CONFIG.mpc.step_s)
    assert proof.proven, proof.problem


@pytest.mark.parametrize("room_s", [0.3, 0.7, 1.0])
def test_stop_before_a_time_rests_before_the_reference_gets_there(room_s: float) -> None:
    _, reference, _ = flown()
    stop = stop_reference(reference, 18.0, LIMITS, before_s=18.0 + room_s)
    there = reference.xyz_m[np.searchsorted(reference.t_s, 18.0 + room_s)]
    here = reference.xyz_m[np.searchsorted(reference.t_s, 18.0 - 1e-9)]
    assert np.hypot(*(stop.reference.xyz_m[-1] - here)[:2]) <= np.hypot(*(there - here)[:2]) + 1e-6
    assert not stop.limits_kept
    late = stop_reference(reference, 18.0, LIMITS, before_s=21.0)
    assert late.limits_kept


def test_state_is_the_references() -> None:
    _, reference, _ = flown()
    k = len(reference.t_s) // 2
    state = state_at(reference, float(reference.t_s[k]))
    xyz = reference.xyz_m
    np.testing.assert_allclose(state.r_m, xyz[k], atol=1e-9)
    np.testing.assert_allclose(state.v_mps, (xyz[k + 1] - xyz[k - 1]) / (2 * DT_S), atol=2e-3)
    np.testing.assert_allclose(state.a_mps2, (xyz[k + 1] - 2 * xyz[k] + xyz[k - 1]) / DT_S**2, atol=1e-2)
    rest = state_at(reference, 1e9)
    np.testing.assert_allclose(rest.r_m, xyz[-1], atol=1e-9)
    assert np.linalg.norm(rest.v_mps) < 1e-3
