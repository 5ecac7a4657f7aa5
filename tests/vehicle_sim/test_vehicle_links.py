"""The vehicle as a process with several clients: UDP and TCP, MAVLink 1 and 2, late and returning clients, instances, truth, pause."""

import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

Start = Callable[..., "subprocess.Popen[str]"]


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Start `vehicle-sim` in real time; wait for its line; end it with the test."""
    config = tmp_path / "run.yaml"
    config.write_text("start_m: [0.0, 0.0]\n")
    started: list[subprocess.Popen[str]] = []

    def begin(*options: str, clock: str = "realtime", ready: int = 1) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "vehicle_sim", str(config), "--clock", clock, *options]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert started[-1].stdout is not None
        for _ in range(ready):
            assert started[-1].stdout.readline().startswith("vehicle-sim ready")
        return started[-1]

    yield begin
    for process in started:
        process.terminate()
        process.communicate(timeout=20)


class Talker:
    """A client over a UDP or TCP socket, in MAVLink 1 or 2."""

    def __init__(self, sock: socket.socket, dialect: Any = mavlink, system: int = 255) -> None:
        self.socket = sock
        self.mav = dialect.MAVLink(None, system, 190)
        self.mav.robust_parsing = True
        self.raw = b""

    def send(self, message: Any) -> None:
        self.socket.sendall(message.pack(self.mav))

    def hear(self, kind: str, limit_s: float = 5.0, where: Callable[[Any], bool] = lambda _message: True) -> Any:
        end = time.monotonic() + limit_s
        self.socket.settimeout(0.2)
        while time.monotonic() < end:
            try:
                self.raw = self.socket.recv(65535)
            except (TimeoutError, ConnectionRefusedError):
                continue
            for message in self.mav.parse_buffer(bytearray(self.raw)) or []:
                if message.get_type() == kind and where(message):
                    return message
        pytest.fail(f"no {kind} within {limit_s} s")


def udp_to(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.connect(("127.0.0.1", port))
    return sock


def tcp_to(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), 5.0)


HELLO = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
SETPOINT = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, 0, 0, -3, *([0] * 8))
ASK = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)


def test_udp_and_tcp_clients_at_once_a_late_joiner_and_one_that_comes_back(start: Start) -> None:
    udp, tcp = free_port(), free_port(socket.SOCK_STREAM)
    start("--connect", f"udpin://127.0.0.1:{udp}", "--connect", f"tcp://127.0.0.1:{tcp}", "--speed", "2")
    with udp_to(udp) as a, tcp_to(tcp) as b:
        first, second = Talker(a), Talker(b, system=254)
        for talker in (first, second):
            talker.send(HELLO)
            talker.hear("ATTITUDE")
            talker.send(ASK)
            ack = talker.hear("COMMAND_ACK")
            assert (ack.result, ack.target_system) == (0, talker.mav.srcSystem)
    with udp_to(udp) as c, tcp_to(tcp) as d:
        for late in (Talker(c, system=250), Talker(d, system=254)):
            late.send(HELLO)
            late.hear("AUTOPILOT_VERSION" if late.send(ASK) else "HEARTBEAT")
            assert late.hear("HEARTBEAT").autopilot == 12


def test_a_client_that_speaks_version_1_is_answered_in_version_1(start: Start) -> None:
    port = free_port()
    start("--connect", f"udpin://127.0.0.1:{port}")
    with udp_to(port) as one, udp_to(port) as two:
        old = Talker(one, mavlink1)
        old.send(mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        assert old.hear("HEARTBEAT").autopilot == 12
        assert old.raw[0] == 0xFE
        old.send(mavlink1.MAVLink_param_request_read_message(1, 1, b"MPC_XY_P", -1))
        assert old.hear("PARAM_VALUE").param_id == "MPC_XY_P"
        assert 0xFD not in {old.raw[0]}
        new = Talker(two)
        new.send(HELLO)
        new.hear("ATTITUDE")
        assert new.raw[0] == 0xFD


def test_pymavlinks_own_connection_arms_and_takes_off_over_tcp(start: Start) -> None:
    port = free_port(socket.SOCK_STREAM)
    start("--connect", f"tcp://127.0.0.1:{port}", "--speed", "5")
    link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=255)
    try:
        link.mav.heartbeat_send(6, 8, 0, 0, 4)
        assert link.wait_heartbeat(timeout=5) is not None
        end = time.monotonic() + 5
        while link.recv_match(type="HEARTBEAT", blocking=True, timeout=2).system_status != 3:
            assert time.monotonic() < end
        link.arducopter_arm()
        link.mav.command_long_send(1, 1, 22, 0, 0, 0, 0, 0, 0, 0, float("nan"))
        while -link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=2).z < 2.0:
            assert time.monotonic() < end + 5
    finally:
        link.close()


def test_the_true_state_goes_to_a_port_of_its_own(start: Start) -> None:
    udp = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as truth:
        truth.bind(("127.0.0.1", 0))
        start("--connect", f"udpin://127.0.0.1:{udp}", "--truth", f"udpout://127.0.0.1:{truth.getsockname()[1]}")
        listener = Talker(truth)
        state = listener.hear("HIL_STATE_QUATERNION")
        assert (state.lat, state.alt) == (473977420, 488000)
        assert state.zacc == pytest.approx(-1000, abs=2)
        kinds = {m.get_type() for _ in range(40) for m in listener.mav.parse_buffer(bytearray(truth.recv(2000))) or []}
        assert kinds <= {"HEARTBEAT", "HIL_STATE_QUATERNION"}


def test_several_vehicles_from_one_command(start: Start) -> None:
    base = free_port()
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    try:
        try:
            for i, sock in enumerate(sockets):
                sock.bind(("127.0.0.1", base + i))
        except OSError:
            pytest.skip("three free ports in a row were not to be had")
        start("--connect", f"udpout://127.0.0.1:{base}", "--bind", "127.0.0.1:0", "--count", "3", ready=3)
        for i, sock in enumerate(sockets):
            assert Talker(sock).hear("HEARTBEAT").get_srcSystem() == 1 + i
    finally:
        for sock in sockets:
            sock.close()


def test_pause_stops_time_and_a_step_is_one_batch(start: Start) -> None:
    port = free_port()
    process = start("--connect", f"udpin://127.0.0.1:{port}", "--paused")
    with udp_to(port) as sock:
        talker = Talker(sock)
        talker.send(HELLO)
        time.sleep(0.3)
        times = []
        for _ in range(3):
            process.send_signal(signal.SIGUSR2)
            times.append(talker.hear("ATTITUDE").time_boot_ms)
        assert times == [10, 20, 30]
        with pytest.raises(TimeoutError):
            sock.recv(2000)
        process.send_signal(signal.SIGUSR1)
        assert talker.hear("ATTITUDE", where=lambda m: m.time_boot_ms > 200).time_boot_ms < 2000


@pytest.mark.parametrize(("speed", "low", "high"), [("0.1", 0.02, 0.2), ("10", 5.0, 11.0)])
def test_any_speed_factor(start: Start, speed: str, low: float, high: float) -> None:
    port = free_port()
    start("--connect", f"udpin://127.0.0.1:{port}", "--speed", speed)
    with udp_to(port) as sock:
        talker = Talker(sock)
        talker.send(HELLO)
        first, begin = talker.hear("ATTITUDE").time_boot_ms, time.monotonic()
        until = first + 1000 * float(speed)
        last = talker.hear("ATTITUDE", where=lambda m: m.time_boot_ms >= until).time_boot_ms
        assert low < (last - first) / 1e3 / (time.monotonic() - begin) < high


def test_row_23_time_outs_are_scaled_by_the_speed(start: Start) -> None:
    """COM_OF_LOSS_T is simulated time: at four times the speed OFFBOARD is lost 1.07 s of the vehicle's clock after the last set-point."""
    port = free_port()
    start("--connect", f"udpin://127.0.0.1:{port}", "--speed", "4")
    with udp_to(port) as sock:
        talker = Talker(sock)
        talker.send(HELLO)
        talker.hear("HEARTBEAT", where=lambda m: m.system_status == 3)
        talker.send(SETPOINT)
        for number, parameters in ((176, (1, 6)), (400, (1, 0))):
            talker.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *parameters, 0, 0, 0, 0, 0))
        last_ms = 0
        while talker.hear("EXTENDED_SYS_STATE").landed_state != 2:
            last_ms = talker.hear("LOCAL_POSITION_NED").time_boot_ms
            talker.send(SETPOINT)
            assert last_ms < 30_000
        # OFFBOARD's own target is the set-point; the Return that takes over asks for somewhere else
        changed = talker.hear("POSITION_TARGET_LOCAL_NED", where=lambda m: m.z != -3.0)
        assert (changed.time_boot_ms - last_ms) / 1e3 == pytest.approx(1.07, abs=0.5)


