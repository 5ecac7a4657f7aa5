"""The vehicle's speed alone, and beside it RotorPy's on an equal flight (same airframe class, 100 Hz and 400 Hz, no telemetry).

    python tools/bench_vehicle.py [--seconds 60] [--rotorpy PYTHON]

RotorPy is run by the interpreter of an environment that has it (`pip install rotorpy`); without one it is left out with the reason.
"""

import argparse
import math
import shutil
import subprocess
import sys
from importlib.util import find_spec

from vehicle_sim.bench import describe, run_bench

PEER = """
import time
import numpy as np
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.trajectories.circular_traj import ThreeDCircularTraj

for hz in (100, 400):
    vehicle, control = Multirotor(quad_params), SE3Control(quad_params)
    flat, turns_hz = np.array([1.0, 1.0, 0.0]), 3.0 / 9.0 / (2 * np.pi)
    path = ThreeDCircularTraj(center=np.array([0, 0, 3.0]), radius=9.0 * flat, freq=turns_hz * flat)
    state, dt, seconds = dict(vehicle.initial_state), 1.0 / hz, 4.0
    state["x"] = path.update(0.0)["x"]
    begin = time.perf_counter()
    for k in range(int(seconds * hz)):
        state = vehicle.step(state, control.update(k * dt, state, path.update(k * dt)), dt)
    wall = time.perf_counter() - begin
    print(f"RotorPy {hz} Hz: {seconds / wall:.1f} x real time, {wall / seconds / hz * 1e6:.0f} us a step")
"""


def main() -> int:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=_seconds, default=60.0, help="simulated seconds of flight")
    parser.add_argument("--rotorpy", metavar="PYTHON", help="interpreter of an environment with RotorPy")
    arguments = parser.parse_args()
    if arguments.rotorpy is not None and shutil.which(arguments.rotorpy) is None:
        parser.error(f"--rotorpy {arguments.rotorpy}: is not a program; give the path of a Python interpreter")
    print(describe(run_bench(arguments.seconds)))
    peer = arguments.rotorpy or (sys.executable if find_spec("rotorpy") else None)
    if peer is None:
        print("RotorPy: not installed here; give --rotorpy PYTHON")
        return 0
    done = subprocess.run([peer, "-c", PEER], capture_output=True, text=True, timeout=300, check=False)
    print(done.stdout.strip() or f"RotorPy could not be run: {done.stderr.strip().splitlines()[-1:]}")
    return 0


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 1.0 <= seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text} must be at least 1")
    return seconds


if __name__ == "__main__":
    sys.exit(main())
