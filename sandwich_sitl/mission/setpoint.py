"""`Setpoint`: what the vehicle is asked to do now. ENU of the world, metres, z up; yaw counter-clockwise from east."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """Position (3,), velocity (3,), acceleration (3,); a vector that is None is left to the autopilot."""

    r_m: Vector | None
    v_mps: Vector | None
    a_mps2: Vector | None
    yaw_rad: float
