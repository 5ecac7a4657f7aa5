"""An obstacle appears in flight: flown in real processes over real UDP, and in real time over real Zenoh."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from sandwich_sitl.recording.container import read_raw
from sandwich_sitl.recording.reader import RunLog, payload_digests

from .conftest import Process

Start = Callable[..., Process]

ROOT = Path(__file__).parents[2]
STREET = """
name: street
seed: 2
world:
  bounds_m: [0, 0, 46, 24]
  obstacles:
    - {name: shed, polygon_m: [[14, 2], [18, 2], [18, 8], [14, 8]]}
start_m: [4, 12]
goal_m: [42, 12]
altitude_m: 3
planner: {vehicle_radius_m: 0.4, margin_m: 0.6, cell_m: 1.0, flow: x, speed_mps: 3.0, acceleration_mps2: 2.0}
link: {uri: "udpin://127.0.0.1:0"}
zenoh: {enabled: false}
vehicle:
  sensors: {estimator: error_model}
  range_sensor: {rate_hz: 10, reach_m: 15}
  obstacles:
    - {name: lorry, polygon_m: [[25, 9], [27, 9], [27, 16], [25, 16]], appears_s: 14}
"""
LORRY = shapely.box(25, 9, 27, 16)
GATE = "{name: gate, polygon_m: [[25, -2], [26, -2], [26, 26], [25, 26]], appears_s: 14}"


def run_cli(config: Path, out: Path, *more: str) -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, "-m", "sandwich_sitl.cli", "run", str(config), "--out", str(out), *more],
        capture_output=True, text=True, timeout=150, check=False,
    )  # fmt: skip
    assert (out / "summary.json").exists(), done.stderr
    summary: dict[str, object] = json.loads((out / "summary.json").read_text())
    return summary | {"exit_status": done.returncode, "stderr": done.stderr}


def check_setpoints(log: RunLog, from_s: float) -> None:
    """Position, velocity and acceleration of the set-points sent step nowhere: each is the integral of the next."""
    control = log.control
    chosen = control.t_s >= from_s
    t, r, v, a = (
        x[chosen] for x in (control.t_s, control.setpoint_r_m, control.setpoint_v_mps, control.setpoint_a_mps2)
    )
    dt = np.diff(t)[:, None]
    assert np.abs(dt - 0.02).max() < 1e-6
    jerk = 1.25 * 40.0
    assert np.abs(np.diff(a, axis=0)).max() <= jerk * 0.02
    assert np.abs(np.diff(v, axis=0) - a[:-1] * dt).max() <= jerk * 0.02**2
    assert np.abs(np.diff(r, axis=0) - v[:-1] * dt - a[:-1] * dt**2 / 2).max() <= jerk * 0.02**3


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("street") / "street.yaml"
    path.write_text(STREET, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def detoured(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("detoured")
    summary = run_cli(street, out)
    assert summary["exit_status"] == 0, summary
    return out


def test_what_the_range_sensor_sees_is_flown_round(detoured: Path) -> None:
    summary = json.loads((detoured / "summary.json").read_text())
    assert summary["outcome"] == "landed"
    assert summary["flight"]["min_clearance_m"] >= 0.4
    assert summary["flight"]["quadrangle_violations"] == 0
    detours = summary["detours"]
    assert detours["obstacles"] >= 1
    assert detours["replans"] == detours["routes"] >= 1
    assert detours["report_to_setpoint_s"]["max"] <= 0.15
    log = RunLog.read(detoured / "run.mcap")
    assert np.hypot(*(log.truth.r_m[-1, :2] - (42, 12))) < 0.5
    there = log.truth.t_s >= 14.0
    assert shapely.LineString(log.truth.r_m[there, :2]).distance(LORRY) >= 0.4
    assert log.reported[0].source == "sensor"
    assert shapely.Polygon(log.reported[0].ring_m).distance(LORRY) < 0.5
    assert 14.0 <= log.reported[0].heard_s < 20.0
    check_setpoints(log, log.updates[0].t_s - 1.0)


def test_the_new_plan_is_in_the_log_and_agrees_with_what_was_flown(detoured: Path) -> None:
    log = RunLog.read(detoured / "run.mcap")
    assert log.plan is not None
    assert log.updates[0].first_region == len(log.plan.corridor.polygons_m)
    update = log.updates[-1]
    np.testing.assert_allclose(update.reference.xyz_m[-1], (42, 12, 3), atol=1e-6)
    after = (log.control.t_s > update.t_s + 0.5) & (log.control.rung == 0)
    line = shapely.LineString(update.reference.xyz_m)
    ground_m = log.control.reference_m[after][:, 2].min() - 3.0
    points = log.control.reference_m[after] - (0, 0, ground_m)
    assert shapely.distance(line, shapely.points(points[:, :2])).max() < 1e-3
    assert set(log.control.region[after]) <= {update.first_region + m for m in range(len(update.corridor.polygons_m))}
    assert any("touches the corridor" in one.message for one in log.lines)


def test_an_obstacle_that_closes_the_only_way_stops_the_vehicle_before_it(street: Path, tmp_path: Path) -> None:
    summary = run_cli(street, tmp_path, "--set", f"vehicle.obstacles=[{GATE}]", "--set", "mission.hold_s=2")
    assert summary["exit_status"] == 6
    assert summary["outcome"] == "held"
    assert "closed the way" in str(summary["reason"])
    log = RunLog.read(tmp_path / "run.mcap")
    assert log.updates[-1].verdict == "stop"
    assert log.mission.state[log.mission.state.index("ACTIVE") :] == ("ACTIVE", "BRAKE", "HOLD", "LAND", "DONE")
    assert log.truth.r_m[:, 0].max() < 25 - 0.4
    assert not log.mission.armed[-1]
    assert abs(log.truth.r_m[-1, 2]) < 0.1
    assert log.control.rung.max() <= 1
    check_setpoints(log, log.updates[0].t_s - 1.0)


def test_a_truth_that_enters_an_obstacle_nobody_saw_is_a_safety_violation(street: Path, tmp_path: Path) -> None:
    summary = run_cli(street, tmp_path, "--set", "vehicle.range_sensor=null", "--set", "planner.speed_mps=6")
    assert summary["exit_status"] == 1
    assert summary["outcome"] == "safety_violation"


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_with_new_plans_too(street: Path, detoured: Path, tmp_path: Path) -> None:
    assert run_cli(street, tmp_path)["exit_status"] == 0
    first, second = (payload_digests(read_raw(path / "run.mcap")) for path in (detoured, tmp_path))
    assert "/plan/update" in first
    assert first == second


@pytest.mark.slow
def test_the_shipped_configuration_goes_round_and_lands(tmp_path: Path) -> None:
    summary = run_cli(ROOT / "configs" / "pop_up.yaml", tmp_path, "--set", "link.uri=udpin://127.0.0.1:0")
    assert summary["exit_status"] == 0
    assert summary["outcome"] == "landed"


def report(end_point: str, *arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools" / "report_obstacle.py"), *arguments, "--connect", end_point],
        capture_output=True, text=True, timeout=60, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_obstacles_reported_over_zenoh_in_real_time_are_flown_round(start: Start, street: Path, tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        end_point = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    flight = start(
        "sandwich_sitl.cli", "run", str(street), "--clock", "realtime", "--out", str(tmp_path),
        "--set", "vehicle.obstacles=[]", "--set", "zenoh.enabled=true", "--set", f'zenoh.listen=["{end_point}"]',
    )  # fmt: skip
    flight.wait_for("ACTIVE")
    lorry = ("lorry", "25,9", "27,9", "27,16", "25,16", "--height", "4")
    report(end_point, *lorry)
    flight.wait_for("'lorry' heard of: it touches the corridor")
    flight.wait_for("new route in force")
    report(end_point, *lorry)
    report(end_point, "bin", "35,11", "36,11", "36,14")
    flight.wait_for("'bin' heard of")
    assert flight.finish() == 0, flight.lines
    log = RunLog.read(tmp_path / "run.mcap")
    assert [(seen.name, seen.source) for seen in log.reported] == [("lorry", "message"), ("bin", "message")]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "landed"
    assert summary["detours"]["routes"] >= 2
    truth = shapely.LineString(log.truth.r_m[:, :2])
    assert min(truth.distance(shapely.Polygon(seen.ring_m)) for seen in log.reported) >= 0.4
