"""Several vehicles from one command: one process each, so that each has a core and a clock of its own."""

import signal
import subprocess
import sys
from pathlib import Path
from types import FrameType

_STOP_S = 10.0


def run_fleet(arguments: list[str], count: int, log: Path | None) -> int:
    """Start instances 0 to count - 1 with the same options, pass signals on, wait for all. The first failure is the exit status.

    A log gets the instance's number: `flight.mcap` becomes `flight.0.mcap`, `flight.1.mcap`.
    """
    vehicles: list[subprocess.Popen[bytes]] = []

    def pass_on(number: int, _frame: FrameType | None) -> None:
        for vehicle in vehicles:
            if vehicle.poll() is None:
                vehicle.send_signal(number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2):
        signal.signal(number, pass_on)
    for instance in range(count):
        own = ["--count", "1", "--instance", str(instance)]
        if log is not None:
            own += ["--log", str(log.with_suffix(f".{instance}{log.suffix}"))]
        vehicles.append(subprocess.Popen([sys.executable, "-m", "vehicle_sim", *arguments, *own]))
    try:
        return next((status for status in [vehicle.wait() for vehicle in vehicles] if status != 0), 0)
    finally:
        for vehicle in vehicles:
            if vehicle.poll() is None:
                vehicle.terminate()
                vehicle.wait(_STOP_S)
