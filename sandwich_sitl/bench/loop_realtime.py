"""`vehicle-sim` in real time: how long until it speaks, how late its batches are, how much memory it takes.

Beside it, in this process and during the same seconds, a bare ticker that only sleeps and looks at the clock: what the
machine does to that, it does to every program.
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sandwich_sitl.bench.child import peak_memory_mib
from sandwich_sitl.errors import LinkError

_FIRST_S = 30.0
_STOP_S = 10.0
_COMPILED_S = 120.0
_PERIOD_S = 0.01


@dataclass(frozen=True)
class StartUp:
    """Seconds from starting the process to its first datagram, wall clock and its own processor time; peak memory (MiB)."""

    wall_s: float
    processor_s: float
    memory_mib: float


def start_up(config_path: Path, cold: bool) -> StartUp:
    """Start it and look on for a while; `cold` is the first start of an installation, watched until its kernel is compiled."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {"NUMBA_CACHE_DIR": folder} if cold else {}
        with _Vehicle(config_path, 1.0, environment) as vehicle:
            wall_s, processor_s = vehicle.first_datagram()
            deadline = time.monotonic() + _COMPILED_S
            while cold and not any(Path(folder).rglob("*.nbc")) and time.monotonic() < deadline:
                time.sleep(0.1)
            time.sleep(10.0 if cold else 2.0)  # it loads what was compiled
            return StartUp(wall_s, processor_s, peak_memory_mib(vehicle.process.pid))


def lateness(config_path: Path, speed: float, seconds: float) -> tuple[str, str]:
    """The vehicle's own report over `seconds` of wall time at `speed`, and the bare ticker's."""
    with _Vehicle(config_path, speed, {}) as vehicle:
        vehicle.first_datagram()
        bare = bare_ticker(seconds)
        vehicle.process.send_signal(signal.SIGTERM)
        said, _ = vehicle.process.communicate(timeout=_STOP_S)
    return said.strip().splitlines()[-1], bare


def bare_ticker(seconds: float) -> str:
    """Lateness of a loop that sleeps until every absolute deadline of 10 ms and does nothing."""
    late_s = []
    deadline = time.monotonic() + _PERIOD_S
    for _ in range(round(seconds / _PERIOD_S)):
        time.sleep(max(0.0, deadline - time.monotonic()))
        late_s.append(time.monotonic() - deadline)
        deadline += _PERIOD_S
    p50, p99, p999, worst = np.percentile(late_s, (50.0, 99.0, 99.9, 100.0)) * 1e3
    return f"a bare ticker, ms: p50 {p50:.2f}, p99 {p99:.2f}, p99.9 {p999:.2f}, max {worst:.2f}"


class _Vehicle:
    """The process, its client's socket, and their end."""

    def __init__(self, config_path: Path, speed: float, environment: Mapping[str, str]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(_FIRST_S)
        target = f"udpout://127.0.0.1:{self._socket.getsockname()[1]}"
        command = [sys.executable, "-m", "vehicle_sim", str(config_path), "--connect", target]
        options = ["--bind", "127.0.0.1:0", "--clock", "realtime", "--speed", str(speed)]
        self._began = time.monotonic()
        self.process = subprocess.Popen(
            command + options, stdout=subprocess.PIPE, text=True, env={**os.environ, **environment}
        )

    def __enter__(self) -> "_Vehicle":
        return self

    def __exit__(self, *_error: object) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        self.process.communicate(timeout=_STOP_S)
        self._socket.close()

    def first_datagram(self) -> tuple[float, float]:
        """Wait for it; wall and processor seconds since the start. Raises `LinkError`."""
        try:
            self._socket.recv(65535)
        except TimeoutError as error:
            raise LinkError(f"vehicle-sim said nothing within {_FIRST_S:g} s") from error
        fields = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        ticks = int(fields[11]) + int(fields[12])
        return time.monotonic() - self._began, ticks / os.sysconf("SC_CLK_TCK")
