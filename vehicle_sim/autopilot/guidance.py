"""Setpoints of the autonomous modes: Takeoff, Hold, Return, Land, and of Position mode flown by sticks.

Each is a task with `setpoint(estimate, dt)`, called at a fixed period (seconds); a new task starts from the estimate it is given.
Positions NED. Motion between places is speed- and acceleration-limited, so that the position controller is never given a step.
"""

from math import cos, hypot, isfinite, nan, radians, sin
from typing import NamedTuple, Protocol

from vehicle_sim.autopilot.glide import Glide
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.setpoints import NO_VECTOR, TrajectorySetpoint
from vehicle_sim.rotation import Vector, yaw_of
from vehicle_sim.sensors import Estimate

_DEAD_ZONE = 0.05


class Sticks(NamedTuple):
    """Stick positions, -1..1: forward, right, up, clockwise."""

    forward: float
    right: float
    up: float
    clockwise: float


class Task(Protocol):
    """What flies a mode."""

    finished: bool

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:
        """The setpoint for now."""
        ...


class HoldTask:
    """Stop, then stay; or go to a place and stay there."""

    def __init__(self, estimate: Estimate, parameters: ParameterStore, target: Vector | None, yaw_rad: float) -> None:
        self.finished = False
        self._parameters = parameters
        self._glide = Glide(estimate.position_ned_m, estimate.velocity_ned_mps, parameters)
        brake = self._glide.brake_point()
        given = target or NO_VECTOR
        self._target = (_given(given[0], brake[0]), _given(given[1], brake[1]), _given(given[2], brake[2]))
        self._yaw_rad = yaw_rad if isfinite(yaw_rad) else yaw_of(estimate.q_wb_wxyz)
        self.cruise_mps = parameters["MPC_XY_CRUISE"]

    def start_at(self, position_ned_m: Vector) -> None:
        """Glide from there, at rest."""
        self._glide = Glide(position_ned_m, (0.0, 0.0, 0.0), self._parameters)

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:  # noqa: ARG002
        """Glide to the target."""
        p = self._parameters
        self._glide.move(self._target, self.cruise_mps, p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"], dt_s)
        return TrajectorySetpoint(self._glide.position, self._glide.velocity, yaw_rad=self._yaw_rad)


class TakeoffTask:
    """Climb straight up to an altitude; finished within a hand's breadth of it."""

    def __init__(self, estimate: Estimate, parameters: ParameterStore, target_d_m: float) -> None:
        self.finished = False
        self._speed_mps = parameters["MPC_TKO_SPEED"]
        self._glide = Glide(estimate.position_ned_m, (0.0, 0.0, 0.0), parameters)
        x, y, z = estimate.position_ned_m
        self._target = (x, y, min(target_d_m, z))
        self._yaw_rad = yaw_of(estimate.q_wb_wxyz)

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:
        """Climb, waiting for a vehicle that has not left the ground yet."""
        if self._glide.position[2] > estimate.position_ned_m[2] - 1.0:
            self._glide.move(self._target, 1.0, self._speed_mps, self._speed_mps, dt_s)
        self.finished = abs(estimate.position_ned_m[2] - self._target[2]) < 0.15
        return TrajectorySetpoint(self._glide.position, self._glide.velocity, yaw_rad=self._yaw_rad)


class LandTask:
    """Stop, then sink: MPC_Z_V_AUTO_DN above MPC_LAND_ALT1, MPC_LAND_SPEED below MPC_LAND_ALT2, interpolated between."""

    def __init__(
        self,
        estimate: Estimate,
        parameters: ParameterStore,
        ground_d_m: float,
        place: tuple[float, float] | None = None,
    ) -> None:
        self.finished = False
        self._parameters = parameters
        self._ground_d_m = ground_d_m
        self._glide = Glide(estimate.position_ned_m, estimate.velocity_ned_mps, parameters)
        self._target = place or self._glide.brake_point()[:2]
        self._yaw_rad = yaw_of(estimate.q_wb_wxyz)

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:
        """Position held in x and y, velocity alone in z: the ground may be anywhere."""
        height_m = self._ground_d_m - estimate.position_ned_m[2]
        sink = self.sink_speed_mps(height_m)
        self._glide.move((*self._target, 1e6), self._parameters["MPC_XY_CRUISE"], sink, sink, dt_s)
        x, y, _ = self._glide.position
        return TrajectorySetpoint((x, y, nan), self._glide.velocity, yaw_rad=self._yaw_rad)

    def sink_speed_mps(self, height_m: float) -> float:
        """Speed at a height above the take-off place."""
        p = self._parameters
        slow, fast = p["MPC_LAND_SPEED"], max(p["MPC_LAND_SPEED"], p["MPC_Z_V_AUTO_DN"])
        low, high = p["MPC_LAND_ALT2"], max(p["MPC_LAND_ALT1"], p["MPC_LAND_ALT2"] + 0.1)
        share = max(0.0, min(1.0, (height_m - low) / (high - low)))
        return slow + share * (fast - slow)


class ReturnTask:
    """Climb to RTL_RETURN_ALT above home, go home, sink to RTL_DESCEND_ALT, wait RTL_LAND_DELAY there (-1: stay), land."""

    def __init__(self, estimate: Estimate, parameters: ParameterStore, home_ned_m: Vector) -> None:
        self.finished = False
        self.landing = False
        self._parameters = parameters
        self._home = home_ned_m
        x, y, z = estimate.position_ned_m
        near = hypot(x - home_ned_m[0], y - home_ned_m[1]) < parameters["RTL_MIN_DIST"]
        height = parameters["RTL_RETURN_ALT"]
        height = min(height, parameters["RTL_DESCEND_ALT"]) if near else height
        self._return_d_m = min(z, home_ned_m[2] - height)
        self._descend_d_m = max(self._return_d_m, home_ned_m[2] - parameters["RTL_DESCEND_ALT"])
        self._wait_s = parameters["RTL_LAND_DELAY"]
        self._task: Task = HoldTask(estimate, parameters, (nan, nan, self._return_d_m), nan)
        self._stage = "climb"

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:
        """Pass from stage to stage as each place is reached."""
        x, y, z = estimate.position_ned_m
        n, e, _ = self._home
        if self._stage == "climb" and z < self._return_d_m + 0.5:
            self._go("return", HoldTask(estimate, self._parameters, (n, e, self._return_d_m), nan))
        elif self._stage == "return" and hypot(x - n, y - e) < 0.3:
            self._go("descend", HoldTask(estimate, self._parameters, (n, e, self._descend_d_m), nan))
        elif self._stage == "descend" and z > self._descend_d_m - 0.5 and self._waited(dt_s):
            self.landing = True
            self._go("land", LandTask(estimate, self._parameters, self._home[2], (n, e)))
        return self._task.setpoint(estimate, dt_s)

    def _go(self, stage: str, task: Task) -> None:
        self._stage, self._task = stage, task

    def _waited(self, dt_s: float) -> bool:
        if self._parameters["RTL_LAND_DELAY"] < 0.0:
            return False
        self._wait_s -= dt_s
        return self._wait_s <= 0.0


class DescendTask:
    """Without a position: level, sinking at MPC_LAND_SPEED."""

    def __init__(self, estimate: Estimate, parameters: ParameterStore) -> None:
        self.finished = False
        self._sink_mps = parameters["MPC_LAND_SPEED"]
        self._yaw_rad = yaw_of(estimate.q_wb_wxyz)

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:  # noqa: ARG002
        """No horizontal velocity is asked for, since none is known."""
        return TrajectorySetpoint(NO_VECTOR, (nan, nan, self._sink_mps), (0.0, 0.0, nan), self._yaw_rad)


class StickTask:
    """Position mode: sticks ask for a velocity; let go, the vehicle stops and stays."""

    def __init__(self, estimate: Estimate, parameters: ParameterStore) -> None:
        self.finished = False
        self.sticks = Sticks(0.0, 0.0, 0.0, 0.0)
        self._parameters = parameters
        self._glide = Glide(estimate.position_ned_m, estimate.velocity_ned_mps, parameters)
        self._yaw_rad = yaw_of(estimate.q_wb_wxyz)

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:
        """Forward and right are the body's, level."""
        p = self._parameters
        forward, right, up, turn = (0.0 if abs(s) < _DEAD_ZONE else s for s in self.sticks)
        yaw = yaw_of(estimate.q_wb_wxyz)
        speed = p["MPC_VEL_MANUAL"]
        climb = up * (p["MPC_Z_VEL_MAX_UP"] if up > 0.0 else p["MPC_Z_VEL_MAX_DN"])
        c, s = cos(yaw), sin(yaw)
        wanted = (speed * (c * forward - s * right), speed * (s * forward + c * right), -climb)
        self._glide.drift(wanted, dt_s)
        self._yaw_rad += turn * radians(p["MPC_MAN_Y_MAX"]) * dt_s
        x, y, z = self._glide.position
        if z > estimate.position_ned_m[2] + 0.5:
            return TrajectorySetpoint((x, y, nan), self._glide.velocity, yaw_rad=self._yaw_rad)
        return TrajectorySetpoint((x, y, z), self._glide.velocity, yaw_rad=self._yaw_rad)


def _given(value: float, otherwise: float) -> float:
    return value if isfinite(value) else otherwise
