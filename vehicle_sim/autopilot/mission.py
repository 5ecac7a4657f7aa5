"""Missions: a list of items, checked when it arrives, and the task that flies it. NED metres, seconds.

PX4 flies them as: navigation items one after the other, each reached within NAV_ACC_RAD; DO items take effect when they are passed.
Items that want a camera, a gimbal or a gripper are passed over, as PX4 without the part does.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import dist, hypot, isfinite, nan, radians
from typing import NamedTuple

from vehicle_sim.autopilot.guidance import HoldTask, LandTask, ReturnTask, TakeoffTask, Task
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.setpoints import TrajectorySetpoint
from vehicle_sim.rotation import Vector
from vehicle_sim.sensors import Estimate

WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, RETURN, LAND, TAKEOFF = 16, 17, 19, 20, 21, 22
DELAY, JUMP, CHANGE_SPEED = 93, 177, 178
PLACES = frozenset({WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, LAND, TAKEOFF})
#: Flown or obeyed here; the rest of what PX4 takes is passed over.
KNOWN = PLACES | {RETURN, DELAY, JUMP, CHANGE_SPEED}
PASSED_OVER = frozenset(
    {179, 195, 197, 201, 203, 205, 206, 211, 214, 530, 531, 532, 1000, 1001, 2000, 2001, 2500, 2501}
)
_MAX_JUMPS = 1000
_ON_GROUND_M = 0.5


class MissionItem(NamedTuple):
    """One item; `place` is local NED, NaN where the item has none. Parameters as in MAVLink."""

    command: int
    parameters: tuple[float, float, float, float]
    place: Vector


@dataclass
class Mission:
    """The list, the item that is flown, and what has been reached."""

    items: tuple[MissionItem, ...] = ()
    current: int = 0
    finished: bool = False
    revision: int = 0

    @property
    def ready(self) -> bool:
        """There is something to fly."""
        return any(item.command in KNOWN for item in self.items)

    def replace(self, items: Sequence[MissionItem]) -> None:
        """A new list, from its first item."""
        self.items, self.current, self.finished = tuple(items), 0, False
        self.revision += 1

    def select(self, index: int) -> bool:
        """MISSION_SET_CURRENT."""
        if not 0 <= index < len(self.items):
            return False
        self.current, self.finished = index, False
        self.revision += 1
        return True


class MissionTask:
    """Flies `mission` from its current item; ends in Hold at the last place. `on_reached(index)` is called for every item passed."""

    def __init__(
        self,
        mission: Mission,
        estimate: Estimate,
        parameters: ParameterStore,
        home_ned_m: Vector,
        on_reached: Callable[[int], None],
    ) -> None:
        self.finished = False
        self._mission, self._parameters, self._home = mission, parameters, home_ned_m
        self._on_reached = on_reached
        self._revision = mission.revision
        self._cruise_mps = parameters["MPC_XY_CRUISE"]
        self._jumps: dict[int, int] = {}
        self._wait_s = 0.0
        self.hold = HoldTask(estimate, parameters, None, nan)
        self._task: Task = self.hold
        self._after_climb: Task | None = None
        if mission.finished:
            mission.select(0)
            self._revision = mission.revision
        self._begin(estimate)

    @property
    def landing(self) -> bool:
        """The item that is flown lands."""
        return isinstance(self._task, LandTask) or (isinstance(self._task, ReturnTask) and self._task.landing)

    @property
    def wants_takeoff(self) -> bool:
        """From the ground a mission begins with a climb."""
        return not (self._mission.finished or self.landing)

    def setpoint(self, estimate: Estimate, dt_s: float) -> TrajectorySetpoint:
        """Fly the item; pass on when it is reached and its time is over."""
        mission = self._mission
        if mission.revision != self._revision:
            self._revision = mission.revision
            self._begin(estimate)
        if not mission.finished and self._reached(estimate):
            self._wait_s -= dt_s
            if self._wait_s <= 0.0:
                self._on_reached(mission.current)
                mission.current += 1
                self._begin(estimate)
        if self._after_climb is not None and self._task.finished:
            self._task, self._after_climb = self._after_climb, None
        return self._task.setpoint(estimate, dt_s)

    def set_cruise(self, speed_mps: float) -> None:
        """DO_CHANGE_SPEED while flying."""
        self._cruise_mps = speed_mps
        self.hold.cruise_mps = speed_mps

    def _begin(self, estimate: Estimate) -> None:
        """Skip what only takes effect, then start the next thing that is flown."""
        mission = self._mission
        for _ in range(_MAX_JUMPS):
            if mission.current >= len(mission.items):
                mission.current, mission.finished, self.finished = max(0, len(mission.items) - 1), True, True
                return
            item = mission.items[mission.current]
            if item.command in PLACES or item.command in (RETURN, DELAY):
                self._start(item, estimate)
                return
            self._pass(item)
        mission.finished = self.finished = True

    def _pass(self, item: MissionItem) -> None:
        mission = self._mission
        if item.command == CHANGE_SPEED and item.parameters[1] > 0.0:
            self.set_cruise(min(item.parameters[1], self._parameters["MPC_XY_VEL_MAX"]))
        if item.command == JUMP and self._jumps.get(mission.current, 0) < item.parameters[1]:
            self._jumps[mission.current] = self._jumps.get(mission.current, 0) + 1
            mission.current = int(item.parameters[0])
            return
        self._on_reached(mission.current)
        mission.current += 1

    def _start(self, item: MissionItem, estimate: Estimate) -> None:
        p, place = self._parameters, item.place
        self._wait_s = 0.0
        if item.command == RETURN:
            self._task = ReturnTask(estimate, p, self._home)
        elif item.command == LAND:
            given = isfinite(place[0]) and isfinite(place[1])
            self._task = LandTask(estimate, p, self._home[2], (place[0], place[1]) if given else None)
        elif item.command == TAKEOFF:
            self._task = TakeoffTask(estimate, p, place[2])
        elif item.command == DELAY:
            self._wait_s = max(0.0, item.parameters[0])
        else:
            if item.command in (WAYPOINT, LOITER_TIME):
                self._wait_s = item.parameters[0] if isfinite(item.parameters[0]) else 0.0
            yaw = item.parameters[3]
            self.hold = HoldTask(estimate, p, place, radians(yaw) if isfinite(yaw) else nan)
            self.hold.cruise_mps = self._cruise_mps
            self._task = self.hold
            self._climb_first(place, estimate)

    def _climb_first(self, place: Vector, estimate: Estimate) -> None:
        """From the ground a vehicle rises straight up before it goes anywhere."""
        here = estimate.position_ned_m
        if self._home[2] - here[2] < _ON_GROUND_M:
            wanted = self._home[2] - self._parameters["MIS_TAKEOFF_ALT"]
            target = min(place[2], wanted) if isfinite(place[2]) else wanted
            self._task, self._after_climb = TakeoffTask(estimate, self._parameters, target), self.hold
            self.hold.start_at((here[0], here[1], target))

    def _reached(self, estimate: Estimate) -> bool:
        item = self._mission.items[self._mission.current]
        if item.command in (LAND, RETURN, LOITER_UNLIMITED):
            return False
        if item.command == DELAY:
            return True
        if item.command == TAKEOFF:
            return self._task.finished
        if self._after_climb is not None:
            return False
        here = estimate.position_ned_m
        place = tuple(p if isfinite(p) else h for p, h in zip(item.place, here, strict=True))
        near = hypot(here[0] - place[0], here[1] - place[1]) <= self._parameters["NAV_ACC_RAD"]
        high = abs(here[2] - place[2]) <= self._parameters["NAV_MC_ALT_RAD"]
        return near and high and dist(here, place) < self._parameters["NAV_ACC_RAD"] + 1.0
