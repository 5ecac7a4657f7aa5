"""RotorPy (pip install rotorpy) flying the same reference, run by the interpreter of an environment that has it.

Its `Environment.run` flies its own quadrotor, SE(3) controller, IMU and motion capture at its default 100 Hz, truth in
the loop. It has no messages, no second process, no MPC and no log file, so it does less than the loop beside it.
"""

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from sandwich_sitl.planning.flight_plan import Reference

_TIMEOUT_S = 300.0

PROGRAM = """
import sys, time
import numpy as np
from scipy.interpolate import make_interp_spline
from rotorpy.environments import Environment
from rotorpy.vehicles.multirotor import Multirotor
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.world import World

HZ, seconds = 100, float(sys.argv[2])
data = np.load(sys.argv[1])
spline = make_interp_spline(data["t_s"], data["xyz_m"], k=5)
t = np.arange(0.0, seconds + 1.0, 1.0 / HZ)
table = [spline.derivative(d)(t) if d else spline(t) for d in range(5)]

class Path:
    def update(self, now):
        k = min(int(round(now * HZ)), len(t) - 1)
        flat = dict(zip(("x", "x_dot", "x_ddot", "x_dddot", "x_ddddot"), (row[k] for row in table)))
        return {**flat, "yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0}

vehicle = Multirotor(quad_params)
vehicle.initial_state = {**vehicle.initial_state, "x": table[0][0].copy()}
world = World.empty((-1e4, 1e4, -1e4, 1e4, -1e4, 1e4))
flight = Environment(vehicle, SE3Control(quad_params), Path(), world=world, sim_rate=HZ)
begin, begin_cpu = time.perf_counter(), time.process_time()
flown = flight.run(t_final=seconds)
wall, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
off = np.linalg.norm(flown["state"]["x"] - flown["flat"]["x"], axis=1).max()
print(f"{flown['time'][-1] / wall:.2f} {flown['time'][-1] / cpu:.2f} {flown['time'][-1]:.1f} {off:.3f}")
"""


def interpreter(given: str | None) -> str | None:
    """The Python that has RotorPy: the given one, this one, or that of `tools/install_clients.sh`; None without."""
    if given is not None:
        return given
    if find_spec("rotorpy") is not None:
        return sys.executable
    clients = Path(os.environ.get("SITL_CLIENTS", ".clients")) / "rotorpy" / "bin" / "python"
    return str(clients) if clients.exists() else None


def fly_rotorpy(python: str | None, reference: Reference, seconds: float) -> str:
    """One line: RotorPy's factor on the first `seconds` of the reference, or why there is none."""
    if python is None:
        return "RotorPy: not installed here (tools/install_clients.sh); give --rotorpy PYTHON"
    with tempfile.TemporaryDirectory() as work:
        path = Path(work) / "reference.npz"
        np.savez(path, t_s=reference.t_s, xyz_m=reference.xyz_m)
        flown_s = min(seconds, float(reference.t_s[-1]))
        try:
            done = subprocess.run(
                [python, "-c", PROGRAM, str(path), str(flown_s)],
                capture_output=True,
                text=True,
                timeout=_TIMEOUT_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"RotorPy: not measured ({error})"
    if done.returncode != 0 or not done.stdout.strip():
        return f"RotorPy: not measured ({(done.stderr.strip().splitlines() or ['it said nothing'])[-1]})"
    wall, cpu, length_s, off_m = map(float, done.stdout.split())
    return (
        f"RotorPy, the first {length_s:.0f} s of the same reference at 100 Hz, one process, no messages, MPC or log: "
        f"{wall:.1f} x real time, {cpu:.1f} by processor time; at most {off_m:.2f} m off"
    )
