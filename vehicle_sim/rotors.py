"""Four rotors in X layout: thrust and torque, first-order speed lag, mixing and its inverse.

Input: rotor speeds omega_i (rad/s, >= 0). Output: wrench (thrust N along -z body, torques N m about forward, right, down).

    T_i = k omega_i^2      tau_x = -sum y_i T_i      tau_y = sum x_i T_i      tau_z = sum s_i c T_i
    d omega_i / dt = (omega_cmd,i - omega_i) / time_constant

Order as PX4: 1 front right, 2 rear left (both counter-clockwise seen from above, so the body is pushed clockwise, s = +1),
3 front left, 4 rear right (s = -1).
"""

from math import sqrt
from typing import NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.parts import AirframeConfig

Four = tuple[float, float, float, float]


class Wrench(NamedTuple):
    """Thrust (N, along -z body) and torques (N m about forward, right, down)."""

    thrust_n: float
    roll_nm: float
    pitch_nm: float
    yaw_nm: float


class Demand(NamedTuple):
    """What the rate controller asks, normalised: thrust 0..1 of full, torques -1..1 of the torque of full differential thrust."""

    thrust: float
    roll: float
    pitch: float
    yaw: float


class RotorModel(NamedTuple):
    """Numbers of the four rotors, taken from the airframe once. `max_speed_radps` is that of full thrust and full voltage."""

    thrust_coefficient: float
    lever_m: float
    torque_coefficient_m: float
    max_speed_radps: float
    time_constant_s: float

    @classmethod
    def of(cls, airframe: AirframeConfig) -> "RotorModel":
        """`lever_m` is the distance of each motor from the roll and the pitch axis: arm / sqrt(2)."""
        return cls(
            airframe.thrust_coefficient_n_per_radps2,
            airframe.arm_m * sqrt(0.5),
            airframe.torque_coefficient_m,
            sqrt(airframe.max_thrust_n / airframe.thrust_coefficient_n_per_radps2),
            airframe.motor_time_constant_s,
        )


@inlined
def rotor_wrench(speeds_radps: Four, rotors: RotorModel) -> Wrench:
    """Thrust and torque of the rotors at these speeds."""
    a, b, c, d = speeds_radps
    k = rotors.thrust_coefficient
    t1, t2, t3, t4 = k * a * a, k * b * b, k * c * c, k * d * d
    lever = rotors.lever_m
    return Wrench(
        t1 + t2 + t3 + t4,
        lever * (t2 + t3 - t1 - t4),
        lever * (t1 + t3 - t2 - t4),
        rotors.torque_coefficient_m * (t1 + t2 - t3 - t4),
    )


@inlined
def speed_targets(fractions: Four, top_radps: float, limit_radps: float) -> Four:
    """Speeds that give these fractions of full thrust, none above the limit that the battery's voltage sets."""
    a, b, c, d = fractions
    return (
        min(limit_radps, top_radps * sqrt(a)),
        min(limit_radps, top_radps * sqrt(b)),
        min(limit_radps, top_radps * sqrt(c)),
        min(limit_radps, top_radps * sqrt(d)),
    )


@inlined
def lag_speeds(speeds_radps: Four, targets_radps: Four, keep_up: float, keep_down: float) -> Four:
    """One step of the first-order lag, exact for constant targets: keep = exp(-dt / time_constant), apart for up and down."""
    a, b, c, d = speeds_radps
    ta, tb, tc, td = targets_radps
    return (
        ta + (a - ta) * (keep_up if ta > a else keep_down),
        tb + (b - tb) * (keep_up if tb > b else keep_down),
        tc + (c - tc) * (keep_up if tc > c else keep_down),
        td + (d - td) * (keep_up if td > d else keep_down),
    )


@inlined
def mix(demand: Demand) -> Four:
    """Fractions 0..1 of full thrust for the four rotors.

    Where not everything fits, thrust gives way first, then yaw, and roll and pitch last (both by one factor).
    """
    thrust, roll, pitch, yaw = demand
    a, b, c, d = pitch - roll, roll - pitch, roll + pitch, -roll - pitch
    spread = max(a, b, c, d) - min(a, b, c, d)
    if spread > 1.0:
        a, b, c, d = a / spread, b / spread, c / spread, d / spread
        yaw = 0.0
    else:
        room = _yaw_room(a, b, c, d)
        yaw = max(-room, min(room, yaw))
    a, b, c, d = a + yaw, b + yaw, c - yaw, d - yaw
    low, high = -min(a, b, c, d), 1.0 - max(a, b, c, d)
    thrust = max(low, min(high, thrust))
    return (_unit(thrust + a), _unit(thrust + b), _unit(thrust + c), _unit(thrust + d))


def unmix(fractions: Four) -> Demand:
    """The demand that these fractions fulfil: inverse of `mix` inside the limits."""
    a, b, c, d = fractions
    return Demand((a + b + c + d) / 4, (b + c - a - d) / 4, (a + c - b - d) / 4, (a + b - c - d) / 4)


@inlined
def _yaw_room(a: float, b: float, c: float, d: float) -> float:
    """Largest |yaw| that keeps the spread of (a + yaw, b + yaw, c - yaw, d - yaw) within 1, for either sign.

    Of two rotors of one group the spread does not change, of one of each it grows by at most 2 |yaw|.
    """
    across = max(max(a, b) - min(c, d), max(c, d) - min(a, b))
    return max(0.0, (1.0 - across) / 2)


@inlined
def _unit(value: float) -> float:
    return 0.0 if value < 0.0 else 1.0 if value > 1.0 else value
