"""The autopilot outside its control loops: requests in, what the loops are to follow out. No I/O.

`tick` is called at 100 Hz; the loops themselves (position, attitude, rates) run in the flight kernel on the same memory. NED/FRD, SI, time
in seconds since boot.
"""

from enum import Enum
from math import nan, radians, tan

from vehicle_sim.autopilot.gains import write_gains
from vehicle_sim.autopilot.geofence import Zone, is_outside
from vehicle_sim.autopilot.landed import LandedLimits
from vehicle_sim.autopilot.mission import MissionTask
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.requests import Requests
from vehicle_sim.autopilot.results import Severity
from vehicle_sim.autopilot.setpoints import TrajectorySetpoint
from vehicle_sim.autopilot.steering import Steer
from vehicle_sim.memory import Engaged, Fields
from vehicle_sim.rotation import Vector, quaternion_from_euler, yaw_of
from vehicle_sim.sensors import Estimate

_GRAVITY = 9.80665
_TILT_SLEW_RADPS = 1.0
_NOTHING = TrajectorySetpoint()


class Phase(Enum):
    """From standing to flying."""

    DISARMED = "disarmed"
    SPOOLUP = "spool-up"
    READY = "ready for take-off"
    RAMPUP = "ramp-up"
    FLIGHT = "flight"


