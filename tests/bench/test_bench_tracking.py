"""`bench tracking` on logs made by hand: regions of new plans, altitudes, and flights that fail."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench import tracking
from sandwich_sitl.bench.tracking import Flown, measure
from sandwich_sitl.cli import main
from sandwich_sitl.errors import NoRouteError
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.records import PlanUpdate
from sandwich_sitl.recording.summary import summarise

from ..recording import run_samples

CONFIG = Path(__file__).parents[2] / "configs" / "single.yaml"


@pytest.fixture(scope="module")
def run_log(tmp_path_factory: pytest.TempPathFactory) -> RunLog:
    return RunLog.read(run_samples.write_run(tmp_path_factory.mktemp("run")))


def measured(log: RunLog) -> Flown:
    return measure("by hand", 7, summarise(log), log)


def test_regions_of_a_new_plan_have_numbers_after_those_of_the_first(run_log: RunLog) -> None:
    """From 7 s on the way lies in a fourth region, a box of 1 m about y = 5 m, which the vehicle leaves for a second."""
    plan = run_samples.small_plan()
    first, ring = len(plan.corridor.Gamma), np.array([[0.0, 4.5], [40.0, 4.5], [40.0, 5.5], [0.0, 5.5]])
    fourth = dataclasses.replace(
        plan.corridor, Lambda=plan.corridor.Lambda[:1], Gamma=np.array([[40.0, 0.0, 5.5, -4.5]]), polygons_m=(ring,),
        neighbours_m=ring[None],
    )  # fmt: skip
    update = PlanUpdate(7.0, 6.9, "route", "", np.zeros((2, 2)), plan.reference, first, fourth)
    control = run_log.control
    region = np.where(control.t_s >= 6.999, first, control.region)
    r_m = run_log.truth.r_m.copy()
    r_m[(run_log.truth.t_s > 8.01) & (run_log.truth.t_s < 9.01), 1] = 6.0
    log = dataclasses.replace(
        run_log, updates=(update,), control=dataclasses.replace(control, region=region),
        truth=dataclasses.replace(run_log.truth, r_m=r_m),
    )  # fmt: skip
    flown = measured(log)
    assert flown.off_region == pytest.approx(0.1, abs=0.01)
    assert flown.off_corridor == 0.0  # the box of the old plan is wider


def test_regions_with_altitudes_are_left_upwards_too(run_log: RunLog) -> None:
    truth = run_log.truth
    r_m = truth.r_m.copy()
    r_m[:, 2] = 10.0
    log = dataclasses.replace(
        run_log, plan=run_samples.plan_with_floors(7.0), truth=dataclasses.replace(truth, r_m=r_m)
    )
    assert (measured(log).off_region, measured(log).off_corridor) == (0.0, 0.0)
    r_m[(truth.t_s > 2.99) & (truth.t_s < 4.99), 2] = 11.5
    assert measured(log).off_region == pytest.approx(0.2, abs=0.01)
    assert measured(log).off_corridor == measured(log).off_region


def test_a_flight_that_never_became_active_has_no_errors(run_log: RunLog) -> None:
    mission = dataclasses.replace(run_log.mission, state=("READY",) * len(run_log.mission.state))
    flown = measured(dataclasses.replace(run_log, mission=mission))
    assert np.isnan([flown.rms_m, flown.route_rms_m, flown.off_region, flown.off_corridor]).all()


def test_what_was_flown_before_a_flight_that_fails_is_printed(
    run_log: RunLog, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def fails(*_: object) -> Iterator[Flown]:
        yield measured(run_log)
        raise NoRouteError("no way to the goal")

    monkeypatch.setattr(tracking, "fly_all", fails)
    out = tmp_path / "flights.json"
    assert main(["bench", "tracking", str(CONFIG), "--json", str(out)]) == NoRouteError.exit_status
    said = capsys.readouterr()
    assert "by hand" in said.out
    assert "no way to the goal" in said.err
    assert "by hand" in out.read_text()
