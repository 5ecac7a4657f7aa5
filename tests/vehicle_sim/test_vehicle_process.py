"""The vehicle as a process of its own, over real UDP: real time, lockstep, failsafe, ports, signals, the log."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20 import development

from vehicle_sim.cli import main
from vehicle_sim.config import load_run, parse_vehicle_section, vehicle_schema
from vehicle_sim.errors import ConfigError
from vehicle_sim.proto.vehicle_telemetry_pb2 import VehicleTelemetry

CONFIG = """
start_m: [5.0, 7.0]
goal_m: [50.0, 7.0]
seed: 3
world: {anything: of no concern}
vehicle:
  parameters: {RTL_RETURN_ALT: 5.0}
  sensors: {estimator: error_model}
"""
IDLE = 0xDFF
POINT = (2.0, 1.0, -3.0)
Message = Any


class Process:
    """vehicle-sim with a client's socket in front of it."""

    def __init__(self, config: Path, *options: str) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5.0)
        target = f"udpout://127.0.0.1:{self.socket.getsockname()[1]}"
        command = [sys.executable, "-m", "vehicle_sim", str(config), "--connect", target, "--bind", "127.0.0.1:0"]
        self.process = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        ready = self.process.stdout.readline()
        assert ready.startswith("vehicle-sim ready on 127.0.0.1:"), ready
        self.port = int(ready.rpartition(":")[2])
        self.mav = mavlink.MAVLink(None, 245, 191)

    def pack(self, *messages: Message) -> bytes:
        frames = b""
        for message in messages:
            frames += message.pack(self.mav)
            self.mav.seq = (self.mav.seq + 1) % 256
        return frames

    def send(self, *messages: Message) -> bytes:
        datagram = self.pack(*messages)
        self.socket.sendto(datagram, ("127.0.0.1", self.port))
        return datagram

    def read(self) -> bytes:
        return self.socket.recv(65535)

    def parse(self, datagram: bytes) -> list[Message]:
        return list(self.mav.parse_buffer(bytearray(datagram)) or [])

    def watch(self, each: Callable[[Message], bool], limit_s: float) -> Message:
        """The first message for which `each` is true."""
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            for message in self.parse(self.read()):
                if each(message):
                    return message
        pytest.fail("nothing of the kind came in time")

    def stop(self, number: int = signal.SIGTERM) -> tuple[int, str]:
        self.process.send_signal(number)
        _, err = self.process.communicate(timeout=10)
        return self.process.returncode, err

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        self.socket.close()


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "run.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture
def start(config: Path) -> Iterator[Callable[..., Process]]:
    started: list[Process] = []

    def begin(*options: str) -> Process:
        started.append(Process(config, *options))
        return started[-1]

    yield begin
    for process in started:
        process.close()


def setpoint(t_ms: int, mask: int = 0, position: tuple[float, float, float] = POINT) -> Message:
    return mavlink.MAVLink_set_position_target_local_ned_message(t_ms, 1, 1, 1, mask, *position, *([0.0] * 8))


def command(number: int, *parameters: float) -> Message:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *parameters, *([0.0] * (7 - len(parameters))))


def gcs_heartbeat() -> Message:
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def lockstep_flight(process: Process, seconds: float, retry_every: int = 0) -> list[bytes]:
    """Boot, OFFBOARD, arm, fly to `POINT`: every datagram that came back."""
    announcement = process.read()
    seen = [announcement]
    for k in range(round(seconds / 0.02)):
        t_ms = 20 * k
        messages = [gcs_heartbeat()] if k % 50 == 0 else []
        messages += [command(176, 1, 6)] if t_ms == 4600 else []
        messages += [command(400, 1)] if t_ms == 4800 else []
        sent = process.send(*messages, setpoint(t_ms, IDLE if t_ms < 3000 else 0))
        answer = process.read()
        while answer == announcement:
            answer = process.read()
        if retry_every and k % retry_every == 0:
            process.socket.sendto(sent, ("127.0.0.1", process.port))
            assert process.read() == answer
        seen.append(answer)
    return seen