class Autopilot(Requests):
    """PX4-like flight stack of a quadcopter. `flight` and `constants` are the kernel's memory."""

    def __init__(self, parameters: ParameterStore, flight: Fields, constants: Fields) -> None:
        super().__init__(parameters, constants.get("slow_s"))
        self.phase = Phase.DISARMED
        self.setpoint = _NOTHING
        self._flight, self._constants = flight, constants
        self._orders = flight.block("engaged", "speed_limits")
        self._period_s = constants.get("slow_s")
        self.zones: tuple[Zone, ...] = ()
        self._ticks = 0
        self._revision = -1
        self._phase_s = 0.0
        self._tilt_rad = radians(parameters["MPC_TILTMAX_LND"])
        self._read_parameters()

    @property
    def home_ned_m(self) -> Vector | None:
        """Where Return goes; None before the first position."""
        return self.steering.home_ned_m

    @home_ned_m.setter
    def home_ned_m(self, home: Vector) -> None:
        self.steering.home_ned_m = home

    def tick(self, t_s: float, estimate: Estimate, battery_charge: float) -> None:
        """One period: decide, choose, hand over to the loops."""
        self._t_s = t_s
        if self._ticks % 2 == 0:
            self._command(estimate, battery_charge)
        self._ticks += 1
        if self.phase in (Phase.DISARMED, Phase.SPOOLUP):
            self._stand(estimate)
        else:
            self._steer(estimate)

    def _read_parameters(self) -> None:
        if self._revision != self.parameters.revision:
            self._revision = self.parameters.revision
            write_gains(self.parameters, self._constants)
            self._detector.limits = LandedLimits.of(self.parameters)

    def _command(self, estimate: Estimate, battery_charge: float) -> None:
        self._read_parameters()
        commander = self.commander
        was_armed = commander.armed
        health = commander.health
        health.battery = battery_charge
        health.geofence_broken = self.home_ned_m is not None and is_outside(
            estimate.position_ned_m, self.home_ned_m, self.zones, self.parameters
        )
        self._refresh_health()
        commander.update(self._t_s, self.links)
        if self.home_ned_m is None and commander.is_ready():
            self.home_ned_m = estimate.position_ned_m
        if commander.armed and self.phase is Phase.DISARMED:
            self.home_ned_m = estimate.position_ned_m
            self.steering.yaw_rad = yaw_of(estimate.q_wb_wxyz)
            self._enter(Phase.SPOOLUP)
        elif not commander.armed and (was_armed or self.phase is not Phase.DISARMED):
            self._enter(Phase.DISARMED)
        if self.phase is Phase.SPOOLUP and self._t_s - self._phase_s >= self.parameters["COM_SPOOLUP_TIME"]:
            self._enter(Phase.READY)

    def _enter(self, phase: Phase) -> None:
        self.phase, self._phase_s = phase, self._t_s
        if phase is not Phase.FLIGHT:
            self._flight.rate_integral[:] = 0.0
            self._flight.smooth_rates[:] = self._flight.estimate[10:]
            self._flight.velocity_integral[:] = 0.0
            self.steering.restart()

    def _stand(self, estimate: Estimate) -> None:
        falling = self._t_s > 0.0 and not self.landed
        self._watch_ground(estimate, 1.0 if falling else nan, 0.0)
        self.setpoint = _NOTHING
        self._engage(Engaged.OFF if self.phase is Phase.DISARMED else Engaged.IDLE)

    def _steer(self, estimate: Estimate) -> None:
        mode = self.commander.flown_mode
        steer = self.steering.choose(mode, estimate, self._t_s)
        if mode in (Mode.TAKEOFF, Mode.MISSION) and self.task is not None and self.task.finished:
            done = self.task
            self.request_mode(Mode.LOITER)
            if isinstance(done, MissionTask):
                self.steering.hold_at(done.hold)
        self.setpoint = steer.setpoint
        if self.landed and self.phase is Phase.FLIGHT:
            self._enter(Phase.READY)
        if self.phase is Phase.READY and self.steering.wants_takeoff(mode, steer, estimate):
            self._enter(Phase.RAMPUP)
        in_contact = self._detector.ground_contact and self.phase is Phase.FLIGHT
        if mode is Mode.TERMINATE:
            self._engage(Engaged.OFF)
            self._watch_ground(estimate, nan, 0.0)
        elif self.phase is Phase.READY or in_contact:
            self._flight.velocity_integral[:] = 0.0
            self._engage(Engaged.IDLE)
            self._flight.attitude_sp[:] = quaternion_from_euler(0.0, 0.0, yaw_of(estimate.q_wb_wxyz))
            self._watch_ground(estimate, steer.setpoint.velocity_ned_mps[2], 0.0)
        else:
            self._follow(steer)
            self._watch_ground(estimate, self._asked_down_mps(steer), self._flight.get("thrust_sp"))

    def _asked_down_mps(self, steer: Steer) -> float:
        return float(self._flight.velocity_sp[2]) if steer.engaged is Engaged.POSITION else nan

    def _follow(self, steer: Steer) -> None:
        flight = self._flight
        if steer.engaged is Engaged.POSITION:
            s = steer.setpoint
            self._orders.write(
                steer.engaged,
                self.phase is Phase.RAMPUP,
                self.landed,
                tan(self._next_tilt_rad()),
                *s.position_ned_m,
                *s.velocity_ned_mps,
                *s.acceleration_ned_mps2,
                self.steering.yaw_rad,
                s.yaw_rate_radps,
                *self._speed_limits(),
            )
            return
        flight.put("landed", self.landed)
        if steer.engaged is Engaged.RATE:
            flight.rate_sp[:] = steer.rates
        else:
            flight.attitude_sp[:] = steer.attitude_sp
            flight.rates_ff[:] = steer.rates
        flight.put("thrust_sp", steer.thrust)
        if self.phase is Phase.RAMPUP:
            self._enter(Phase.FLIGHT)
        flight.put("engaged", steer.engaged)

    def _engage(self, engaged: Engaged) -> None:
        self._flight.put("engaged", engaged)
        self._flight.put("thrust_sp", 0.0)

    def _next_tilt_rad(self) -> float:
        """MPC_TILTMAX_LND until the vehicle flies, then MPC_TILTMAX_AIR, without a jump."""
        name = "MPC_TILTMAX_AIR" if self.phase is Phase.FLIGHT else "MPC_TILTMAX_LND"
        change = _TILT_SLEW_RADPS * self._period_s
        self._tilt_rad += max(-change, min(change, radians(self.parameters[name]) - self._tilt_rad))
        return self._tilt_rad

    def _speed_limits(self) -> tuple[float, float, float]:
        """Horizontal, up, down. In the ramp the upward speed grows from one that gives no thrust (PX4's take-off ramp)."""
        p = self.parameters
        up = p["MPC_Z_VEL_MAX_UP"]
        if self.phase is Phase.RAMPUP:
            ramp_s = p["MPC_TKO_RAMP_T"]
            progress = (self._t_s - self._phase_s) / ramp_s if ramp_s > 0.0 else 1.0
            if progress >= 1.0:
                self._enter(Phase.FLIGHT)
            else:
                start = -_GRAVITY / p["MPC_Z_VEL_P_ACC"]
                up = start + progress * (min(up, p["MPC_TKO_SPEED"]) - start)
        return (p["MPC_XY_VEL_MAX"], up, max(p["MPC_Z_VEL_MAX_DN"], -up))

    def _watch_ground(self, estimate: Estimate, asked_down_mps: float, thrust: float) -> None:
        was_landed = self.landed
        share = thrust / self.parameters["MPC_THR_HOVER"]
        valid = self.commander.health.estimate_good
        position, velocity = estimate.position_ned_m, estimate.velocity_ned_mps
        self._detector.update(position, velocity, asked_down_mps, share, self._period_s, valid)
        if was_landed != self.landed and self.phase not in (Phase.DISARMED, Phase.SPOOLUP):
            self.commander.say(Severity.INFO, "Landing detected" if self.landed else "Takeoff detected")
