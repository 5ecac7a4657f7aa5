"""Parameters that really act: each one named by a situation in which its value decides what the vehicle does."""

from collections.abc import Callable
from math import degrees, hypot, nan, sqrt

import pytest

from vehicle_sim.autopilot.guidance import Sticks
from vehicle_sim.autopilot.mission import MissionItem
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.parameters import TABLE, ParameterStore
from vehicle_sim.autopilot.results import Result
from vehicle_sim.autopilot.setpoints import SetpointMessage
from vehicle_sim.config import VehicleConfig
from vehicle_sim.listing import parameters_text
from vehicle_sim.protocol.commands import Command, execute
from vehicle_sim.vehicle import Vehicle

from .node_client import EXACT

NO = (nan, nan, nan)


class Flight:
    """A vehicle without errors, and what it did: largest speeds, tilt and height."""

    def __init__(self, **parameters: float) -> None:
        self.vehicle = Vehicle(VehicleConfig(sensors=EXACT, parameters=parameters), 1)
        self.pilot = self.vehicle.autopilot
        self.speed = self.climb = self.sink = self.tilt = self.height = self.acceleration = 0.0

    def run(self, seconds: float, each: Callable[[], object] | None = None) -> "Flight":
        for _ in range(round(seconds / 0.02)):
            if each is not None:
                each()
            before = self.vehicle.state
            self.vehicle.advance(8)
            x = self.vehicle.state
            self.speed = max(self.speed, hypot(x.vn, x.ve))
            self.climb, self.sink = max(self.climb, -x.vd), max(self.sink, x.vd)
            self.tilt = max(self.tilt, degrees(2 * sqrt(x.qx**2 + x.qy**2)))
            self.height = max(self.height, -x.d)
            self.acceleration = max(self.acceleration, hypot(x.vn - before.vn, x.ve - before.ve) / 0.02)
        return self

    def send(self, position: tuple[float, float, float], velocity: tuple[float, float, float] = NO) -> None:
        message = SetpointMessage(1, 0, position, velocity, NO, 0.0, nan)
        self.pilot.receive_setpoint(message, self.vehicle.estimate)

    def offboard(self, position: tuple[float, float, float], seconds: float) -> "Flight":
        """To 5 m, forget what that took, then to the place."""
        self.run(4.6, lambda: self.send((0.0, 0.0, -5.0)))
        self.pilot.request_mode(Mode.OFFBOARD)
        assert self.pilot.request_arm() is Result.ACCEPTED
        self.run(9.0, lambda: self.send((0.0, 0.0, -5.0)))
        self.speed = self.climb = self.sink = self.tilt = self.height = self.acceleration = 0.0
        return self.run(seconds, lambda: self.send(position))

    def taken_off(self) -> "Flight":
        self.run(max(0.1, 4.6 - self.vehicle.t_s))
        assert self.pilot.request_takeoff(self.vehicle.estimate, nan) is Result.ACCEPTED
        assert self.pilot.request_arm() is Result.ACCEPTED
        return self.run(14.0)


FAR, HIGH, LOW = (80.0, 0.0, -5.0), (0.0, 0.0, -40.0), (0.0, 0.0, -1.0)
GO = {
    "MPC_XY_VEL_MAX": (lambda v: Flight(MPC_XY_VEL_MAX=v).offboard(FAR, 8.0).speed, (3.0, 6.0), 0.1),
    "MPC_Z_VEL_MAX_UP": (lambda v: Flight(MPC_Z_VEL_MAX_UP=v).offboard(HIGH, 6.0).climb, (1.0, 2.5), 0.12),
    "MPC_Z_VEL_MAX_DN": (
        lambda v: Flight(MPC_Z_VEL_MAX_DN=v, MPC_Z_VEL_MAX_UP=3.0).offboard(LOW, 3.5).sink,
        (0.6, 1.2),
        0.12,
    ),
    "MPC_TILTMAX_AIR": (lambda v: Flight(MPC_TILTMAX_AIR=v).offboard(FAR, 4.0).tilt, (20.0, 35.0), 0.15),
    "MIS_TAKEOFF_ALT": (lambda v: Flight(MIS_TAKEOFF_ALT=v).taken_off().height, (2.5, 6.0), 0.06),
}


