"""A point on its way to a place, limited in speed and acceleration: what the position controller of autonomous modes follows. NED."""

from math import hypot, sqrt

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.rotation import Vector

_APPROACH_PER_S = 1.2


def approach_speed(distance_m: float, speed_mps: float, deceleration_mps2: float) -> float:
    """Speed from which the vehicle can still stop in the distance: linear close by, sqrt(2 a d) further away."""
    linear_m = deceleration_mps2 / _APPROACH_PER_S**2
    if distance_m <= linear_m:
        return min(speed_mps, _APPROACH_PER_S * distance_m)
    return min(speed_mps, sqrt(2.0 * deceleration_mps2 * (distance_m - linear_m / 2.0)))


class Glide:
    """A point that moves to a target within speed and acceleration limits; horizontal and vertical apart."""

    def __init__(self, position: Vector, velocity: Vector, parameters: ParameterStore) -> None:
        self.position = position
        self.velocity = velocity
        self._a_xy = parameters["MPC_ACC_HOR"]
        self._a_z = min(parameters["MPC_ACC_UP_MAX"], parameters["MPC_ACC_DOWN_MAX"])

    def brake_point(self) -> Vector:
        """Where the point would stop."""
        vx, vy, vz = self.velocity
        speed = hypot(vx, vy)
        run = speed / (2.0 * self._a_xy) + 1.0 / (2.0 * _APPROACH_PER_S)
        return (
            self.position[0] + vx * run,
            self.position[1] + vy * run,
            self.position[2] + vz * (abs(vz) / (2.0 * self._a_z) + 1.0 / (2.0 * _APPROACH_PER_S)),
        )

    def move(self, target: Vector, xy_mps: float, up_mps: float, down_mps: float, dt_s: float) -> None:
        """Advance by `dt_s`."""
        dx, dy, dz = (target[i] - self.position[i] for i in range(3))
        distance = hypot(dx, dy)
        speed = approach_speed(distance, xy_mps, self._a_xy)
        share = speed / distance if distance > 1e-9 else 0.0
        vx, vy = _slew((self.velocity[0], self.velocity[1]), (dx * share, dy * share), self._a_xy * dt_s)
        climb = approach_speed(abs(dz), up_mps if dz < 0.0 else down_mps, self._a_z)
        self._settle(vx, vy, climb if dz > 0.0 else -climb, dt_s)

    def drift(self, velocity: Vector, dt_s: float) -> None:
        """Advance by `dt_s` towards a wanted velocity."""
        vx, vy = _slew((self.velocity[0], self.velocity[1]), (velocity[0], velocity[1]), self._a_xy * dt_s)
        self._settle(vx, vy, velocity[2], dt_s)

    def _settle(self, vx: float, vy: float, vz: float, dt_s: float) -> None:
        change = self._a_z * dt_s
        vz = max(self.velocity[2] - change, min(self.velocity[2] + change, vz))
        self.velocity = (vx, vy, vz)
        self.position = (self.position[0] + vx * dt_s, self.position[1] + vy * dt_s, self.position[2] + vz * dt_s)


def _slew(now: tuple[float, float], wanted: tuple[float, float], change: float) -> tuple[float, float]:
    dx, dy = wanted[0] - now[0], wanted[1] - now[1]
    size = hypot(dx, dy)
    if size <= change:
        return wanted
    return (now[0] + dx * change / size, now[1] + dy * change / size)
