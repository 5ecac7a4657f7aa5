"""Every number of the summary against what the sample run was made to be, worked out by hand."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import run_samples

from sandwich_sitl.planning.flight_plan import FlightFigures
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.summary import clearance_m, format_summary, lost_frames, summarise, tracking_error
from sandwich_sitl.recording.tracks import Frame, LogLine, MissionTrack, PoseTrack


def test_keys_are_complete_and_json(run_log: RunLog) -> None:
    summary = json.loads(json.dumps(summarise(run_log)))
    assert {"outcome", "seed", "clock", "map", "route", "flight", "mpc", "link"} <= set(summary)
    assert set(summary["map"]) == {
        "channels", "nodes", "bays", "flow", "folded_cells", "repaired_cells", "min_jacobian_ratio", "coverage",
        "check", "seconds",
    }  # fmt: skip
    assert set(summary["route"]) == {
        "sandwich_m", "grid_astar_m", "exact_m", "reduction_percent", "tight_m", "duration_ratio",
    }  # fmt: skip
    assert set(summary["flight"]) == {
        "duration_s", "path_flown_m", "rms_error_m", "max_error_m", "min_clearance_m", "quadrangle_violations",
        "wall_seconds", "realtime_factor",
    }  # fmt: skip
    assert set(summary["mpc"]) == {"ticks", "solve_ms", "loop_ms", "infeasible", "deadline_misses", "max_slack_m"}
    assert set(summary["mpc"]["solve_ms"]) == {"p50", "p99", "max"}
    assert set(summary["link"]) == {"sent", "received", "lost", "refused"}


def test_head_map_and_route(run_log: RunLog) -> None:
    summary = summarise(run_log)
    assert (summary["outcome"], summary["seed"], summary["clock"]) == ("landed", 7, "lockstep")
    assert summary["map"] == {
        "channels": 2, "nodes": 2 * 41 * 7, "folded_cells": 0, "repaired_cells": 0, "min_jacobian_ratio": 0.71,
        "coverage": 0.98, "seconds": 0.5, "bays": 0, "flow": "x", "check": "passed",
    }  # fmt: skip
    grid_m = 30.0 + 2.0 * 3.0 * math.sqrt(2.0)
    lengths = {"sandwich_m": 36.0, "grid_astar_m": grid_m, "exact_m": 36.0}
    assert summary["route"] == pytest.approx(
        {**lengths, "reduction_percent": 100 * (1 - 36.0 / grid_m), "tight_m": None, "duration_ratio": None}
    )


def test_tight_route_and_its_duration_over_the_time_optimal_laws(tmp_path: Path) -> None:
    tight_m = np.array([[2.0, 5.0], [20.0, 5.0], [38.0, 5.0]])
    plan = dataclasses.replace(
        run_samples.small_plan(), route_kind="tight", tight_m=tight_m, flight=FlightFigures(36.0, 36.1, 13.2, 12.0)
    )
    summary = summarise(RunLog.read(run_samples.write_offboard(tmp_path / "offboard.mcap", plan)))
    assert summary["route"]["tight_m"] == pytest.approx(36.0)
    assert summary["route"]["duration_ratio"] == pytest.approx(1.1)
    assert "tight_m 36.000, duration_ratio 1.100" in format_summary(summary)


def test_flight(run_log: RunLog) -> None:
    flight = summarise(run_log)["flight"]
    assert flight["duration_s"] == pytest.approx(13.0)
    assert flight["path_flown_m"] == pytest.approx(30.0)
    assert flight["rms_error_m"] == pytest.approx(run_samples.OFFSET_M)
    assert flight["max_error_m"] == pytest.approx(run_samples.OFFSET_M)
    assert flight["min_clearance_m"] == pytest.approx(11.0 - 5.2)
    assert flight["quadrangle_violations"] == 0
    assert flight["wall_seconds"] == 3.0
    assert flight["realtime_factor"] == pytest.approx(15.0 / 3.0)


def test_mpc_and_link(run_log: RunLog) -> None:
    summary = summarise(run_log)
    mpc = summary["mpc"]
    assert (mpc["ticks"], mpc["infeasible"], mpc["deadline_misses"]) == (100, 0, 1)
    assert mpc["solve_ms"] == pytest.approx({"p50": 76.0, "p99": 149.5, "max": 151.0})
    assert mpc["loop_ms"] == pytest.approx({"p50": 152.0, "p99": 299.0, "max": 302.0})
    assert mpc["max_slack_m"] == pytest.approx(0.119)
    assert summary["link"] == {"sent": 151, "received": 151, "lost": 3, "refused": None}


def test_set_points_that_the_fence_refused_are_shown_where_the_log_counts_them(run_log: RunLog) -> None:
    result = {**run_log.metadata["result"], "refused": "4"}
    summary = summarise(dataclasses.replace(run_log, metadata={**run_log.metadata, "result": result}))
    assert summary["link"]["refused"] == 4
    assert "lost 3, refused 4" in format_summary(summary)


def test_a_sine_error_has_its_rms_and_peak(run_log: RunLog) -> None:
    t_s = np.linspace(2.0, 11.9, 1981)
    wave = 0.3 * np.sin(2 * np.pi * 2 * (t_s - 2.0) / 9.9)
    xyz = np.column_stack([2.0 + 3.0 * (t_s - 2.0), 5.0 + wave, np.full_like(t_s, 10.0)])
    log = dataclasses.replace(run_log, truth=PoseTrack(t_s, xyz, np.zeros((len(t_s), 4))))
    _, error = tracking_error(log)
    assert float(np.sqrt(np.mean(error**2))) == pytest.approx(0.3 / math.sqrt(2), rel=1e-3)
    assert error.max() == pytest.approx(0.3, rel=1e-5)


def test_samples_outside_their_region_are_counted(run_log: RunLog) -> None:
    """The truth leaves the box (y <= 6.5 m) for the control ticks at 3.0 s ... 3.9 s."""
    truth = run_log.truth
    r_m = truth.r_m.copy()
    outside = (truth.t_s > 2.949) & (truth.t_s < 3.951)
    r_m[outside, 1] = 7.0
    log = dataclasses.replace(run_log, truth=PoseTrack(truth.t_s, r_m, truth.q_wxyz))
    assert summarise(log)["flight"]["quadrangle_violations"] == 10


def test_clearance_is_measured_between_the_samples() -> None:
    plan = run_samples.small_plan()
    corner_to_corner = np.array([[15.0, 11.0], [15.0, 19.0]])
    assert clearance_m(corner_to_corner, plan) == 0.0
    assert clearance_m(np.array([[10.0, 0.0], [10.0, 30.0]]), plan) == pytest.approx(5.0)
    assert clearance_m(np.array([[20.0, 15.0]]), plan) == 0.0
    assert clearance_m(np.empty((0, 2)), plan) is None
    assert clearance_m(corner_to_corner, run_samples.small_plan(obstacles=False)) is None


def test_what_is_flown_over_counts_by_the_air_between() -> None:
    """The same path in plan, 3 m above an obstacle of 7 m: with one floor it is touched, with floors it is not."""
    over = np.array([[15.0, 11.0, 10.0], [15.0, 19.0, 10.0]])
    high = run_samples.plan_with_floors(7.0)
    assert clearance_m(over, dataclasses.replace(high, floors=None)) == 0.0
    assert clearance_m(over, high) == pytest.approx(3.0)
    assert clearance_m(over, run_samples.plan_with_floors(np.nan)) == 0.0


def test_samples_above_or_below_their_region_are_counted(run_log: RunLog) -> None:
    truth = run_log.truth
    r_m = truth.r_m.copy()
    r_m[:, 2] = 10.0
    r_m[(truth.t_s > 2.949) & (truth.t_s < 3.951), 2] = 11.5
    r_m[(truth.t_s > 4.949) & (truth.t_s < 5.451), 2] = 8.5
    high = run_samples.plan_with_floors(7.0)
    log = dataclasses.replace(run_log, plan=high, truth=PoseTrack(truth.t_s, r_m, truth.q_wxyz))
    summary = summarise(log)
    assert summary["flight"]["quadrangle_violations"] == 15
    assert summary["floors"] == {
        "altitude_m": 10.0, "length_m": 36.0, "climbed_m": 5.0, "descended_m": 5.0, "changes": 2, "least_headroom_m": None
    }  # fmt: skip
    assert "floors   altitude_m 10.000" in format_summary(summary)
    assert "floors" not in format_summary(summarise(run_log))


def test_lost_frames_are_gaps_and_nothing_else() -> None:
    def frames(*sequences: int, system: int = 1) -> tuple[Frame, ...]:
        return tuple(Frame(0, "/mavlink/rx", run_samples.mavlink2_frame(s, system)) for s in sequences)

    assert lost_frames(frames(254, 255, 0, 1)) == 0
    assert lost_frames(frames(254, 1)) == 2
    assert lost_frames(frames(1, 1, 2)) == 0
    assert lost_frames(frames(5, 4, 6)) == 0
    assert lost_frames(frames(1, 2, 5) + frames(9, 10, system=2)) == 2
    assert lost_frames((Frame(0, "/mavlink/rx", bytes([0xFE, 0, 9, 1, 1, 0, 0, 0])),)) == 0


def test_an_unfinished_log_gives_what_it_has(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = run_samples.write_vehicle(tmp_path_factory.mktemp("v") / "vehicle.mcap")
    summary = summarise(RunLog.read(path))
    assert summary["outcome"] == "unfinished"
    assert summary["flight"]["rms_error_m"] is None
    assert summary["route"]["sandwich_m"] is None
    assert "unfinished" in format_summary(summary)


def test_the_terminal_text_names_every_section(run_log: RunLog) -> None:
    text = format_summary(summarise(run_log))
    assert [line.split()[0] for line in text.splitlines()] == [
        "outcome",
        "run",
        "map",
        "route",
        "flight",
        "mpc",
        "assurance",
        "detours",
        "link",
    ]
    assert "rms_error_m 0.200" in text


def test_the_ladder_is_counted_from_the_log(run_log: RunLog) -> None:
    """Ticks on each rung, falls, climbs and faults are those of the track."""
    rung = np.array([0, 0, 1, 1, 0, 1, 2, 2])
    fault = ("", "", "a", "b", "", "a", "a", "a")
    control = dataclasses.replace(run_log.control, rung=rung, fault=fault)
    section = summarise(
        dataclasses.replace(run_log, control=dataclasses.replace(run_log.control, rung=rung[:0], fault=()))
    )
    assert section["assurance"]["fallbacks"] == 0
    section = summarise(dataclasses.replace(run_log, control=control))
    assert section["assurance"] == {
        "plan": 3, "shifted": 3, "brake": 2, "hold": 0, "fallbacks": 2, "recoveries": 1, "faults": {"a": 4, "b": 1},
        "braked_for": None,
    }  # fmt: skip


def braked(log: RunLog, reason: str = "stopped on request") -> RunLog:
    """The mission brakes from 8 s on and holds from 9.5 s to 12 s; the controller's track ends there."""
    control = log.control
    mission = MissionTrack(
        t_s=np.array([0.0, 1.0, 2.0, 8.0, 9.5, 12.0, 14.0]),
        state=("CONNECT", "REQUEST", "ACTIVE", "BRAKE", "HOLD", "LAND", "DONE"),
        autopilot_mode=("OFFBOARD",) * 7, armed=np.array([0, 1, 1, 1, 1, 1, 0], dtype=bool),
        landed=np.zeros(7, dtype=bool), reason=("",) * 6 + (reason,),
    )  # fmt: skip
    before = control.t_s < 7.99
    columns = {f.name: getattr(control, f.name) for f in dataclasses.fields(control)}
    cut = {k: v[before] if isinstance(v, np.ndarray) else v[: before.sum()] for k, v in columns.items()}
    cut["estimate_r_m"] = cut["reference_m"] + 0.1
    return dataclasses.replace(
        log, mission=mission, control=dataclasses.replace(control, **cut),
        metadata={**log.metadata, "result": {"outcome": "held", "reason": reason}},
    )  # fmt: skip