def processor_s(pid: int) -> float:
    """Processor time so far: what a start takes on a machine that does nothing else."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def libraries_s() -> float:
    """Processor time in which an interpreter starts and loads what the vehicle is built on: the machine's own measure."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    modules = "import numpy, scipy.linalg, pymavlink.dialects.v20.common"
    subprocess.run([sys.executable, "-c", modules], check=True, timeout=60)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def test_the_first_heartbeat_comes_soon_and_memory_stays_below_200_mib(start: Start) -> None:
    """The first start may have to compile the kernel and does not count."""
    waits, peaks, loads = [], [], []
    for _ in range(3):
        loads.append(libraries_s())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            target = f"udpout://127.0.0.1:{sock.getsockname()[1]}"
            process = start("--connect", target, "--bind", "127.0.0.1:0", clock="lockstep", ready=0)
            Talker(sock).hear("HEARTBEAT", 30.0)
            waits.append(processor_s(process.pid))
            time.sleep(1.0)
            status = Path(f"/proc/{process.pid}/status").read_text()
            peaks.append(int(status.split("VmHWM:")[1].split()[0]) / 1024)
    assert min(waits[1:]) < 5.0 * max(loads), (waits, loads)
    assert max(peaks[1:]) < 200, peaks


@pytest.mark.slow
def test_the_first_start_of_an_installation_is_quick_and_small_too(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is compiled yet; the compiler runs beside the vehicle, which takes up its work when that is done."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        target = f"udpout://127.0.0.1:{sock.getsockname()[1]}"
        process = start("--connect", target, "--bind", "127.0.0.1:0", ready=0)
        Talker(sock).hear("HEARTBEAT", 30.0)
        assert processor_s(process.pid) < 5.0 * libraries_s()
        end = time.monotonic() + 100.0
        while not list(tmp_path.glob("cache/**/*advance*.nbi")) and time.monotonic() < end:
            time.sleep(0.2)
        time.sleep(3.0)
        assert list(tmp_path.glob("cache/**/*advance*.nbc"))
        status = Path(f"/proc/{process.pid}/status").read_text()
        assert int(status.split("VmHWM:")[1].split()[0]) / 1024 < 200


def test_listings_need_no_configuration() -> None:
    for option, expected in (("--contract", "Disarming denied: not landed"), ("--parameters", "COM_OF_LOSS_T")):
        done = subprocess.run(
            [sys.executable, "-m", "vehicle_sim", option], capture_output=True, text=True, timeout=30, check=False
        )
        assert done.returncode == 0, done.stderr
        assert expected in done.stdout
