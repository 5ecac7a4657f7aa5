"""The fallback ladder flown: the offboard loop in this process, the vehicle in its own, a solver that fails on cue."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from sandwich_sitl.config import RunConfig, load_config
from sandwich_sitl.control.horizon import Horizon, HorizonSolver
from sandwich_sitl.launcher import make_plan
from sandwich_sitl.progress import Progress
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.summary import clearance_m, summarise
from sandwich_sitl.run import FlightResult, Observers, fly

from ..control.flights import failing_when
from .conftest import Process, free_port

Start = Callable[..., Process]


class Watch:
    """Notes the mission's states; asks to stop when `stop_at` has come."""

    def __init__(self, stop_at: str | None = None) -> None:
        self.states: list[str] = []
        self._stop_at = stop_at

    def __call__(self, now_s: float, state: str, text: str) -> None:
        del now_s, text
        if not self.states or self.states[-1] != state:
            self.states.append(state)

    def stop_requests(self) -> int:
        return int(self._stop_at in self.states)


def flown(
    start: Start,
    config_path: Path,
    out: Path,
    make_solver: Callable[[str, Horizon], HorizonSolver],
    watch: Watch,
    **mission: float,
) -> tuple[RunLog, FlightResult, RunConfig]:
    port = free_port()
    config = load_config(config_path, {"link.uri": f"udpin://127.0.0.1:{port}"})
    config = dataclasses.replace(config, mission=dataclasses.replace(config.mission, **mission))
    with Progress() as progress:
        plan = make_plan(config, config_path, progress)
    vehicle = start(
        "vehicle_sim", str(config_path), "--connect", f"udpout://127.0.0.1:{port}", "--bind", "127.0.0.1:0",
        "--log", str(out / "vehicle.mcap"),
    )  # fmt: skip
    vehicle.wait_for("ready")
    with RunRecorder(out / "offboard.mcap", flush_s=1.0, metadata={"name": config.name}) as recorder:
        recorder.plan(0.0, plan)
        result = fly(config, plan, Observers(recorder, watch), watch.stop_requests, make_solver)
        recorder.metadata("result", {"outcome": str(result.outcome.outcome), "reason": result.outcome.reason})
    return RunLog.read(out / "offboard.mcap"), result, config


def test_a_solver_that_fails_for_good_ends_held_and_lands_on_request(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    watch = Watch("HOLD")
    log, result, config = flown(start, short_config, tmp_path, failing_when(lambda k: k >= 580), watch)
    assert (result.outcome.outcome, result.outcome.exit_status) == ("held", 6)
    assert watch.states[watch.states.index("ACTIVE") :] == ["ACTIVE", "BRAKE", "HOLD", "LAND", "DONE"]
    rung = log.control.rung
    assert rung.tolist() == sorted(rung.tolist())  # down the ladder only
    assert (rung == 1).sum() > 30
    assert (rung == 2).sum() >= 1
    speed = np.linalg.norm(log.control.setpoint_v_mps, axis=1)
    assert speed[rung == 0][-1] > 2.0
    assert speed[-1] < 1e-6
    lines = [line.message for line in log.lines if "assurance" in line.message]
    assert len(lines) == 2
    assert "slowing down" in lines[0]
    assert "braking" in lines[1]
    summary = summarise(log)
    assert json.dumps(summary)
    assert summary["outcome"] == "held"
    assert summary["assurance"]["fallbacks"] == 1
    assert summary["assurance"]["faults"] == {"the solver gave no answer": int((rung > 0).sum())}
    assert not log.mission.armed[-1]
    clearance = clearance_m(log.control.estimate_r_m[:, :2], log.plan)
    assert clearance is not None
    assert clearance > config.planner.vehicle_radius_m


def test_a_held_vehicle_that_nobody_asks_for_lands_by_itself(start: Start, short_config: Path, tmp_path: Path) -> None:
    watch = Watch()
    log, result, _ = flown(start, short_config, tmp_path, failing_when(lambda k: k >= 450), watch, hold_s=3.0)
    assert result.outcome.outcome == "held"
    states = dict(zip(log.mission.state, log.mission.t_s, strict=True))
    assert states["LAND"] - states["HOLD"] == pytest.approx(3.0, abs=0.1)


def test_a_solver_that_fails_now_and_then_still_brings_the_vehicle_to_the_goal(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    watch = Watch()
    broken = lambda k: k % 50 in (3, 4, 5) or 600 <= k < 660  # noqa: E731
    log, result, config = flown(start, short_config, tmp_path, failing_when(broken), watch)
    assert result.outcome.outcome == "landed"
    summary = summarise(log)
    assert summary["assurance"]["brake"] == 0
    assert summary["assurance"]["fallbacks"] == summary["assurance"]["recoveries"] > 10
    crate = shapely.box(17, 8, 23, 15)
    points = shapely.points(log.control.estimate_r_m[:, :2])
    assert shapely.distance(points, crate).min() > config.planner.vehicle_radius_m


def test_no_plan_from_the_start_is_no_flight(start: Start, short_config: Path, tmp_path: Path) -> None:
    """Every solve fails: the vehicle leaves the ground as asked, then brakes, holds low above the start and lands."""
    watch = Watch("HOLD")
    log, result, _ = flown(start, short_config, tmp_path, failing_when(lambda _: True), watch)
    assert result.outcome.outcome == "held"
    assert np.abs(log.control.estimate_r_m[:, :2] - (5, 11)).max() < 0.5
    assert log.control.estimate_r_m[:, 2].max() < 1.5