@pytest.mark.parametrize("name", GO)
def test_limits_are_what_is_reached(name: str) -> None:
    fly, values, tolerance = GO[name]
    assert [fly(value) for value in values] == pytest.approx(values, rel=tolerance)


def goto(flight: Flight) -> Flight:
    flight.taken_off()
    flight.speed = flight.acceleration = 0.0
    flight.pilot.request_reposition(flight.vehicle.estimate, (110.0, 0.0, nan), nan, nan)
    return flight.run(9.0)


def test_cruise_speed_and_acceleration_of_auto_modes() -> None:
    assert [goto(Flight(MPC_XY_CRUISE=v)).vehicle.state.vn for v in (3.0, 7.0)] == pytest.approx([3.0, 7.0], rel=0.12)
    slow, fast = (goto(Flight(MPC_ACC_HOR=v, MPC_XY_CRUISE=10.0)).vehicle.state.n for v in (2.0, 6.0))
    assert fast > slow + 8.0


def test_return_height_and_landing_delay() -> None:
    heights, times = [], []
    for height, delay in ((12.0, 0.0), (20.0, 6.0)):
        flight = Flight(RTL_RETURN_ALT=height, RTL_DESCEND_ALT=10.0, RTL_LAND_DELAY=delay, MPC_XY_CRUISE=8.0)
        flight.taken_off()
        flight.pilot.request_reposition(flight.vehicle.estimate, (15.0, 0.0, nan), nan, nan)
        flight.run(6.0)
        flight.pilot.request_mode(Mode.RTL)
        start = flight.vehicle.t_s
        while flight.pilot.commander.armed:
            flight.run(0.5)
            assert flight.vehicle.t_s < start + 90
        heights.append(flight.height)
        times.append(flight.vehicle.t_s - start)
        assert hypot(flight.vehicle.state.n, flight.vehicle.state.e) < 0.6
    assert heights == pytest.approx([12.0, 20.0], abs=0.8)
    assert times[1] > times[0] + 6.0


@pytest.mark.parametrize(("loss_s", "flown"), [(0.5, Mode.RTL), (3.0, Mode.OFFBOARD)])
def test_com_of_loss_t(loss_s: float, flown: Mode) -> None:
    flight = Flight(COM_OF_LOSS_T=loss_s).offboard((0.0, 0.0, -5.0), 1.0).run(1.5)
    assert flight.pilot.commander.flown_mode is flown


@pytest.mark.parametrize(("value", "armed"), [(3.0, False), (-1.0, True)])
def test_com_disarm_prflt(value: float, armed: bool) -> None:
    flight = Flight(COM_DISARM_PRFLT=value).run(4.6)
    flight.pilot.request_arm()
    assert flight.run(12.0).pilot.commander.armed is armed


@pytest.mark.parametrize(("value", "armed"), [(1.0, False), (-1.0, True)])
def test_com_disarm_land(value: float, armed: bool) -> None:
    flight = Flight(COM_DISARM_LAND=value).taken_off()
    flight.pilot.request_mode(Mode.LAND)
    while not flight.pilot.landed:
        flight.run(0.2)
        assert flight.vehicle.t_s < 60
    assert flight.run(3.0).pilot.commander.armed is armed


@pytest.mark.parametrize(("in_mode", "heard"), [(0, False), (1, True), (2, True), (3, True), (4, False)])
def test_com_rc_in_mode(in_mode: int, heard: bool) -> None:
    flight = Flight(COM_RC_IN_MODE=in_mode).run(4.6)
    flight.pilot.receive_sticks(Sticks(0.0, 0.0, 0.0, 0.0))
    flight.pilot.request_mode(Mode.POSCTL)
    assert (flight.pilot.request_arm() is Result.ACCEPTED) is heard