def test_real_time_flight_then_lost_client_returns_lands_and_disarms(
    start: Callable[..., Process], tmp_path: Path
) -> None:
    log = tmp_path / "vehicle.mcap"
    process = start("--clock", "realtime", "--speed", "8", "--log", str(log))
    first = process.watch(lambda m: m.get_type() == "HEARTBEAT", 5.0)
    assert (first.get_srcSystem(), first.get_srcComponent(), first.autopilot, first.system_status) == (1, 1, 12, 0)
    state: dict[str, Any] = {"next": 0, "asked": 0}

    def fly(message: Message) -> bool:
        if message.get_type() == "HEARTBEAT":
            process.send(gcs_heartbeat())
            armed = message.base_mode & 128
            if message.system_status == 3 and not armed:
                process.send(command(176, 1, 6), command(400, 1))
        if message.get_type() != "LOCAL_POSITION_NED":
            return False
        process.send(setpoint(message.time_boot_ms))
        return dist((message.x, message.y, message.z), POINT) < 0.15

    arrived = process.watch(fly, 10.0)
    assert arrived.time_boot_ms > 4000
    texts: list[str] = []

    def listen(message: Message) -> bool:
        if message.get_type() == "HEARTBEAT":
            process.send(gcs_heartbeat())
            state.setdefault("modes", []).append(message.custom_mode)
        if message.get_type() == "STATUSTEXT":
            texts.append(message.text)
        return bool(texts and texts[-1] == "Disarmed by landing")

    process.watch(listen, 20.0)
    assert texts[0] == "Failsafe activated"
    assert 0x05040000 in state["modes"]
    assert process.stop() == (0, "")
    with log.open("rb") as file:
        poses = [
            (m.log_time, PoseInFrame.FromString(m.data)) for _, c, m in make_reader(file).iter_messages("/state/truth")
        ]
    assert poses[0][1].frame_id == "map"
    xyz = [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for _, p in poses]
    assert xyz[0] == pytest.approx((5.0, 7.0, 0.0), abs=1e-6)
    assert min(dist(point, (5.0 + POINT[1], 7.0 + POINT[0], -POINT[2])) for point in xyz) < 0.2
    assert dist(xyz[-1], xyz[0]) < 0.5
    steps = {b[0] - a[0] for a, b in pairwise(poses)}
    assert steps == {10_000_000}


def test_lockstep_same_seed_same_bytes_and_retries_change_nothing(
    start: Callable[..., Process], tmp_path: Path
) -> None:
    flights = []
    for seed, retry in (("4", 0), ("4", 7), ("5", 0)):
        log = tmp_path / f"{len(flights)}.mcap"
        process = start("--seed", seed, "--log", str(log))
        datagrams = lockstep_flight(process, 14.0, retry)
        assert process.stop(signal.SIGINT) == (0, "")
        with log.open("rb") as file:
            records = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]
        flights.append((datagrams, records))
    assert flights[0] == flights[1]
    assert flights[0][0] != flights[2][0]
    datagrams, records = flights[0]
    assert [t for _, t, _ in records] == sorted(t for _, t, _ in records)
    parser = development.MAVLink(None)  # the dialect that knows CURRENT_MODE
    parsed = [list(parser.parse_buffer(bytearray(d)) or []) for d in datagrams]
    assert [messages[-1].get_type() for messages in parsed] == ["SYSTEM_TIME"] * len(parsed)
    assert [messages[-1].time_boot_ms for messages in parsed] == [20 * k for k in range(len(parsed))]
    assert [m.get_type() for m in parsed[0]] == ["HEARTBEAT", "SYSTEM_TIME"]
    sequence = [m.get_msgbuf()[4] for messages in parsed for m in messages]  # also of what the dialect does not know
    assert sequence == [i % 256 for i in range(len(sequence))]
    assert not [m for messages in parsed for m in messages if m.get_type() == "STATUSTEXT" and "invalid" in m.text]
    last = VehicleTelemetry.FromString([data for topic, _, data in records if topic == "/vehicle/telemetry"][-1])
    assert (last.mode, last.armed, last.landed) == ("OFFBOARD", True, False)
    assert dist((last.position_north_m, last.position_east_m, last.position_down_m), POINT) < 0.15
    assert b"".join(datagrams) == b"".join(data for topic, _, data in records if topic == "/vehicle/mavlink/tx")


