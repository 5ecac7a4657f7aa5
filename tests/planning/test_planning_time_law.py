"""The time law: its limits by differentiation, its duration against closed forms and an independent optimiser."""

import logging

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, make_interp_spline

from sandwich_sitl.bench.plan_worlds import random_world
from sandwich_sitl.planning.corridor import safe_clearance_m
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.planning.reference import speed_cap
from sandwich_sitl.planning.shortest import shortest_path
from sandwich_sitl.planning.smoothing import smooth_route
from sandwich_sitl.planning.time_law import Limits, TimedCurve, climb, fly, least_duration_s

DT_S = 0.02


def excesses(points: np.ndarray, dt: float, limits: Limits) -> np.ndarray:
    """Largest differences (4,) of samples over speed, acceleration, jerk and snap; at rest before and after."""
    held = np.concatenate([np.repeat(points[:1], 4, axis=0), points, np.repeat(points[-1:], 4, axis=0)])
    bounds = limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3, limits.snap_mps4
    return np.array([
        np.linalg.norm(np.diff(held, n=order, axis=0), axis=1).max() / dt**order / bound
        for order, bound in enumerate(bounds, start=1)
    ])  # fmt: skip


def law(curve: BSpline, limits: Limits, cap: np.ndarray | None = None) -> TimedCurve:
    timed = fly(curve, limits, cap)
    assert timed is not None
    return timed


def random_route(steps: list[tuple[float, float]]) -> np.ndarray:
    return np.concatenate([[(20.0, 50.0)], np.array([20.0, 50.0]) + np.cumsum(steps, axis=0)])


any_limits = st.builds(
    Limits, st.floats(0.5, 8.0), st.floats(0.5, 5.0), st.floats(2.0, 40.0), st.floats(20.0, 400.0)
)  # fmt: skip
any_steps = st.lists(st.tuples(st.floats(2, 12), st.floats(-8, 8)), min_size=2, max_size=8)


@settings(max_examples=30, deadline=None)
@given(steps=any_steps, limits=any_limits)
def test_all_four_limits_hold_by_differentiation(steps: list[tuple[float, float]], limits: Limits) -> None:
    route = random_route(steps)
    curve = smooth_route(
        route, Outlines([], 0.4), (0, 0, 200, 200), 0.3, limits.speed_mps**2 / limits.acceleration_mps2 / 3
    )
    timed = law(curve, limits)
    points = timed.sampled(DT_S)
    np.testing.assert_allclose(points[[0, -1]], route[[0, -1]], atol=1e-6)
    assert (excesses(points, DT_S, limits) <= [1.002, 1.005, 1.01, 1.03]).all()
    assert least_duration_s(curve, limits) <= timed.duration_s * 1.001


@settings(max_examples=20, deadline=None)
@given(steps=any_steps)
def test_motion_is_c3_and_stays_on_the_curve(steps: list[tuple[float, float]]) -> None:
    """Samples twice as dense have half the step in jerk: it is continuous. Each lies on the curve, none goes back."""
    limits = Limits(3.0, 2.0, 10.0, 60.0)
    curve = smooth_route(random_route(steps), Outlines([], 0.4), (0, 0, 200, 200), 0.3, 1.5)
    timed = law(curve, limits)
    t = np.arange(0, timed.duration_s, 0.002)
    r, v, a, j, _ = timed.derivatives(t)
    for upper, lower in ((r, v), (v, a), (a, j)):
        np.testing.assert_allclose(np.diff(upper, axis=0) / 0.002, (lower[1:] + lower[:-1]) / 2, atol=0.1)
    assert np.abs(np.diff(j, axis=0)).max() <= 1.1 * limits.snap_mps4 * 0.002
    assert (np.diff(timed.progress(t)) >= -1e-7).all()


