"""The recorded ticks and what the bench says of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench import mpc, ticks
from sandwich_sitl.bench.mpc import Case, installed, references, run_case, table
from sandwich_sitl.cli import main
from sandwich_sitl.control.horizon import FAILED, FREE, Horizon, MotionLimits
from sandwich_sitl.control.solvers.registry import bare_solver

LIMITS = MotionLimits(12.0, 3.2, 40.0, 600.0)
SEQUENCES = ticks.stored()


def case_of(sequence: ticks.TickSequence, count: int, n_tau: int = 20) -> Case:
    import dataclasses

    part = dataclasses.replace(
        sequence,
        command=sequence.command[:count],
        sigma_s=sequence.sigma_s[:count],
        offset_m=sequence.offset_m[:count],
    )
    return Case(part, n_tau, {20: 0.1, 40: 0.05}[n_tau], 8.0, LIMITS)


@pytest.mark.parametrize("sequence", SEQUENCES, ids=lambda s: s.name)
def test_recorded_commands_are_near_their_reference_and_follow_each_other(sequence: ticks.TickSequence) -> None:
    problems = list(sequence.problems(20, 0.1))
    assert len(problems) == len(sequence.sigma_s) == 400
    for tick in problems[::40]:
        assert np.isfinite(tick.state).all()
        np.testing.assert_allclose(np.linalg.norm(tick.normals, axis=2), 1.0, atol=1e-9)
    steps = np.diff(sequence.command[:, :3], axis=0) - 0.02 * sequence.command[:-1, 3:6]
    assert np.abs(steps[:, :2]).max() < 2e-3


def test_a_narrow_sequence_binds_and_a_pushed_out_one_cannot_be_mended() -> None:
    horizon = Horizon(20, 0.1, "zoh", 8.0, 2, 8, LIMITS)
    tight = ticks.narrow(SEQUENCES[1])
    first = case_of(tight, 80)
    answers = references(horizon, first.sequence.problems(20, 0.1))
    assert sum(answer.status != FREE for answer in answers) > 40
    out = references(horizon, case_of(ticks.pushed_out(tight), 8).sequence.problems(20, 0.1))
    assert out[0].slack_m.max() > 0.5
    hostile = references(horizon, case_of(ticks.hostile(tight), 10).sequence.problems(20, 0.1))
    assert [k for k, answer in enumerate(hostile) if answer.status == FAILED and k % 5 == 4] == [4, 9]


@pytest.mark.parametrize("n_tau", [20, 40])
def test_the_default_solver_s_first_command_is_within_a_percent_of_the_optimum(n_tau: int) -> None:
    """Against the better of `active_set` and Clarabel at 1e-11, in the ticks of which most have rows that bind."""
    (own,) = run_case(case_of(ticks.narrow(SEQUENCES[1]), 80, n_tau), ("osqp",), lambda _: None)
    assert own.failed == 0
    assert own.iterations > 1
    assert own.du0_p99 < 0.01
    assert own.outside_m < 1e-6


def test_awkward_rows_and_states_are_solved_as_well_as_any() -> None:
    """Every kind of region is met; the cost is within the solver's tolerance of the least that any finds."""
    case = case_of(ticks.awkward(ticks.narrow(SEQUENCES[1]), LIMITS.acceleration_mps2), 160)
    horizon = Horizon(20, 0.1, "zoh", 8.0, 2, 8, LIMITS)
    problems = list(case.sequence.problems(20, 0.1))[::2]
    assert max(tick.offsets.max() for tick in problems) == pytest.approx(1e6, rel=1e-3)
    bests = references(horizon, problems)
    assert sum(best.status != FREE for best in bests) > 50
    for name, tolerance in (("active_set", 1e-7), ("osqp", 1e-4), ("piqp", 1e-4), ("daqp", 1e-4), ("clarabel", 1e-3)):
        solver = bare_solver(name, horizon)
        for tick, best in zip(problems, bests, strict=True):
            answer, least = solver.solve(tick), horizon.cost(best.snap, tick)
            assert answer.status != FAILED
            assert horizon.cost(answer.snap, tick) <= least + tolerance * max(1.0, least)


def test_the_own_solver_is_exact_and_every_installed_one_stands_in_the_table() -> None:
    scores = {s.solver: s for s in run_case(case_of(ticks.narrow(SEQUENCES[1]), 150), installed(), lambda _: None)}
    own = scores["active_set"]
    assert own.failed == 0
    assert own.du0_p99 < 0.01
    assert own.outside_m < 1e-6
    text = table(list(scores.values()), "piqp")
    assert all(name in text for name in scores)
    assert "1.00 / 1.00" in text


def test_a_sequence_survives_its_file(tmp_path: Path) -> None:
    before = SEQUENCES[0]
    ticks.save(before, tmp_path / "calm.npz")
    after = ticks.load(tmp_path / "calm.npz")
    np.testing.assert_allclose(after.command, before.command, rtol=1e-6)
    np.testing.assert_array_equal(after.region, before.region)


def test_the_command_line_takes_names_and_says_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ticks, "stored", lambda: tuple(case_of(s, 12).sequence for s in SEQUENCES))
    out = tmp_path / "scores.json"
    assert main(["bench", "mpc", "--solvers", "active_set", "--horizons", "20", "--json", str(out)]) == 0
    assert capsys.readouterr().out.count("active_set") == 7
    assert len(json.loads(out.read_text())) == 7
    assert main(["bench", "mpc", "--solvers", "magic"]) == 2
    assert "magic" in capsys.readouterr().err
    assert main(["bench", "mpc", "--horizons", "7"]) == 2


@pytest.mark.parametrize(("there", "said"), [(("active_set",), 1), (("active_set", "clarabel"), 0)])
def test_errors_against_the_own_solver_alone_are_announced(
    there: tuple[str, ...], said: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ticks, "stored", lambda: tuple(case_of(s, 4).sequence for s in SEQUENCES))
    monkeypatch.setattr(mpc, "installed", lambda: there)
    assert main(["bench", "mpc", "--solvers", "active_set", "--horizons", "20"]) == 0
    assert capsys.readouterr().err.count("without clarabel") == said
