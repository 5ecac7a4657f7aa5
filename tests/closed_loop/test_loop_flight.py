"""A whole flight in lockstep: what it reports, what it logs, and that the same seed gives the same bytes."""

import itertools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from pymavlink import mavutil

from sandwich_sitl.recording.container import read_raw
from sandwich_sitl.recording.reader import RunLog, payload_digests

SUMMARY_KEYS = {
    "map": {"channels", "nodes", "folded_cells", "min_jacobian_ratio", "seconds"},
    "route": {"sandwich_m", "grid_astar_m", "exact_m", "reduction_percent"},
    "flight": {
        "duration_s", "path_flown_m", "rms_error_m", "max_error_m", "min_clearance_m", "quadrangle_violations",
        "wall_seconds", "realtime_factor",
    },
    "mpc": {"ticks", "solve_ms", "loop_ms", "infeasible", "deadline_misses", "max_slack_m"},
    "link": {"sent", "received", "lost", "refused"},
}  # fmt: skip


def run_cli(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "sandwich_sitl.cli", *arguments],
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )


def test_the_summary_holds_every_promised_key(flown: Path) -> None:
    summary = json.loads((flown / "summary.json").read_text())
    assert {"outcome", "seed", "clock"} <= summary.keys()
    for section, keys in SUMMARY_KEYS.items():
        assert keys <= summary[section].keys()
    assert {"p50", "p99", "max"} <= summary["mpc"]["solve_ms"].keys()
    assert {"p50", "p99", "max"} <= summary["mpc"]["loop_ms"].keys()


def test_the_vehicle_landed_at_the_goal_close_to_the_reference_and_clear_of_the_obstacle(flown: Path) -> None:
    summary = json.loads((flown / "summary.json").read_text())
    assert summary["outcome"] == "landed"
    assert summary["flight"]["rms_error_m"] < 0.15
    assert summary["flight"]["min_clearance_m"] >= 0.4
    assert summary["mpc"]["infeasible"] == 0
    assert summary["link"]["lost"] == 0
    assert summary["link"]["refused"] == 0
    log = RunLog.read(flown / "run.mcap")
    assert np.hypot(*(log.truth.r_m[-1, :2] - (35, 12))) < 0.5
    assert abs(log.truth.r_m[-1, 2]) < 0.1


@pytest.mark.slow
def test_with_an_estimate_made_of_sensors_it_lands_and_is_off_by_the_estimates_error(
    short_config: Path, tmp_path: Path
) -> None:
    done = run_cli("run", str(short_config), "--out", str(tmp_path), "--set", "vehicle.sensors.estimator=filter")
    assert done.returncode == 0, done.stderr + done.stdout
    log = RunLog.read(tmp_path / "run.mcap")
    seen = np.array([np.interp(log.truth.t_s, log.estimate.t_s, log.estimate.r_m[:, axis]) for axis in range(2)]).T
    error_m = np.linalg.norm(seen - log.truth.r_m[:, :2], axis=1)
    flight = json.loads((tmp_path / "summary.json").read_text())["flight"]
    assert 0.05 < np.sqrt(np.mean(error_m**2)) < 0.7
    assert abs(flight["rms_error_m"] - np.sqrt(np.mean(error_m**2))) < 0.2


def test_the_clearance_is_that_of_the_continuous_true_path(flown: Path) -> None:
    log = RunLog.read(flown / "run.mcap")
    crate = shapely.box(17, 8, 23, 15)
    dense = np.concatenate([np.linspace(a, b, 5) for a, b in itertools.pairwise(log.truth.r_m[:, :2])])
    nearest = float(shapely.distance(shapely.points(dense), crate).min())
    summary = json.loads((flown / "summary.json").read_text())
    assert summary["flight"]["min_clearance_m"] == pytest.approx(nearest, abs=1e-3)


def test_truth_and_command_agree_in_every_axis(flown: Path) -> None:
    """A sign or axis error between ENU and NED on either side would show here."""
    log = RunLog.read(flown / "run.mcap")
    setpoint = log.control.setpoint_r_m
    truth = np.column_stack([np.interp(log.control.t_s, log.truth.t_s, log.truth.r_m[:, axis]) for axis in range(3)])
    for axis in range(3):
        assert np.abs(truth[:, axis] - setpoint[:, axis]).max() < 0.5
        assert np.ptp(setpoint[:, axis]) > 1.0


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(
    flown: Path, short_config: Path, tmp_path: Path
) -> None:
    first = payload_digests(read_raw(flown / "run.mcap"))
    for seed, same in (("3", True), ("4", False)):
        out = tmp_path / seed
        assert run_cli("run", str(short_config), "--seed", seed, "--out", str(out)).returncode == 0
        other = payload_digests(read_raw(out / "run.mcap"))
        assert other.keys() == first.keys()
        if same:
            assert other == first
        else:
            for topic in ("/control/telemetry", "/state/truth", "/mavlink/rx", "/mavlink/tx", "/vehicle/telemetry"):
                assert other[topic] != first[topic]


def test_the_exported_tlog_replays_through_pymavlink(flown: Path, tmp_path: Path) -> None:
    tlog = tmp_path / "run.tlog"
    tool = Path(__file__).parents[2] / "tools" / "export.py"
    done = subprocess.run(
        [sys.executable, str(tool), str(flown / "run.mcap"), "--tlog", str(tlog)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    replayed = mavutil.mavlink_connection(str(tlog))
    counts: dict[str, int] = {}
    altitude_m = 0.0
    while (message := replayed.recv_match()) is not None:
        counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
        if message.get_type() == "LOCAL_POSITION_NED":
            altitude_m = max(altitude_m, -message.z)
    replayed.close()
    log = RunLog.read(flown / "run.mcap")
    frames = log.frames_of("/mavlink/tx") + log.frames_of("/mavlink/rx")
    assert sum(counts.values()) == len(frames)
    assert counts["SET_POSITION_TARGET_LOCAL_NED"] > 500
    assert altitude_m == pytest.approx(4.0, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "city", "open", "old_town", "warehouse", "floors"])
def test_the_shipped_configurations_land(name: str, tmp_path: Path) -> None:
    config = Path(__file__).parents[2] / "configs" / f"{name}.yaml"
    done = run_cli("run", str(config), "--out", str(tmp_path), "--set", "link.uri=udpin://127.0.0.1:0")
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "landed"
    assert summary["map"]["folded_cells"] == 0
    assert summary["mpc"]["infeasible"] == 0
    assert summary["flight"]["rms_error_m"] < 0.15
    assert summary["flight"]["quadrangle_violations"] == 0
    if name != "open":
        assert summary["flight"]["min_clearance_m"] >= 0.4
        assert summary["route"]["exact_m"] <= summary["route"]["sandwich_m"] < summary["route"]["grid_astar_m"]


def test_a_realtime_flight_lands(short_config: Path, tmp_path: Path) -> None:
    done = run_cli("run", str(short_config), "--clock", "realtime", "--speed", "3", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["outcome"], summary["clock"]) == ("landed", "realtime")
    assert summary["flight"]["min_clearance_m"] >= 0.4


def test_paper_mode_flies_the_papers_pipeline(short_config: Path, tmp_path: Path) -> None:
    done = run_cli(
        "run", str(short_config), "--set", "mode=paper", "--set", "mpc.bandwidth_radps=4", "--out", str(tmp_path)
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "landed"
    assert summary["mpc"]["infeasible"] == 0
