"""The numbers that the flight kernel reads and writes, as two records of doubles. NED/FRD, SI.

`FLIGHT` changes at every step; `CONSTANTS` when a parameter or a failure changes. One record each, so that a call of the kernel passes
two pointers; Python reads and writes the same memory through the views of `Fields`.
"""

from enum import IntEnum
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.compiled import inlined
from vehicle_sim.dynamics import State
from vehicle_sim.rotation import Quaternion, Vector
from vehicle_sim.rotors import RotorModel

Array = NDArray[np.float64]


class Engaged(IntEnum):
    """The outermost control loop that runs; those inside it run too."""

    OFF = 0
    IDLE = 1
    RATE = 2
    ATTITUDE = 3
    POSITION = 4


_FLIGHT = [
    ("step", "i8"),
    # what the autopilot asks for, written as one block: the loop to enter at, flags, tangent of the largest tilt, setpoint (position,
    # velocity, acceleration, yaw, yaw rate), speed limits (horizontal, up, down)
    ("engaged", "i8"),
    ("hold_integral", "i8"),  # of velocity, during the take-off ramp
    ("landed", "i8"),
    ("tilt_tangent", "f8"),
    ("setpoint", "f8", 11),
    ("speed_limits", "f8", 3),
    # the same for the loops inside
    ("attitude_sp", "f8", 4),
    ("rates_ff", "f8", 3),
    ("rate_sp", "f8", 3),
    ("thrust_sp", "f8"),
    # truth: State, rotor speeds, the wrench they made, wind and its gust
    ("x", "f8", 13),
    ("before", "f8", 13),
    ("rotors", "f8", 4),
    ("fractions", "f8", 4),
    ("wind", "f8", 3),
    ("gust", "f8", 3),
    ("dryden", "f8", 5),  # u; p, q of v; p, q of w
    ("battery", "f8", 4),  # charge, V, A, Ah
    # what is believed: layout of State; its errors (position, velocity, attitude)
    ("estimate", "f8", 13),
    ("error", "f8", 9),
    ("gyro_bias", "f8", 3),  # biases as the estimator believes them
    ("down_bias", "f8"),  # of the accelerometer
    ("last_fix", "i8"),  # tick in which GPS was last heard
    ("innovation", "f8", 8),  # last ones: GPS position and velocity, height by the barometer (m), heading (rad)
    # slow wander of GPS position and of the barometer's height; by tick: fixes under way, what was believed; the sensors' last sample:
    # specific force, rates, field, pressure, GPS position and velocity
    ("wander", "f8", 4),
    ("gps_line", "f8", (16, 6)),
    ("history", "f8", (16, 6)),
    ("readings", "f8", 16),
    ("velocity_sp", "f8", 3),
    ("acceleration_sp", "f8", 3),
    ("thrust_ned", "f8", 3),
    ("demand", "f8", 4),
    # memory of the controllers
    ("acceleration", "f8", 3),
    ("old_velocity", "f8", 3),
    ("velocity_integral", "f8", 3),
    ("rate_integral", "f8", 3),
    ("smooth_rates", "f8", 3),
]