@pytest.mark.parametrize(
    ("action", "excepted", "flown"),
    [(1, 0, Mode.LOITER), (2, 0, Mode.RTL), (3, 0, Mode.LAND), (2, 4, Mode.OFFBOARD)],
)
def test_nav_rcl_act_and_com_rcl_except(action: int, excepted: int, flown: Mode) -> None:
    """Sticks that were there at arming and fall silent."""
    flight = Flight(NAV_RCL_ACT=action, COM_RCL_EXCEPT=excepted, COM_RC_OVERRIDE=0)

    def both() -> None:
        flight.send((0.0, 0.0, -5.0))
        flight.pilot.receive_sticks(Sticks(0.0, 0.0, 0.0, 0.0))

    flight.run(4.6, both)
    flight.pilot.request_mode(Mode.OFFBOARD)
    assert flight.pilot.request_arm() is Result.ACCEPTED
    flight.run(8.0, both)
    flight.run(1.5, lambda: flight.send((0.0, 0.0, -5.0)))
    assert flight.pilot.commander.flown_mode is flown


def test_acro_turns_at_the_rate_of_its_parameter() -> None:
    flight = Flight(MC_ACRO_Y_MAX=60.0).taken_off()

    def stick() -> None:
        flight.pilot.receive_sticks(Sticks(0.0, 0.0, 0.15, 1.0))

    flight.run(0.1, stick)
    flight.pilot.request_mode(Mode.ACRO)
    flight.run(1.5, stick)
    assert degrees(flight.vehicle.state.r) == pytest.approx(60.0, rel=0.05)


def test_every_parameter_that_is_not_fixed_is_read() -> None:
    """A parameter nobody reads would be a promise nobody keeps."""

    class Watched(ParameterStore):
        read: set[str]

        def __getitem__(self, name: str) -> float:
            self.read.add(name)
            return super().__getitem__(name)

        def integer(self, name: str) -> int:
            self.read.add(name)
            return super().integer(name)

    Watched.read = set()
    flight, with_sticks = Flight(), Flight()
    for watched in (flight, with_sticks):
        watched.pilot.parameters.__class__ = Watched
        watched.pilot._revision = watched.pilot.commander._revision = -1
    with_sticks.run(4.5)
    with_sticks.pilot.receive_sticks(Sticks(0.0, 0.0, 0.0, 0.0))
    with_sticks.pilot.request_arm()
    with_sticks.run(1.0)
    flight.taken_off()
    for mode in (Mode.ALTCTL, Mode.POSCTL, Mode.STABILIZED, Mode.ACRO, Mode.RTL, Mode.LAND):
        flight.run(0.1, lambda: flight.pilot.receive_sticks(Sticks(0.1, 0.0, 0.2, 0.5)))
        flight.pilot.request_mode(mode)
        flight.run(0.1, lambda: flight.pilot.receive_sticks(Sticks(0.0, 0.0, 0.2, 0.5)))
    flight.pilot.steering.mission.replace([MissionItem(16, (0.0, 0.0, 0.0, nan), (1.0, 0.0, -3.0))])
    flight.pilot.request_mode(Mode.MISSION)
    flight.run(3.0, lambda: flight.send((0.0, 0.0, -3.0)))
    execute(flight.vehicle, None, Command(420, 4, 1, 0, 0, 0, 0, 0))  # type: ignore[arg-type]
    unread = {name for name, spec in TABLE.items() if not spec.meaning.startswith("fixed")} - Watched.read
    assert not unread


def test_the_table_prints_type_unit_default_and_range() -> None:
    lines = parameters_text().splitlines()
    assert lines[0].split() == ["name", "type", "default", "range", "unit", "meaning"]
    assert len(lines) == len(TABLE) + 2
    row = next(line for line in lines if line.startswith("COM_OF_LOSS_T"))
    assert row.split()[:7] == ["COM_OF_LOSS_T", "FLOAT", "1", "0", "..", "60", "s"]
