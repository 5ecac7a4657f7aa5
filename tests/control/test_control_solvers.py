"""Every solver behind the port against the exact one, and what the port promises of each."""

from importlib.util import find_spec
from weakref import ref

import numpy as np
import pytest

from sandwich_sitl.config import MpcConfig
from sandwich_sitl.control.horizon import FAILED, FREE, Horizon, HorizonAnswer, HorizonSolver, HorizonTick, MotionLimits
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.solvers import registry
from sandwich_sitl.control.solvers.active_set import ActiveSetSolver
from sandwich_sitl.control.solvers.idle_rows import IdleRowsFirst
from sandwich_sitl.control.solvers.stage_form import StageForm
from sandwich_sitl.errors import InputError

from .problems import FACES, N, horizon, inside_problem, turned_box

TOLERANCE = {"active_set": 1e-7, "osqp": 1e-6, "daqp": 1e-6, "piqp": 1e-4, "clarabel": 1e-4, "hpipm": 1e-4}


def solver_named(name: str, hz: Horizon) -> HorizonSolver:
    """HPIPM is no part of the extra `dev`: its wheel has 93 MB."""
    if name == "hpipm" and find_spec("casadi") is None:
        pytest.skip("needs pip install sandwich-sitl[hpipm]")
    return registry.bare_solver(name, hz)


@pytest.mark.parametrize("name", registry.NAMES)
def test_a_sequence_of_ticks_is_solved_to_the_solver_s_accuracy(name: str) -> None:
    """A reference that slides along a wall: the cost is within the solver's tolerance of the exact one, tick by tick."""
    hz = horizon()
    solver, exact = solver_named(name, hz), ActiveSetSolver(hz)
    tick = inside_problem(7)
    state = tick.state
    for k in range(25):
        moved = HorizonTick(state, tick.desired + 0.02 * k, tick.normals, tick.offsets)
        answer, best = solver.solve(moved), exact.solve(moved)
        cost, least = hz.cost(answer.snap, moved), hz.cost(best.snap, moved)
        assert least <= cost + 1e-6
        assert cost <= least + TOLERANCE[name] * max(1.0, least)
        state = state + 0.2 * (best.motion[:, 0] - state)


@pytest.mark.parametrize("name", registry.NAMES)
def test_a_broken_tick_fails_and_the_next_is_as_good_as_ever(name: str) -> None:
    solver, tick = solver_named(name, horizon()), inside_problem(2)
    for _ in range(3):
        before = solver.solve(tick)
    broken = HorizonTick(np.full((4, 2), np.nan), tick.desired, tick.normals, tick.offsets)
    failed = solver.solve(broken)
    assert failed.status == FAILED
    assert np.isnan(failed.snap).all()
    for _ in range(3):
        after = solver.solve(tick)
    np.testing.assert_allclose(after.motion[0], before.motion[0], atol=10 * TOLERANCE[name])


@pytest.mark.parametrize("name", registry.NAMES)
def test_broken_rows_that_no_input_reaches_cost_no_answer(name: str) -> None:
    """Euler's model moves no position in the first three steps, here outside the box; the later ones come back in."""
    hz, tick = horizon(kind="euler"), inside_problem(4)
    pushed = HorizonTick(tick.state + np.array([[1.6], [0.0], [0.0], [0.0]]), tick.desired, tick.normals, tick.offsets)
    solver = solver_named(name, hz)
    for _ in range(3):
        answer = solver.solve(pushed)
    assert np.isfinite(answer.snap).all()
    least = hz.cost(ActiveSetSolver(hz).solve(pushed).snap, pushed)
    assert hz.cost(answer.snap, pushed) <= least + TOLERANCE[name] * max(1.0, least)


@pytest.mark.parametrize("name", registry.NAMES)
def test_axis_aligned_and_turned_normals_take_turns_on_one_workspace(name: str) -> None:
    """Zero entries of Lambda must not change a sparsity pattern."""
    hz = horizon()
    solver = solver_named(name, hz)
    for seed in range(6):
        tick = inside_problem(seed)
        if seed % 2:
            tick = HorizonTick(tick.state, tick.desired, turned_box(0.0), tick.offsets)
        for _ in range(3):
            answer = solver.solve(tick)
        best = hz.cost(ActiveSetSolver(hz).solve(tick).snap, tick)
        assert hz.cost(answer.snap, tick) <= best + TOLERANCE[name] * max(1.0, best)


class Refusing:
    """Answers nothing, and counts how often it was asked."""

    def __init__(self, hz: Horizon) -> None:
        self.asked, self._hz = 0, hz

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        del tick
        self.asked += 1
        return self._hz.failed()


def test_a_tick_without_active_rows_asks_no_solver() -> None:
    hz = horizon(MotionLimits(8, 8, 80, 900))
    refusing = Refusing(hz)
    first = IdleRowsFirst(hz, refusing)
    calm = inside_problem(1)
    wide = HorizonTick(calm.state, calm.desired * 0.1, calm.normals, calm.offsets + 100.0)
    answer = first.solve(wide)
    assert (answer.status, refusing.asked) == (FREE, 0)
    np.testing.assert_allclose(answer.snap, ActiveSetSolver(hz).solve(wide).snap, atol=1e-9)
    narrow = HorizonTick(calm.state, calm.desired, calm.normals, np.full((N, FACES), 0.01))
    assert first.solve(narrow).status == FAILED
    assert first.solve(HorizonTick(calm.state * np.nan, calm.desired, calm.normals, calm.offsets)).status == FAILED
    assert refusing.asked == 2