_CONSTANTS = [
    ("dt_s", "f8"),
    ("slow_s", "f8"),
    ("slow_every", "i8"),
    ("readings_every", "i8"),
    ("attitude_every", "i8"),
    # body: mass, moments, linear drag, quadratic drag; rotors: RotorModel; share of speed each motor still gives
    ("mass", "f8"),
    ("inertia", "f8", 3),
    ("linear_drag", "f8", 3),
    ("quadratic_drag", "f8"),
    ("rotor", "f8", 5),
    ("lag_keep_up", "f8"),
    ("lag_keep_down", "f8"),
    ("rotor_drag", "f8"),
    ("motor_health", "f8", 4),
    ("sensors_lost", "i8"),  # bits: magnetometer 1, barometer 2, GPS 4
    # wind: mean, share kept of a gust, kick
    ("wind_mean", "f8", 3),
    ("discrete_gust", "f8", 3),
    ("w20", "f8"),
    ("gust_keep", "f8"),
    ("gust_kick", "f8", 3),
    # errors of the estimate: share kept, kicks of position, velocity, attitude
    ("error_keep", "f8"),
    ("error_kick", "f8", 3),
    # the estimator: on; sensors: biases of gyroscope, accelerometer and magnetometer, GPS fixes a tick and their delay in ticks, share of
    # wander kept and its kicks
    ("filter", "i8"),
    ("gyro_bias", "f8", 3),
    ("accel_bias", "f8", 3),
    ("field_bias", "f8", 3),
    ("fixes_per_tick", "f8"),
    ("gps_delay", "i8"),
    ("wander_keep", "f8"),
    ("wander_kick", "f8", 4),
    # white noise: accelerometer, gyroscope, magnetometer, barometer, GPS horizontal, vertical, speed; ground altitude
    ("sensor_std", "f8", 7),
    ("ground_altitude", "f8"),
    # battery: cells, capacity, resistance, base current, efficiency
    ("pack", "f8", 5),
    # control
    ("position_gains", "f8", 13),
    ("attitude_gains", "f8", 7),
    ("rate_p", "f8", 3),
    ("rate_i", "f8", 3),
    ("rate_d", "f8", 3),
    ("rate_ff", "f8", 3),
    ("rate_integral_limit", "f8", 3),
    ("rate_keep", "f8"),
]


#: Records, so that the kernel also runs as plain Python (its test against itself compiled).
FLIGHT = np.dtype((np.record, _FLIGHT))
CONSTANTS = np.dtype((np.record, _CONSTANTS))


class Fields:
    """Views of one record by name: `fields.x` is an array, `fields.get("step")` and `fields.put("step", 1)` a number."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self.record: NDArray[Any] = np.zeros(1, dtype)
        self._views: dict[str, Array] = {name: self.record[name][0] for name in dtype.names or () if dtype[name].shape}

    def __getattr__(self, name: str) -> Array:
        try:
            return self._views[name]
        except KeyError as error:
            raise AttributeError(name) from error

    def block(self, first: str, last: str) -> "Block":
        """A run of fields that is written in one go."""
        return Block(self.record, first, last)

    def get(self, name: str) -> float:
        """A scalar field."""
        return float(self.record[name][0])

    def put(self, name: str, value: float) -> None:
        """Set a scalar field, or all of an array field from a sequence."""
        self.record[name][0] = value


class Block:
    """Consecutive fields of a record, from `first` to `last`, written together: a tenth of the cost of one after another."""

    def __init__(self, record: NDArray[Any], first: str, last: str) -> None:
        names = list(record.dtype.names or ())
        kinds = [record.dtype[name] for name in names[names.index(first) : names.index(last) + 1]]
        codes = ("q" if kind.base.kind == "i" else "d" for kind in kinds)
        counts = (int(np.prod(kind.shape)) for kind in kinds)
        self._layout = Struct("=" + "".join(f"{count}{code}" for count, code in zip(counts, codes, strict=True)))
        self._buffer: Any = record.view(np.uint8)
        fields: dict[str, Any] = dict(record.dtype.fields or {})
        self._offset = int(fields[first][1])

    def write(self, *values: float) -> None:
        """All elements of all fields, in order."""
        self._layout.pack_into(self._buffer, self._offset, *values)


@inlined
def three(a: Any, at: int = 0) -> Vector:
    """Three elements as a tuple."""
    return (a[at], a[at + 1], a[at + 2])


@inlined
def four(a: Any, at: int = 0) -> Quaternion:
    """Four elements as a tuple."""
    return (a[at], a[at + 1], a[at + 2], a[at + 3])


@inlined
def state_of(a: Any) -> State:
    """Thirteen elements as a state."""
    return State(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12])


@inlined
def put(a: Any, values: Any, at: int = 0) -> None:
    """Write a tuple into an array."""
    for i in range(len(values)):
        a[at + i] = values[i]


@inlined
def rotor_model(c: Any) -> RotorModel:
    """The rotors of `CONSTANTS`."""
    return RotorModel(c.rotor[0], c.rotor[1], c.rotor[2], c.rotor[3], c.rotor[4])