def test_straight_line_takes_the_closed_forms_time() -> None:
    limits = Limits(4.0, 2.0, 10.0, 100.0)
    s = np.linspace(0, 100, 41)
    curve = make_interp_spline(s, np.column_stack([s, 0 * s]), k=5)
    trapezoid = 100 / 4.0 + 4.0 / 2.0
    assert least_duration_s(curve, limits) == pytest.approx(trapezoid, rel=1e-3)
    # Each average adds its length once: acceleration over jerk, jerk over snap.
    assert law(curve, limits).duration_s == pytest.approx(trapezoid + 2 / 10 + 10 / 100, abs=0.1)


def test_cap_on_the_speed_is_kept_where_it_stands() -> None:
    limits = Limits(4.0, 2.0, 10.0, 100.0)
    s = np.linspace(0, 60, 41)
    curve = make_interp_spline(s, np.column_stack([s, 0 * s]), k=5)
    places = np.linspace(0, 60, 601)
    cap = np.where(np.abs(places - 30) < 3, 0.5, 9.0)
    points = law(curve, limits, cap).sampled(DT_S)[:, 0]
    speed = np.diff(points) / DT_S
    middle = (points[1:] + points[:-1]) / 2
    assert speed[np.abs(middle - 30) < 2.9].max() <= 0.51
    assert speed.max() > 3.5


