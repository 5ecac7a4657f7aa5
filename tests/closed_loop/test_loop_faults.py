"""What happens when a process dies, a port is taken, or somebody presses Ctrl-C."""

import json
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.recording.reader import RunLog

from .conftest import Process, free_port

Start = Callable[..., Process]
SPEED = "3"


def offboard_and_vehicle(start: Start, config: Path, out: Path) -> tuple[Process, Process, int]:
    """Both programs on free ports, three times as fast as real time."""
    port = free_port()
    clock = ("--clock", "realtime", "--speed", SPEED)
    log = ("--log", str(out / "vehicle.mcap"))
    vehicle = start(
        "vehicle_sim", str(config), "--connect", f"udpout://127.0.0.1:{port}", "--bind", "127.0.0.1:0", *clock, *log
    )
    vehicle.wait_for("ready")
    offboard = start(
        "sandwich_sitl.cli",
        "offboard",
        str(config),
        "--connect",
        f"udpin://127.0.0.1:{port}",
        "--out",
        str(out),
        *clock,
    )
    return offboard, vehicle, port


def heartbeats(port: int, timeout_s: float, until: Callable[[int, bool], bool]) -> list[tuple[int, bool]]:
    """(custom_mode, armed) of each HEARTBEAT heard on `port` until `until` says so."""
    heard: list[tuple[int, bool]] = []
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    deadline = time.monotonic() + timeout_s
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", port))
        sock.settimeout(1.0)
        while time.monotonic() < deadline:
            try:
                data = sock.recv(65536)
            except TimeoutError:
                continue
            for message in parser.parse_buffer(data) or []:
                if message.get_type() == "HEARTBEAT":
                    armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                    heard.append((message.custom_mode, armed))
                    if until(*heard[-1]):
                        return heard
    pytest.fail(f"waited {timeout_s} s in vain; heard {heard[-5:]}")


def test_a_killed_client_leaves_a_readable_log_and_the_vehicle_returns_and_lands(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    offboard, _, port = offboard_and_vehicle(start, short_config, tmp_path)
    offboard.wait_for("ACTIVE")
    time.sleep(6 / float(SPEED))
    offboard.kill()
    heard = heartbeats(port, 90.0, lambda _mode, armed: not armed)
    rtl = 5 << 24 | 4 << 16
    assert rtl in [mode for mode, _ in heard]
    log = RunLog.read(tmp_path / "offboard.mcap")
    assert log.control.t_s.size > 100
    assert log.plan is not None


def test_a_killed_vehicle_ends_the_client_with_a_clear_error_and_a_readable_log(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    offboard, vehicle, _ = offboard_and_vehicle(start, short_config, tmp_path)
    offboard.wait_for("ACTIVE")
    time.sleep(6 / float(SPEED))
    vehicle.kill()
    assert offboard.finish(30) == 5
    text = "\n".join(offboard.lines)
    assert "Traceback" not in text
    assert "lost" in text
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "lost"
    assert RunLog.read(tmp_path / "run.mcap").control.t_s.size > 50


def test_ctrl_c_brakes_holds_and_lands(start: Start, short_config: Path, tmp_path: Path) -> None:
    offboard, _, _ = offboard_and_vehicle(start, short_config, tmp_path)
    offboard.wait_for("ACTIVE")
    time.sleep(6 / float(SPEED))
    offboard.child.send_signal(signal.SIGINT)
    assert offboard.finish(60) == 130
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "interrupted"
    log = RunLog.read(tmp_path / "run.mcap")
    states = list(dict.fromkeys(log.mission.state))
    assert states[states.index("ACTIVE") :][:4] == ["ACTIVE", "BRAKE", "HOLD", "LAND"]
    assert not log.mission.armed[-1]


def test_ctrl_c_in_lockstep_lands_too(start: Start, short_config: Path, tmp_path: Path) -> None:
    # Slow, so that lockstep, some thirty times as fast as the clock, is not done before the signal comes.
    slow = ("--set", "planner.speed_mps=0.5")
    process = start("sandwich_sitl.cli", "run", str(short_config), "--out", str(tmp_path), *slow)
    process.wait_for("ACTIVE")
    process.child.send_signal(signal.SIGINT)
    assert process.finish(60) == 130
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "interrupted"


def test_an_occupied_port_is_one_line_and_exit_status_2(start: Start, short_config: Path, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        process = start(
            "sandwich_sitl.cli",
            "run",
            str(short_config),
            "--out",
            str(tmp_path),
            "--set",
            f"link.uri=udpin://127.0.0.1:{port}",
        )
        assert process.finish(60) == 2
    errors = [line for line in process.lines if line.startswith("sandwich-sitl:")]
    assert len(errors) == 1
    assert str(port) in errors[0]
    assert not any("Traceback" in line for line in process.lines)


def test_a_vehicle_that_never_answers_is_an_error_before_take_off(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    process = start(
        "sandwich_sitl.cli", "offboard", str(short_config), "--connect", f"udpin://127.0.0.1:{free_port()}",
        "--out", str(tmp_path), "--clock", "realtime", "--set", "mission.connect_timeout_s=2",
    )  # fmt: skip
    assert process.finish(60) != 0
    assert not any("Traceback" in line for line in process.lines)
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] in ("lost", "timeout")
