"""What the controllers are to follow: the setpoint of the mode that flies, and the loop it enters at.

State: the task of the mode, OFFBOARD's last setpoints, the sticks, the heading that is held. NED, SI.
"""

from math import isfinite, nan, radians
from typing import NamedTuple

from vehicle_sim.autopilot.guidance import (
    DescendTask,
    HoldTask,
    LandTask,
    ReturnTask,
    Sticks,
    StickTask,
    TakeoffTask,
    Task,
)
from vehicle_sim.autopilot.mission import Mission, MissionTask
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.setpoints import AttitudeSetpoint, TrajectorySetpoint, is_flyable, wants_to_climb
from vehicle_sim.memory import Engaged
from vehicle_sim.rotation import Quaternion, Vector, quaternion_from_euler, yaw_of
from vehicle_sim.sensors import Estimate

_INVALID_GRACE_S = 0.2
_STICK_TILT_RAD = radians(35.0)
_ALTITUDE_MODES = (Mode.ALTCTL, Mode.POSCTL)
_TILT_MODES = (Mode.MANUAL, Mode.STABILIZED)
_NO_TAKEOFF = (Mode.LAND, Mode.RTL, Mode.LOITER, Mode.TERMINATE, Mode.DESCEND)
_IDLE_THROTTLE = 0.1
_NOTHING = TrajectorySetpoint()


class Steer(NamedTuple):
    """Loop to enter at, trajectory, and for flight by tilt or rates the attitude, rates and thrust themselves."""

    engaged: Engaged
    setpoint: TrajectorySetpoint
    attitude_sp: Quaternion = (1.0, 0.0, 0.0, 0.0)
    rates: Vector = (0.0, 0.0, 0.0)
    thrust: float = 0.0


