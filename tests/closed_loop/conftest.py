"""Real processes over real UDP sockets: the command line as a user calls it, on free ports."""

import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

SHORT = """
name: short
seed: 3
world:
  bounds_m: [0, 0, 40, 24]
  obstacles:
    - {name: crate, polygon_m: [[17, 8], [23, 8], [23, 15], [17, 15]]}
start_m: [5, 11]
goal_m: [35, 12]
altitude_m: 4
planner: {vehicle_radius_m: 0.4, margin_m: 0.6, cell_m: 1.0, speed_mps: 3.0, acceleration_mps2: 2.0}
link: {uri: "udpin://127.0.0.1:0"}
zenoh: {enabled: false}
vehicle: {sensors: {estimator: error_model}}
"""


def free_port() -> int:
    """A UDP port nobody had a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Process:
    """A child process whose output lines can be waited for."""

    def __init__(self, module: str, *arguments: str) -> None:
        self.child = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        self.lines: list[str] = []
        self._queue: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.child.stdout is not None
        for line in self.child.stdout:
            self._queue.put(line.rstrip("\n"))
        self._queue.put(None)

    def wait_for(self, text: str, timeout_s: float = 60.0) -> str:
        """The next line with `text`; fails when the output ends or time runs out."""
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                line = self._queue.get(timeout=max(0.01, deadline - time.monotonic()))
            except queue.Empty:
                pytest.fail(f"no line with {text!r} within {timeout_s} s; got {self.lines}")
            if line is None:
                pytest.fail(f"the process ended without a line with {text!r}; got {self.lines}")
            self.lines.append(line)
            if text in line:
                return line

    def finish(self, timeout_s: float = 90.0) -> int:
        """Exit status; the remaining lines are in `lines`."""
        status = self.child.wait(timeout_s)
        self._reader.join(10)
        while not self._queue.empty():
            line = self._queue.get()
            if line is not None:
                self.lines.append(line)
        return status

    def kill(self) -> None:
        """SIGKILL."""
        self.child.send_signal(signal.SIGKILL)
        self.child.wait(10)

    def close(self) -> None:
        """End it, whatever state it is in."""
        if self.child.poll() is None:
            self.child.kill()
        self.child.wait(10)
        self._reader.join(10)
        assert self.child.stdout is not None
        self.child.stdout.close()


@pytest.fixture
def start() -> Iterator[Callable[..., Process]]:
    """Start processes that end with the test."""
    started: list[Process] = []

    def begin(module: str, *arguments: str) -> Process:
        process = Process(module, *arguments)
        started.append(process)
        return process

    yield begin
    for process in started:
        process.close()


@pytest.fixture(scope="session")
def short_config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of about half a minute round one obstacle."""
    path = tmp_path_factory.mktemp("config") / "short.yaml"
    path.write_text(SHORT, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def flown(short_config: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of one finished lockstep run of `short_config`."""
    out = tmp_path_factory.mktemp("flown")
    done = subprocess.run(
        [sys.executable, "-m", "sandwich_sitl.cli", "run", str(short_config), "--out", str(out)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return out
