"""The autopilot: estimate in, rotor demand out, requests between. No I/O.

`update` is called once a physics step; inside it the rate loop runs every step, the attitude loop every second, the
position loop at 100 Hz, the commander at 50 Hz. NED/FRD, SI, time in seconds since boot.
"""

from dataclasses import replace
from enum import Enum
from math import isfinite, nan, radians

from vehicle_sim.autopilot.attitude_control import (
    AttitudeGains,
    RateController,
    RateGains,
    attitude_from_thrust,
    rate_setpoint,
)
from vehicle_sim.autopilot.commander import Commander, Links, Result, Severity
from vehicle_sim.autopilot.guidance import HoldTask, LandTask, ReturnTask, Sticks, StickTask, TakeoffTask, Task
from vehicle_sim.autopilot.landed import LandedDetector, LandedLimits
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.position_control import PositionController, PositionGains, PositionOutput, VelocityLimits
from vehicle_sim.autopilot.setpoints import (
    Refusal,
    SetpointMessage,
    TrajectorySetpoint,
    interpret_setpoint,
    is_flyable,
    wants_to_climb,
)
from vehicle_sim.rotation import Quaternion, Vector, quaternion_from_euler, rotate, yaw_of
from vehicle_sim.rotors import Demand
from vehicle_sim.sensors import Estimate

_IDLE = Demand(0.05, 0.0, 0.0, 0.0)
_OFF = Demand(0.0, 0.0, 0.0, 0.0)
_POSITION_S = 0.01
_COMMANDER_S = 0.02
_INVALID_GRACE_S = 0.2
_ACCELERATION_KEEP = 0.75
_STICK_TILT_RAD = radians(35.0)
_ALTITUDE_MODES = (Mode.ALTCTL, Mode.POSCTL)
_TILT_MODES = (Mode.MANUAL, Mode.STABILIZED)


class Phase(Enum):
    """From standing to flying."""

    DISARMED = "disarmed"
    SPOOLUP = "spool-up"
    READY = "ready for take-off"
    RAMPUP = "ramp-up"
    FLIGHT = "flight"