class Steering:
    """`choose` is called at a fixed period."""

    def __init__(self, parameters: ParameterStore, period_s: float) -> None:
        self._parameters = parameters
        self._period_s = period_s
        self.task: Task | None = None
        self._task_mode: Mode | None = None
        self.home_ned_m: Vector | None = None
        self.sticks = Sticks(0.0, 0.0, 0.0, 0.0)
        self.offboard = TrajectorySetpoint()
        self.offboard_attitude: AttitudeSetpoint | None = None
        self.mission = Mission()
        self.reached: list[int] = []
        self._flyable = TrajectorySetpoint()
        self._flyable_s = 0.0
        self._takeoff_d_m = nan
        self.yaw_rad = 0.0

    def restart(self) -> None:
        """Begin the mode's task anew."""
        self._task_mode = None

    def take_off_to(self, d_m: float) -> None:
        """The next take-off ends there."""
        self._takeoff_d_m = d_m
        self._task_mode = None

    def hold_at(self, task: HoldTask) -> None:
        """Fly this instead of holding where the vehicle is."""
        self.task, self._task_mode = task, Mode.LOITER

    def choose(self, mode: Mode, estimate: Estimate, t_s: float) -> Steer:
        """The setpoint for now."""
        if mode in _TILT_MODES:
            return self._tilt_by_sticks()
        if mode is Mode.ACRO:
            return self._turn_by_sticks()
        if mode is Mode.OFFBOARD and self.offboard_attitude is not None:
            return self._by_attitude(self.offboard_attitude)
        setpoint = self._trajectory(mode, estimate, t_s)
        self.yaw_rad = self._next_yaw(setpoint)
        return Steer(Engaged.POSITION, setpoint)

    def wants_takeoff(self, mode: Mode, steer: Steer, estimate: Estimate) -> bool:
        """Row 22, and its like for sticks."""
        if mode in _NO_TAKEOFF:
            return False
        if steer.engaged is not Engaged.POSITION:
            return steer.thrust > _IDLE_THROTTLE
        if isinstance(self.task, MissionTask) and not self.task.wants_takeoff:
            return False
        if mode in _ALTITUDE_MODES:
            return self.sticks.up > 0.3
        return wants_to_climb(steer.setpoint, estimate.position_ned_m[2])

    def _trajectory(self, mode: Mode, estimate: Estimate, t_s: float) -> TrajectorySetpoint:
        if mode is Mode.OFFBOARD:
            if self._task_mode is not mode:
                self.task, self._task_mode = None, mode
            return self._checked_offboard(estimate, t_s)
        if mode is not self._task_mode or self.task is None:
            self.task, self._task_mode = self._begin(mode, estimate), mode
        if isinstance(self.task, StickTask):
            self.task.sticks = self.sticks
        return self.task.setpoint(estimate, self._period_s)

    def _begin(self, mode: Mode, estimate: Estimate) -> Task:
        p, home = self._parameters, self.home_ned_m or (0.0, 0.0, 0.0)
        if mode is Mode.TAKEOFF:
            target = self._takeoff_d_m
            self._takeoff_d_m = nan
            default = estimate.position_ned_m[2] - p["MIS_TAKEOFF_ALT"]
            return TakeoffTask(estimate, p, target if isfinite(target) else default)
        if mode is Mode.LAND:
            return LandTask(estimate, p, home[2])
        if mode is Mode.RTL:
            return ReturnTask(estimate, p, home)
        if mode is Mode.DESCEND:
            return DescendTask(estimate, p)
        if mode is Mode.MISSION:
            return MissionTask(self.mission, estimate, p, home, self.reached.append)
        if mode in _ALTITUDE_MODES:
            return StickTask(estimate, p)
        return HoldTask(estimate, p, None, nan)

    def _checked_offboard(self, estimate: Estimate, t_s: float) -> TrajectorySetpoint:
        """Row 3: a setpoint that cannot be flown is bridged for 200 ms by the last one that can, then the vehicle stops."""
        if is_flyable(self.offboard):
            self._flyable, self._flyable_s = self.offboard, t_s
            self.task = None
        elif t_s - self._flyable_s > _INVALID_GRACE_S:
            if self.task is None:
                self.task = HoldTask(estimate, self._parameters, None, nan)
            return self.task.setpoint(estimate, self._period_s)
        return self._flyable

    def _next_yaw(self, setpoint: TrajectorySetpoint) -> float:
        if isfinite(setpoint.yaw_rad):
            return setpoint.yaw_rad
        if isfinite(setpoint.yaw_rate_radps):
            return self.yaw_rad + setpoint.yaw_rate_radps * self._period_s
        return self.yaw_rad

    def _tilt_by_sticks(self) -> Steer:
        """Stabilized: sticks ask for tilt and thrust (half up is hover)."""
        sticks, p = self.sticks, self._parameters
        self.yaw_rad += sticks.clockwise * radians(p["MPC_MAN_Y_MAX"]) * self._period_s
        throttle, hover = (sticks.up + 1.0) / 2.0, p["MPC_THR_HOVER"]
        size = 2.0 * throttle * hover if throttle < 0.5 else hover + (2.0 * throttle - 1.0) * (1.0 - hover)
        roll, pitch = sticks.right * _STICK_TILT_RAD, -sticks.forward * _STICK_TILT_RAD
        q_sp = quaternion_from_euler(roll, pitch, self.yaw_rad)
        return Steer(Engaged.ATTITUDE, _NOTHING, q_sp, thrust=size)

    def _turn_by_sticks(self) -> Steer:
        """Acro: sticks ask for body rates and thrust."""
        sticks, p = self.sticks, self._parameters
        rates = (
            sticks.right * radians(p["MC_ACRO_R_MAX"]),
            -sticks.forward * radians(p["MC_ACRO_P_MAX"]),
            sticks.clockwise * radians(p["MC_ACRO_Y_MAX"]),
        )
        return Steer(Engaged.RATE, _NOTHING, rates=rates, thrust=(sticks.up + 1.0) / 2.0)

    def _by_attitude(self, asked: AttitudeSetpoint) -> Steer:
        self._task_mode = None
        if asked.q_sp_wxyz is None:
            return Steer(Engaged.RATE, _NOTHING, rates=asked.rates_radps, thrust=asked.thrust)
        self.yaw_rad = yaw_of(asked.q_sp_wxyz)
        return Steer(Engaged.ATTITUDE, _NOTHING, asked.q_sp_wxyz, asked.rates_radps, asked.thrust)