def test_a_solver_that_is_not_installed_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry._PLACES, "piqp", ("no_such_module", "Nothing"))
    with pytest.raises(InputError, match=r"sandwich-sitl\[solvers\]"):
        registry.bare_solver("piqp", horizon())


def test_height_stays_in_its_band_and_never_meets_the_plane() -> None:
    """z is a problem of its own: the plane's plan is the same bytes whatever the height does; the band holds."""
    config = MpcConfig(solver="active_set", horizon_steps=N)
    normals, offsets = turned_box(0.3), np.full((N, FACES), 5.0)

    def plan(z: float, vz: float) -> HorizonAnswer:
        mpc = Mpc(config, "timed", FACES)
        x = np.zeros(12)
        x[2], x[5] = z, vz
        return mpc.solve(x, np.tile([1.0, 0.0, 10.0], (N, 1)), normals, offsets)  # type: ignore[return-value]

    low, high = plan(9.5, 2.5), plan(10.0, 0.0)
    np.testing.assert_array_equal(low.snap[:, :2], high.snap[:, :2])  # type: ignore[attr-defined]
    heights = low.states[:, 2]  # type: ignore[attr-defined]
    assert heights.max() <= 10.0 + config.height_band_m + 1e-6
    assert abs(heights[-1] - 10.0) < 0.3


@pytest.mark.parametrize(("low", "high"), [(9.2, 9.85), (10.15, 11.4)])
def test_height_stays_within_the_altitudes_of_its_region(low: float, high: float) -> None:
    """The desired height lies outside: the plan goes as near to it as the region lets it, and no nearer."""
    mpc = Mpc(MpcConfig(solver="active_set", horizon_steps=N), "timed", FACES)
    x = np.zeros(12)
    x[2] = np.clip(10.0, low + 0.1, high - 0.1)
    desired, z_m = np.tile([0.0, 0.0, 10.0], (N, 1)), np.tile([low, high], (N, 1))
    heights = mpc.solve(x, desired, turned_box(0.0), np.full((N, FACES), 5.0), z_m).states[:, 2]
    assert low - 1e-6 <= heights.min() <= heights.max() <= high + 1e-6
    assert heights[-1] == pytest.approx(np.clip(10.0, low, high), abs=0.02)


@pytest.mark.parametrize("away_m", [0.0, 5.4e6])
def test_a_world_far_from_its_origin_is_flown_as_one_at_home(away_m: float) -> None:
    """UTM northings reach ten million metres; the plan moves along and loses no digits but those of its own numbers."""
    tick = inside_problem(3)
    away = np.array([away_m / 10, away_m, 0.0])
    mpc = Mpc(MpcConfig(horizon_steps=N, solver="active_set"), "timed", FACES)
    x = np.concatenate([tick.state, np.zeros((4, 1))], axis=1).ravel()
    desired = np.concatenate([tick.desired, np.zeros((N, 1))], axis=1)
    moved = x.copy()
    moved[:3] += away
    home = mpc.solve(x, desired, tick.normals, tick.offsets)
    there = mpc.solve(moved, desired + away, tick.normals, tick.offsets + tick.normals @ away[:2])
    assert there.usable
    np.testing.assert_allclose(there.states[:, :3] - away, home.states[:, :3], atol=1e-6)
    np.testing.assert_allclose(there.snap, home.snap, atol=1e-3 * np.abs(home.snap).max())


def test_paper_mode_is_the_euler_chain_without_limits() -> None:
    mpc = Mpc(MpcConfig(solver="active_set", horizon_steps=N), "paper", FACES)
    x = np.zeros(12)
    x[3] = 30.0
    states = mpc.solve(x, np.zeros((N, 3)), turned_box(0.0), np.full((N, FACES), 1e3)).states
    np.testing.assert_allclose(states[:3, 0], [3.0, 6.0, 9.0], atol=1e-9)


@pytest.mark.parametrize("omega", [3.0, 8.0])
def test_scaled_unknowns_cost_the_same_at_any_bandwidth(omega: float) -> None:
    """A metre of error and the snap that makes it good: the solvers on the stages see curvature one for both."""
    form = StageForm(Horizon(N, 0.1, "zoh", omega, 2, FACES, MotionLimits(8, 8, 80, 900)), scaled=True)
    np.testing.assert_allclose(form.P.diagonal().reshape(N, form.width)[:, :4], 1.0, rtol=1e-12)


def test_hpipm_reads_no_memory_that_was_given_back() -> None:
    """Transposed constants are temporaries: what writes them keeps them until it is called, however late."""
    if find_spec("casadi") is None:
        pytest.skip("needs pip install sandwich-sitl[hpipm]")
    from sandwich_sitl.control.solvers.hpipm_stages import _OcpQp

    problem = _OcpQp({"nx": [2, 2], "nu": [1, 0]}, 1e-6)
    temporary = np.full((2, 2), 7.0)
    watched = ref(temporary)
    write = problem.setter("Q", 0, temporary)
    del temporary
    assert watched() is not None
    write()
    del write
    assert watched() is None


def test_the_port_is_what_the_solvers_are() -> None:
    solver: HorizonSolver = Refusing(horizon())
    assert solver.solve(inside_problem(0)).iterations == 0