class Autopilot:
    """PX4-like flight stack of a quadcopter."""

    def __init__(self, parameters: ParameterStore, dt_s: float) -> None:
        self.parameters = parameters
        self.commander = Commander(parameters)
        self.links = Links()
        self.phase = Phase.DISARMED
        self.home_ned_m: Vector | None = None
        self.setpoint = TrajectorySetpoint()
        self.output = PositionOutput((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self.attitude_sp: Quaternion = (1.0, 0.0, 0.0, 0.0)
        self.rate_sp: Vector = (0.0, 0.0, 0.0)
        self.thrust_sp = 0.0
        self.demand = _OFF
        self._t_s = 0.0
        self._dt_s = dt_s
        self._step = 0
        self._position_every = max(1, round(_POSITION_S / dt_s))
        self._commander_every = max(1, round(_COMMANDER_S / dt_s))
        self._revision = -1
        self._position = PositionController(PositionGains.of(parameters))
        self._rate = RateController(RateGains.of(parameters), dt_s)
        self._detector = LandedDetector(LandedLimits.of(parameters))
        self._attitude_gains = AttitudeGains.of(parameters)
        self._read_parameters()
        self.task: Task | None = None
        self._task_mode: Mode | None = None
        self._offboard = TrajectorySetpoint()
        self._flyable = TrajectorySetpoint()
        self._flyable_s = 0.0
        self._yaw_rad = 0.0
        self._sticks = Sticks(0.0, 0.0, 0.0, 0.0)
        self._takeoff_d_m = nan
        self._phase_s = 0.0
        self._old_velocity: Vector | None = None
        self._acceleration: Vector = (0.0, 0.0, 0.0)

    @property
    def landed(self) -> bool:
        """The landed detector's verdict."""
        return self._detector.landed

    @property
    def acceleration_ned_mps2(self) -> Vector:
        """Low-passed derivative of the estimated velocity."""
        return self._acceleration

    def offboard_signal(self) -> bool:
        """A setpoint younger than COM_OF_LOSS_T has been heard."""
        return self._t_s - self.links.offboard_s <= self.parameters["COM_OF_LOSS_T"]

    def update(self, t_s: float, estimate: Estimate, battery_charge: float) -> Demand:
        """One step; returns what the rotors shall do."""
        self._t_s = t_s
        if self._step % self._commander_every == 0:
            self._command(estimate, battery_charge)
        if self.commander.armed and self.phase not in (Phase.DISARMED, Phase.SPOOLUP):
            if self._step % self._position_every == 0:
                self._steer(estimate)
        elif self._step % self._position_every == 0:
            self._stand(estimate)
        self._step += 1
        self.demand = self._stabilise(estimate)
        return self.demand

    def receive_setpoint(self, message: SetpointMessage, estimate: Estimate, complain: bool = True) -> bool:
        """SET_POSITION_TARGET_LOCAL_NED; true when it counts as proof of life."""
        setpoint = interpret_setpoint(message, estimate.q_wb_wxyz)
        if isinstance(setpoint, Refusal):
            if complain:
                self.commander.say(Severity.CRITICAL, setpoint.text)
            return False
        self._offboard = setpoint
        self.links = replace(self.links, offboard_s=self._t_s)
        return True

    def receive_sticks(self, sticks: Sticks) -> None:
        """MANUAL_CONTROL."""
        self._sticks = sticks
        self.links = replace(self.links, manual_s=self._t_s)

    def receive_gcs_heartbeat(self) -> None:
        """HEARTBEAT of a ground station."""
        self.links = replace(self.links, gcs_s=self._t_s)

    def request_mode(self, mode: Mode) -> Result:
        """DO_SET_MODE and the commands that imply one."""
        return self.commander.request_mode(mode, self._t_s, self.links)

    def request_takeoff(self, estimate: Estimate, altitude_d_m: float) -> Result:
        """NAV_TAKEOFF; NaN means MIS_TAKEOFF_ALT above where the vehicle stands."""
        result = self.request_mode(Mode.TAKEOFF)
        if result is Result.ACCEPTED:
            default = estimate.position_ned_m[2] - self.parameters["MIS_TAKEOFF_ALT"]
            self._takeoff_d_m = altitude_d_m if isfinite(altitude_d_m) else default
            self._task_mode = None
        return result

    def request_reposition(self, estimate: Estimate, target_ned_m: Vector, yaw_rad: float, speed_mps: float) -> Result:
        """DO_REPOSITION: Hold at a place; NaN keeps that axis."""
        result = self.request_mode(Mode.LOITER)
        if result is Result.ACCEPTED:
            task = HoldTask(estimate, self.parameters, target_ned_m, yaw_rad)
            if isfinite(speed_mps) and speed_mps > 0.0:
                task.cruise_mps = min(speed_mps, self.parameters["MPC_XY_VEL_MAX"])
            self.task, self._task_mode = task, Mode.LOITER
        return result

    def request_speed(self, speed_mps: float) -> Result:
        """DO_CHANGE_SPEED: the cruise speed of Hold on its way to a place."""
        if not (isfinite(speed_mps) and speed_mps > 0.0):
            return Result.DENIED
        if isinstance(self.task, HoldTask):
            self.task.cruise_mps = min(speed_mps, self.parameters["MPC_XY_VEL_MAX"])
        return Result.ACCEPTED

    def request_arm(self, force: bool = False) -> Result:
        """COMPONENT_ARM_DISARM with 1. Forcing skips nothing here: a vehicle that is not ready cannot fly."""
        del force
        return self.commander.arm(self._t_s, self.links)

    def request_disarm(self, force: bool = False) -> Result:
        """COMPONENT_ARM_DISARM with 0."""
        return self.commander.disarm(self._t_s, self.links, self.landed, force=force)

    def _read_parameters(self) -> None:
        parameters = self.parameters
        if self._revision == parameters.revision:
            return
        self._revision = parameters.revision
        self._position.gains = PositionGains.of(parameters)
        self._attitude_gains = AttitudeGains.of(parameters)
        self._rate.gains = RateGains.of(parameters)
        self._detector.limits = LandedLimits.of(parameters)

    def _command(self, estimate: Estimate, battery_charge: float) -> None:
        self._read_parameters()
        commander = self.commander
        was_armed = commander.armed
        commander.update(self._t_s, self.links, self.landed, battery_charge)
        if self.home_ned_m is None and commander.is_ready():
            self.home_ned_m = estimate.position_ned_m
        if commander.armed and self.phase is Phase.DISARMED:
            self.home_ned_m = estimate.position_ned_m
            self._yaw_rad = yaw_of(estimate.q_wb_wxyz)
            self._enter(Phase.SPOOLUP)
        elif not commander.armed and (was_armed or self.phase is not Phase.DISARMED):
            self._enter(Phase.DISARMED)
        if self.phase is Phase.SPOOLUP and self._t_s - self._phase_s >= self.parameters["COM_SPOOLUP_TIME"]:
            self._enter(Phase.READY)

    def _enter(self, phase: Phase) -> None:
        self.phase, self._phase_s = phase, self._t_s
        if phase is not Phase.FLIGHT:
            self._position.reset()
            self._rate.reset()
            self._task_mode = None

    def _stand(self, estimate: Estimate) -> None:
        self._track_acceleration(estimate)
        falling = self._t_s > 0.0 and not self.landed
        self._detector.update(
            estimate.position_ned_m,
            estimate.velocity_ned_mps,
            1.0 if falling else nan,
            0.0,
            self._dt_s * self._position_every,
        )
        self.setpoint = TrajectorySetpoint()
        self.thrust_sp = 0.0

    def _track_acceleration(self, estimate: Estimate) -> None:
        velocity, old = estimate.velocity_ned_mps, self._old_velocity or estimate.velocity_ned_mps
        period, k = self._dt_s * self._position_every, _ACCELERATION_KEEP
        a = self._acceleration
        self._acceleration = (
            k * a[0] + (1.0 - k) * (velocity[0] - old[0]) / period,
            k * a[1] + (1.0 - k) * (velocity[1] - old[1]) / period,
            k * a[2] + (1.0 - k) * (velocity[2] - old[2]) / period,
        )
        self._old_velocity = velocity

    def _steer(self, estimate: Estimate) -> None:
        """Guidance and position loop: sets attitude and thrust."""
        period = self._dt_s * self._position_every
        self._track_acceleration(estimate)
        setpoint = self._choose_setpoint(estimate, period)
        self.setpoint = setpoint
        if self.landed and self.phase is Phase.FLIGHT:
            self._enter(Phase.READY)
        if self.phase is Phase.READY and self._wants_takeoff(setpoint, estimate):
            self._enter(Phase.RAMPUP)
        if self.phase is Phase.READY or (self._detector.ground_contact and self.phase is Phase.FLIGHT):
            self._position.reset()
            self.attitude_sp, self.thrust_sp = quaternion_from_euler(0.0, 0.0, yaw_of(estimate.q_wb_wxyz)), 0.0
            self._watch_ground(estimate, setpoint.velocity_ned_mps[2], period)
            return
        if self.commander.flown_mode in _TILT_MODES:
            self._tilt_by_sticks()
        else:
            self._follow(setpoint, estimate, period)
        self._watch_ground(estimate, self.output.velocity_sp_mps[2], period)

    def _follow(self, setpoint: TrajectorySetpoint, estimate: Estimate, period: float) -> None:
        limits = self._velocity_limits()
        self.output = self._position.update(setpoint, estimate, self._acceleration, limits, period)
        self._yaw_rad = self._next_yaw(setpoint, period)
        self.attitude_sp, self.thrust_sp = attitude_from_thrust(self.output.thrust_ned, self._yaw_rad)
        if self.phase is Phase.RAMPUP:
            self._position.reset()

    def _velocity_limits(self) -> VelocityLimits:
        """In the ramp the upward speed allowed grows from one that gives no thrust (PX4's take-off ramp)."""
        p = self.parameters
        up = p["MPC_Z_VEL_MAX_UP"]
        if self.phase is Phase.RAMPUP:
            ramp_s = p["MPC_TKO_RAMP_T"]
            progress = (self._t_s - self._phase_s) / ramp_s if ramp_s > 0.0 else 1.0
            if progress >= 1.0:
                self._enter(Phase.FLIGHT)
            else:
                start = -9.80665 / p["MPC_Z_VEL_P_ACC"]
                up = start + progress * (min(up, p["MPC_TKO_SPEED"]) - start)
        return VelocityLimits(p["MPC_XY_VEL_MAX"], up, max(p["MPC_Z_VEL_MAX_DN"], -up))

    def _next_yaw(self, setpoint: TrajectorySetpoint, period: float) -> float:
        if isfinite(setpoint.yaw_rad):
            return setpoint.yaw_rad
        if isfinite(setpoint.yaw_rate_radps):
            return self._yaw_rad + setpoint.yaw_rate_radps * period
        return self._yaw_rad

    def _watch_ground(self, estimate: Estimate, asked_down_mps: float, period: float) -> None:
        was_landed = self.landed
        hover = self.parameters["MPC_THR_HOVER"]
        self._detector.update(
            estimate.position_ned_m, estimate.velocity_ned_mps, asked_down_mps, self.thrust_sp / hover, period
        )
        if was_landed != self.landed:
            self.commander.say(Severity.INFO, "Landing detected" if self.landed else "Takeoff detected")

    def _wants_takeoff(self, setpoint: TrajectorySetpoint, estimate: Estimate) -> bool:
        mode = self.commander.flown_mode
        if mode in (Mode.LAND, Mode.RTL, Mode.LOITER, Mode.TERMINATE):
            return False
        if mode in _TILT_MODES:
            return self._sticks.up > -0.8
        if mode in _ALTITUDE_MODES:
            return self._sticks.up > 0.3
        return wants_to_climb(setpoint, estimate.position_ned_m[2])

    def _choose_setpoint(self, estimate: Estimate, period: float) -> TrajectorySetpoint:
        mode = self.commander.flown_mode
        if mode is Mode.OFFBOARD:
            if self._task_mode is not mode:
                self.task, self._task_mode = None, mode
            return self._checked_offboard(estimate)
        if mode is not self._task_mode or self.task is None:
            self.task, self._task_mode = self._begin(mode, estimate), mode
        if isinstance(self.task, StickTask):
            self.task.sticks = self._sticks
        setpoint = self.task.setpoint(estimate, period)
        if mode is Mode.TAKEOFF and self.task.finished:
            self.request_mode(Mode.LOITER)
        return setpoint

    def _begin(self, mode: Mode, estimate: Estimate) -> Task:
        p, home = self.parameters, self.home_ned_m or (0.0, 0.0, 0.0)
        if mode is Mode.TAKEOFF:
            target = self._takeoff_d_m
            self._takeoff_d_m = nan
            default = estimate.position_ned_m[2] - p["MIS_TAKEOFF_ALT"]
            return TakeoffTask(estimate, p, target if isfinite(target) else default)
        if mode is Mode.LAND:
            return LandTask(estimate, p, home[2])
        if mode is Mode.RTL:
            return ReturnTask(estimate, p, home)
        if mode in _ALTITUDE_MODES:
            return StickTask(estimate, p)
        return HoldTask(estimate, p, None, nan)

    def _checked_offboard(self, estimate: Estimate) -> TrajectorySetpoint:
        """Row 3: a setpoint that cannot be flown is bridged for 200 ms by the last one that can, then the vehicle stops."""
        if is_flyable(self._offboard):
            self._flyable, self._flyable_s = self._offboard, self._t_s
            self.task = None
        elif self._t_s - self._flyable_s > _INVALID_GRACE_S:
            if self.task is None:
                self.task = HoldTask(estimate, self.parameters, None, nan)
            return self.task.setpoint(estimate, self._dt_s * self._position_every)
        return self._flyable

    def _tilt_by_sticks(self) -> None:
        """Stabilized: sticks ask for tilt and thrust (half up is hover)."""
        sticks = self._sticks
        self._yaw_rad += (
            sticks.clockwise * radians(self.parameters["MPC_MAN_Y_MAX"]) * self._dt_s * self._position_every
        )
        throttle = (sticks.up + 1.0) / 2.0
        hover = self.parameters["MPC_THR_HOVER"]
        size = 2.0 * throttle * hover if throttle < 0.5 else hover + (2.0 * throttle - 1.0) * (1.0 - hover)
        roll, pitch = sticks.right * _STICK_TILT_RAD, -sticks.forward * _STICK_TILT_RAD
        self.attitude_sp = quaternion_from_euler(roll, pitch, self._yaw_rad)
        thrust = rotate(self.attitude_sp, (0.0, 0.0, -size))
        self.thrust_sp = size
        self.output = PositionOutput(thrust, (nan, nan, nan), (nan, nan, nan))
        if self.phase is Phase.RAMPUP:
            self._enter(Phase.FLIGHT)

    def _stabilise(self, estimate: Estimate) -> Demand:
        """Attitude and rate loops."""
        if self.phase is Phase.DISARMED or self.commander.flown_mode is Mode.TERMINATE:
            return _OFF
        if self.phase in (Phase.SPOOLUP, Phase.READY) or (self._detector.ground_contact and self.thrust_sp == 0.0):
            return _IDLE
        if self._step % 2 == 0:
            yaw_rate = self.setpoint.yaw_rate_radps
            feed = yaw_rate if isfinite(yaw_rate) else 0.0
            self.rate_sp = rate_setpoint(estimate.q_wb_wxyz, self.attitude_sp, feed, self._attitude_gains)
        x, y, z = self._rate.update(self.rate_sp, estimate.omega_wb_b_radps)
        return Demand(self.thrust_sp, x, y, z)