@settings(max_examples=15, deadline=None)
@given(
    speed=st.floats(0.5, 3.0), acceleration=st.floats(-0.8, 0.8), jerk=st.floats(-1.0, 1.0), length=st.floats(25, 60)
)  # fmt: skip
def test_law_from_a_moving_start_begins_with_its_derivatives(
    speed: float, acceleration: float, jerk: float, length: float
) -> None:
    limits = Limits(3.5, 2.0, 10.0, 80.0)
    s = np.linspace(0, length, 41)
    curve = make_interp_spline(s, np.column_stack([s, 0 * s]), k=5)
    timed = fly(curve, limits, None, (speed, acceleration, jerk))
    assume(timed is not None)  # some starts leave the limits whatever follows; a hand-over then stops first
    assert timed is not None
    _, v, a, j, _ = timed.derivatives(np.array([0.0]))
    assert abs(v[0, 0] - speed) < 2e-3
    assert abs(a[0, 0] - acceleration) < 2e-2
    assert abs(j[0, 0] - jerk) < 0.06 * limits.jerk_mps3
    points = timed.sampled(DT_S)
    inner = [np.abs(np.diff(points, n=order, axis=0)).max() / DT_S**order for order in (1, 2, 3, 4)]
    assert (np.array(inner) <= 1.06 * np.array([3.5, 2.0, 10.0, 80.0])).all()
    np.testing.assert_allclose(points[-1], [length, 0.0], atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(height=st.floats(0.5, 60), limits=any_limits)
def test_climb_keeps_its_limits_and_rests_at_both_ends(height: float, limits: Limits) -> None:
    z = climb(height, limits, DT_S)
    assert (z[0], z[-1]) == (pytest.approx(0.0, abs=1e-9), pytest.approx(height))
    assert (np.diff(z) >= -1e-7).all()
    assert (excesses(z[:, None], DT_S, limits) <= [1.002, 1.005, 1.01, 1.03]).all()


def toppra_duration_s(curve: BSpline, limits: Limits) -> float:
    """Time-optimal path parameterisation by reachability analysis (toppra), limits as circumscribed 48-gons."""
    toppra = pytest.importorskip("toppra")
    logging.getLogger("toppra").setLevel(logging.ERROR)
    from toppra import algorithm, constraint

    angle = np.arange(48) * 2 * np.pi / 48
    sides = np.column_stack([np.cos(angle), np.sin(angle)])

    class Acceleration(constraint.LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.dof, self.identical = 2, True

        def compute_constraint_params(self, path, gridpoints):  # type: ignore[no-untyped-def]
            first, second = path(gridpoints, 1), path(gridpoints, 2)
            return first, second, 0 * first, sides, np.full(48, limits.acceleration_mps2), None, None

    class Speed(constraint.LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.dof, self.identical = 2, True

        def compute_constraint_params(self, path, gridpoints):  # type: ignore[no-untyped-def]
            rate = np.hypot(*path(gridpoints, 1).T)
            most = (limits.speed_mps / rate) ** 2
            return None, None, None, None, None, None, np.column_stack([0 * most, most])

    u = np.linspace(0, curve.t[-1], 1200)
    parts = [Speed(), Acceleration()]
    for part in parts:
        part.set_discretization_type(0)
    path = toppra.SplineInterpolator(u, curve(u))
    solver = algorithm.TOPPRA(parts, path, gridpoints=u, solver_wrapper="seidel")
    _, rate, _ = solver.compute_parameterization(0, 0)
    return float(np.sum(2 * np.diff(u) / (rate[1:] + rate[:-1])))


LAWS = [Limits(3, 2, 10, 60), Limits(6, 4, 25, 200), Limits(1.5, 3, 15, 120)]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("limits", LAWS, ids=str)
def test_least_duration_is_an_independent_optimisers(seed: int, limits: Limits) -> None:
    rng = np.random.default_rng(seed)
    route = random_route(list(zip(rng.uniform(3, 15, 6), rng.uniform(-10, 10, 6), strict=True)))
    bending = limits.speed_mps**2 / limits.acceleration_mps2 / 3
    curve = smooth_route(route, Outlines([], 0.4), (0, 0, 200, 200), 0.3, bending)
    least = least_duration_s(curve, limits)
    assert least == pytest.approx(toppra_duration_s(curve, limits), rel=3e-3)


def test_law_takes_at_most_a_tenth_longer_than_the_optimum_without_jerk_and_snap() -> None:
    ratios = []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        route = random_route(list(zip(rng.uniform(3, 20, 7), rng.uniform(-12, 12, 7), strict=True)))
        limits = LAWS[seed % 3]
        bending = limits.speed_mps**2 / limits.acceleration_mps2 / 3
        curve = smooth_route(route, Outlines([], 0.4), (0, 0, 300, 300), 0.3, bending)
        ratios.append(law(curve, limits).duration_s / least_duration_s(curve, limits))
    assert np.mean(ratios) <= 1.10
    assert min(ratios) >= 0.999


@pytest.mark.parametrize("limits", [Limits(6, 4, 20, 120), Limits(10, 6, 30, 180)], ids=str)
def test_fast_flight_round_obstacles_takes_at_most_a_tenth_longer_than_the_optimum(limits: Limits) -> None:
    """Tight routes that touch corners of obstacles grown by the margin, speeds capped by the clearance."""
    margin, interval_s = 0.5, 0.1
    ratios = []
    for seed in range(3):
        world = random_world(seed, 0.3, margin)
        outlines, grown = Outlines(world.bodies, world.radius_m), world.grown
        mesh = build_nav_mesh(grown)
        rng = np.random.default_rng(seed)
        ends = [p for p in rng.uniform((0, 0), (200, 120), (24, 2)) if len(mesh.index.holding(p))]
        for start, goal in zip(ends[::2], ends[1::2], strict=False):
            route = shortest_path(mesh, start, goal)
            if route is None or len(route.points_m) < 3:
                continue
            wished = float(safe_clearance_m(np.array(limits.speed_mps), interval_s))
            bending = limits.speed_mps**2 / limits.acceleration_mps2 / 1.5
            curve = smooth_route(
                route.points_m, outlines, grown.bounds_m, 0.8 * margin, bending, wished_clearance_m=wished
            )
            cap = speed_cap(curve, outlines, limits, interval_s)
            ratios.append(law(curve, limits, cap).duration_s / least_duration_s(curve, limits, cap))
    assert len(ratios) > 8
    assert np.mean(ratios) <= 1.10
    assert min(ratios) >= 0.999
