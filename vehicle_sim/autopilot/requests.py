"""What may be asked of the autopilot: set-points, sticks, modes, arming. No I/O; time is that of the last tick."""

from math import isfinite

from vehicle_sim.autopilot.commander import Commander, Links
from vehicle_sim.autopilot.contract import Event
from vehicle_sim.autopilot.guidance import HoldTask, Sticks, Task
from vehicle_sim.autopilot.landed import LandedDetector, LandedLimits
from vehicle_sim.autopilot.mission import MissionTask
from vehicle_sim.autopilot.modes import STICK_MODES, Mode
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.results import Result, Severity
from vehicle_sim.autopilot.setpoints import (
    AttitudeSetpoint,
    Refusal,
    SetpointMessage,
    interpret_setpoint,
    needs_position,
)
from vehicle_sim.autopilot.steering import Steering
from vehicle_sim.rotation import Vector
from vehicle_sim.sensors import Estimate

_JOYSTICK_MODES = (1, 2, 3)


class Requests:
    """The half of the autopilot that is asked; `Autopilot` adds the half that acts."""

    def __init__(self, parameters: ParameterStore, period_s: float) -> None:
        self.parameters = parameters
        self.commander = Commander(parameters)
        self.links = Links()
        self.steering = Steering(parameters, period_s)
        self._detector = LandedDetector(LandedLimits.of(parameters))
        self._t_s = 0.0

    @property
    def landed(self) -> bool:
        """The landed detector's verdict."""
        return self._detector.landed

    @property
    def task(self) -> Task | None:
        """What flies the mode, in modes that have one."""
        return self.steering.task

    def offboard_signal(self) -> bool:
        """A setpoint younger than COM_OF_LOSS_T has been heard."""
        return self._t_s - self.links.offboard_s <= self.parameters["COM_OF_LOSS_T"]

    def receive_setpoint(self, message: SetpointMessage, estimate: Estimate, complain: bool = True) -> bool:
        """SET_POSITION_TARGET_LOCAL_NED; true when it counts as proof of life."""
        setpoint = interpret_setpoint(message, estimate.q_wb_wxyz)
        if isinstance(setpoint, Refusal):
            if complain:
                self.commander.say(Severity.CRITICAL, setpoint.text)
            return False
        self.steering.offboard, self.steering.offboard_attitude = setpoint, None
        self.commander.health.offboard_needs_position = needs_position(setpoint)
        self.links = Links(self._t_s, self.links.manual_s, self.links.gcs_s)
        return True

    def receive_attitude(self, setpoint: AttitudeSetpoint) -> None:
        """SET_ATTITUDE_TARGET: proof of life too, and flyable without a position."""
        self.steering.offboard_attitude = setpoint
        self.commander.health.offboard_needs_position = False
        self.links = Links(self._t_s, self.links.manual_s, self.links.gcs_s)

    def receive_sticks(self, sticks: Sticks) -> None:
        """MANUAL_CONTROL, listened to when COM_RC_IN_MODE allows joysticks; moved sticks may take over (COM_RC_OVERRIDE)."""
        if self.parameters.integer("COM_RC_IN_MODE") not in _JOYSTICK_MODES:
            return
        moved = max(abs(now - then) for now, then in zip(sticks[:2], self.steering.sticks[:2], strict=True))
        had_sticks = self._t_s - self.links.manual_s <= self.parameters["COM_RC_LOSS_T"]
        self.steering.sticks = sticks
        self.links = Links(self.links.offboard_s, self._t_s, self.links.gcs_s)
        mode = self.commander.flown_mode
        bit = 2 if mode is Mode.OFFBOARD else 1
        allowed = mode not in STICK_MODES and self.parameters.integer("COM_RC_OVERRIDE") & bit
        pushed = max(abs(sticks.forward), abs(sticks.right)) * 100.0 > self.parameters["COM_RC_STICK_OV"]
        if self.commander.armed and allowed and had_sticks and moved > 0.0 and pushed:
            self.commander.say(Severity.INFO, "Pilot took over using sticks")
            self.request_mode(Mode.POSCTL)

    def receive_gcs_heartbeat(self) -> None:
        """HEARTBEAT of a ground station."""
        self.links = Links(self.links.offboard_s, self.links.manual_s, self._t_s)

    def request_mode(self, mode: Mode | None) -> Result:
        """DO_SET_MODE and the commands that imply one; None is a mode that does not exist."""
        return self._request(Event.MODE, mode)

    def request_takeoff(self, estimate: Estimate, altitude_d_m: float) -> Result:
        """NAV_TAKEOFF; NaN, or less than MIS_TAKEOFF_ALT above where the vehicle is, means that height."""
        result = self.request_mode(Mode.TAKEOFF)
        if result is Result.ACCEPTED:
            least = self.parameters["MIS_TAKEOFF_ALT"]
            lowest_d_m = estimate.position_ned_m[2] - least
            if isfinite(altitude_d_m) and altitude_d_m > lowest_d_m:
                self.commander.say(Severity.WARNING, f"Using minimum takeoff altitude: {least:.2f} m")
            self.steering.take_off_to(min(altitude_d_m, lowest_d_m) if isfinite(altitude_d_m) else lowest_d_m)
        return result

    def request_reposition(self, estimate: Estimate, target_ned_m: Vector, yaw_rad: float, speed_mps: float) -> Result:
        """DO_REPOSITION: Hold at a place; NaN keeps that axis."""
        result = self.request_mode(Mode.LOITER)
        if result is Result.ACCEPTED:
            task = HoldTask(estimate, self.parameters, target_ned_m, yaw_rad)
            if isfinite(speed_mps) and speed_mps > 0.0:
                task.cruise_mps = min(speed_mps, self.parameters["MPC_XY_VEL_MAX"])
            self.steering.hold_at(task)
        return result

    def request_speed(self, speed_mps: float) -> Result:
        """DO_CHANGE_SPEED: the cruise speed of Hold on its way to a place, and of a mission."""
        if not (isfinite(speed_mps) and speed_mps > 0.0):
            return Result.DENIED
        speed_mps = min(speed_mps, self.parameters["MPC_XY_VEL_MAX"])
        if isinstance(self.task, HoldTask):
            self.task.cruise_mps = speed_mps
        elif isinstance(self.task, MissionTask):
            self.task.set_cruise(speed_mps)
        return Result.ACCEPTED

    def request_arm(self) -> Result:
        """COMPONENT_ARM_DISARM with 1. There is no forcing: a vehicle that is not ready cannot fly."""
        return self._request(Event.ARM)

    def request_disarm(self, force: bool = False) -> Result:
        """COMPONENT_ARM_DISARM with 0."""
        return self._request(Event.FORCE_DISARM if force else Event.DISARM)

    def request_termination(self) -> Result:
        """DO_FLIGHTTERMINATION."""
        return self._request(Event.TERMINATE)

    def _request(self, event: Event, mode: Mode | None = None) -> Result:
        self._refresh_health()
        return self.commander.request(event, self._t_s, self.links, mode)

    def _refresh_health(self) -> None:
        health = self.commander.health
        health.landed, health.mission_ready = self.landed, self.steering.mission.ready