def test_lockstep_waits_for_the_first_tick_and_repeats_its_announcement(start: Callable[..., Process]) -> None:
    process = start()
    first = process.read()
    assert process.read() == first
    process.send(setpoint(40, IDLE))
    process.send(gcs_heartbeat())
    assert process.read() == first
    process.send(setpoint(0, IDLE))
    answer = process.read()
    while answer == first:
        answer = process.read()
    assert process.parse(answer)[-1].time_boot_ms == 20
    process.socket.settimeout(0.3)
    with pytest.raises(TimeoutError):
        process.read()


def test_another_client_may_listen_and_ask_but_does_not_tick(start: Callable[..., Process]) -> None:
    process = start()
    announcement = process.read()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(3.0)
        foreign = mavlink.MAVLink(None, 255, 190)
        other.sendto(setpoint(0, IDLE).pack(foreign), ("127.0.0.1", process.port))
        other.sendto(command(512, 148).pack(foreign), ("127.0.0.1", process.port))
        assert process.read() == announcement
        for k in range(60):
            process.send(setpoint(20 * k, IDLE))
            answer = process.read()
            while answer == announcement:
                answer = process.read()
            assert process.parse(answer)[-1].time_boot_ms == 20 * (k + 1)
        names = {
            m.get_type()
            for m in mavlink.MAVLink(None).parse_buffer(bytearray(b"".join(other.recv(65535) for _ in range(55))))
        }
        assert {"AUTOPILOT_VERSION", "COMMAND_ACK", "ATTITUDE"} <= names


def test_a_lockstep_peer_that_falls_silent_leaves_real_time_behind(start: Callable[..., Process]) -> None:
    process = start()
    announcement = process.read()
    process.send(setpoint(0, IDLE))
    while process.read() == announcement:
        pass
    process.socket.settimeout(8.0)
    begin = time.monotonic()
    times = [m.time_boot_ms for _ in range(20) for m in process.parse(process.read()) if m.get_type() == "ATTITUDE"]
    assert 4.5 < time.monotonic() - begin < 15.0
    assert times == sorted(set(times))