def test_braking_and_holding_of_the_mission_are_counted_with_their_cause(run_log: RunLog) -> None:
    """Ten ticks a second: 15 of braking, 25 of holding; the cause is in the last ticks, or else the mission's."""
    log = braked(run_log)
    section = summarise(log)["assurance"]
    assert (section["plan"], section["brake"], section["hold"], section["fallbacks"]) == (60, 15, 25, 0)
    assert section["braked_for"] == "stopped on request"
    assert "braked_for stopped on request" in format_summary(summarise(log))
    control = log.control
    rung = control.rung.copy()
    rung[-1] = 2
    given_up = dataclasses.replace(control, rung=rung, fault=(*control.fault[:-1], "the solver gave no answer"))
    section = summarise(dataclasses.replace(log, control=given_up))["assurance"]
    assert (section["brake"], section["braked_for"]) == (16, "the solver gave no answer")
    off = control.estimate_r_m.copy()
    off[-1] += (0.0, 12.0, 0.0)
    astray = summarise(dataclasses.replace(log, control=dataclasses.replace(control, estimate_r_m=off)))
    assert astray["assurance"]["braked_for"] == "the vehicle was 12.10 m off its reference"
    refused = LogLine(7.6, "error", "offboard", "set-point not sent: position outside the world")
    fenced = summarise(dataclasses.replace(log, lines=(*log.lines, refused)))
    assert fenced["assurance"]["braked_for"] == refused.message
    long_ago = dataclasses.replace(refused, t_s=5.0)
    assert summarise(dataclasses.replace(log, lines=(long_ago,)))["assurance"]["braked_for"] == "stopped on request"