def test_waits_for_clients_at_its_own_address(config: Path) -> None:
    command_line = [
        sys.executable,
        "-m",
        "vehicle_sim",
        str(config),
        "--connect",
        "udpin://127.0.0.1:0",
        "--clock",
        "realtime",
    ]
    with subprocess.Popen(command_line, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        port = int(process.stdout.readline().rpartition(":")[2])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.settimeout(3.0)
            client.sendto(b"no frame at all", ("127.0.0.1", port))
            client.sendto(gcs_heartbeat().pack(mavlink.MAVLink(None, 255, 190)), ("127.0.0.1", port))
            assert client.recv(65535)[0] == 0xFD
        process.send_signal(signal.SIGINT)
        assert process.wait(5) == 0


def test_a_killed_vehicle_leaves_a_readable_log(start: Callable[..., Process], tmp_path: Path) -> None:
    log = tmp_path / "killed.mcap"
    process = start("--clock", "realtime", "--speed", "5", "--log", str(log))
    process.watch(lambda m: m.get_type() == "SYSTEM_TIME" and m.time_boot_ms > 4000, 5.0)
    process.process.kill()
    process.process.wait()
    times: list[int] = []
    with log.open("rb") as file, suppress(EndOfFile):
        times.extend(record.log_time for record in StreamReader(file).records if isinstance(record, Record))
    assert times == sorted(times)
    assert times[-1] > 2_000_000_000


def test_occupied_port_is_one_line_and_status_2(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        status = main([str(config), "--connect", "udpout://127.0.0.1:9", "--bind", f"127.0.0.1:{port}"])
    captured = capsys.readouterr()
    assert (status, captured.out) == (2, "")
    assert captured.err.count("\n") == 1
    assert f"127.0.0.1:{port} cannot be bound" in captured.err


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("seed: 1", ["start_m", "missing"]),
        (
            "start_m: [0.0, 0.0]\nvehicle:\n  airframe:\n    mass: 3",
            [":4:", "vehicle.airframe.mass", "not a known key"],
        ),
        ("start_m: [0.0, 0.0]\nvehicle:\n  airframe: {mass_kg: heavy}", [":3:", "vehicle.airframe.mass_kg", "heavy"]),
        (
            "start_m: [0.0, 0.0]\nvehicle:\n  parameters:\n    MPC_XY_Q: 1.0",
            [":4:", "MPC_XY_Q", "not a known parameter"],
        ),
        ("start_m: [0.0, 0.0]\nvehicle: {parameters: {NAV_RCL_ACT: 99}}", ["NAV_RCL_ACT", "between 1 and 6"]),
        ("start_m: [0.0, 0.0]\nmpc: {rate_hz: 60.0}", ["mpc.rate_hz", "whole milliseconds"]),
        ("start_m: [0.0, .nan]", ["start_m[1]"]),
        ("start_m: [0.0", [":1:", "not valid YAML"]),
        ("- 1", ["must be a mapping"]),
    ],
)
def test_bad_configuration_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, parts: list[str]
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    assert main([str(path), "--connect", "udpout://127.0.0.1:9"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(path) in error
    for part in parts:
        assert part in error


@pytest.mark.parametrize(
    "options",
    [
        ["--connect", "serial://127.0.0.1:1"],
        ["--connect", "udpout://127.0.0.1"],
        ["--connect", "udpout://127.0.0.1:99999"],
        ["--connect", "udpin://127.0.0.1:0", "--bind", "127.0.0.1:0"],
        ["--connect", "udpout://127.0.0.1:9", "--set", "seed"],
        ["--connect", "udpout://127.0.0.1:9", "--truth", "udpin://127.0.0.1:9"],
        ["--connect", "udpout://127.0.0.1:9", "--count", "0"],
        [],
        ["--connect", "udpout://127.0.0.1:9", "--set", "vehicle.wind.gusts=3"],
        ["--connect", "udpout://127.0.0.1:9", "--speed", "-1"],
        ["--connect", "udpout://127.0.0.1:9", "--set", "seed=[1"],
        ["--connect", "udpout://127.0.0.1:9", "--set", "seed=2001-13-41"],
        ["--connect", "udpout://127.0.0.1:9", "--bind", "127.0.0.1:0", "--surroundings", "/none/obstacles.json"],
        ["--connect", "udpout://127.0.0.1:9", "--bind", "127.0.0.1:0", "--log", "/dev/null/log.mcap"],
    ],
)
def test_bad_options_are_one_line_and_status_2(
    config: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    assert main([str(config), *options]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("seconds", ["-5", "0", "nan", "long"])
def test_a_bench_that_lasts_no_time(capsys: pytest.CaptureFixture[str], seconds: str) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([f"--bench={seconds}"])
    assert stopped.value.code == 2
    assert f"argument --bench: {seconds}" in capsys.readouterr().err


def test_sections_of_others_are_passed_over_and_overrides_win(config: Path) -> None:
    run = load_run(config, {"vehicle.wind.mean_enu_mps": [1.0, 2.0, 0.0], "seed": 9})
    assert (run.seed, run.start_m, run.vehicle.wind.mean_enu_mps) == (9, (5.0, 7.0), (1.0, 2.0, 0.0))
    assert run.period_us == 20_000
    assert parse_vehicle_section({}, "run.yaml") == parse_vehicle_section({"airframe": {}}, "run.yaml")
    with pytest.raises(ConfigError, match=r"run.yaml: vehicle.battery.cells: .*got 0"):
        parse_vehicle_section({"battery": {"cells": 0}}, "run.yaml")
    assert set(vehicle_schema()["properties"]) >= {"airframe", "wind", "sensors", "battery", "home", "parameters"}
