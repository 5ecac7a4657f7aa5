"""The autopilot in closed loop with the physics, without MAVLink: the rows of the PX4 contract and the quality of flight."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import cos, dist, hypot, inf, nan, pi, sin, sqrt

import pytest

from vehicle_sim.autopilot.commander import READY_AFTER_S, Commander, Links
from vehicle_sim.autopilot.contract import Event
from vehicle_sim.autopilot.failsafe import POLICY, Decision, Reason, decide
from vehicle_sim.autopilot.glide import approach_speed
from vehicle_sim.autopilot.guidance import Sticks
from vehicle_sim.autopilot.modes import MODE_TABLE, Mode, Need, base_mode
from vehicle_sim.autopilot.parameters import TABLE, ParameterStore, find_parameter_problem
from vehicle_sim.autopilot.results import Result, SystemStatus
from vehicle_sim.autopilot.setpoints import (
    Refusal,
    SetpointMessage,
    TrajectorySetpoint,
    interpret_setpoint,
    is_flyable,
    wants_to_climb,
)
from vehicle_sim.config import VehicleConfig
from vehicle_sim.parts import BatteryConfig, SensorsConfig, WindConfig
from vehicle_sim.rotation import quaternion_from_euler, yaw_of
from vehicle_sim.vehicle import Vehicle, step_for_period_us

from .node_client import EXACT

LEVEL = (1.0, 0.0, 0.0, 0.0)
HERE = (0.0, 0.0, -3.0)
STILL = (0.0, 0.0, 0.0)
#: The control loops are judged by themselves, so the estimate is nearly the truth.
SMALL_ERRORS = SensorsConfig(estimator="error_model")
Reference = Callable[[float], tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]]


class Flight:
    """A vehicle with a stream of setpoints every 20 ms; time is the vehicle's."""

    def __init__(self, seed: int = 1, **config: object) -> None:
        self.vehicle = Vehicle(VehicleConfig(**{"sensors": SMALL_ERRORS, **config}), seed)  # type: ignore[arg-type]
        self.texts: list[str] = []
        self.modes: list[Mode] = []

    @property
    def pilot(self):  # type: ignore[no-untyped-def]
        return self.vehicle.autopilot

    def send(
        self, position: tuple[float, float, float] = HERE, velocity: tuple[float, float, float] = STILL, **more: object
    ) -> bool:
        message = SetpointMessage(1, 0, position, velocity, STILL, 0.0, 0.0)
        return bool(self.pilot.receive_setpoint(replace(message, **more), self.vehicle.estimate))

    def run(self, seconds: float, each: Callable[[], object] | None = None) -> "Flight":
        end = self.vehicle.t_us + round(seconds * 1e6)
        while self.vehicle.t_us < end:
            if each is not None and self.vehicle.t_us % 20_000 == 0:
                each()
            self.vehicle.step()
            if self.pilot.commander.texts:
                self.texts += [text.text for text in self.pilot.commander.texts]
                self.pilot.commander.texts.clear()
            mode = self.pilot.commander.flown_mode
            if not self.modes or self.modes[-1] is not mode:
                self.modes.append(mode)
        return self

    def until(self, condition: Callable[[], bool], limit_s: float) -> float:
        start = self.vehicle.t_s
        while not condition():
            assert self.vehicle.t_s < start + limit_s, (self.vehicle.state, self.texts, self.modes)
            self.run(0.02)
        return self.vehicle.t_s - start

    def offboard(self) -> "Flight":
        """In the air at `HERE` under OFFBOARD."""
        self.run(4.5, self.send)
        assert self.pilot.request_mode(Mode.OFFBOARD) is Result.ACCEPTED
        assert self.pilot.request_arm() is Result.ACCEPTED
        self.run(7.0, self.send)
        assert self.vehicle.state.d == pytest.approx(-3.0, abs=0.15)
        return self


NO_CAUSE: frozenset[Reason] = frozenset()
SHORT_RETURN = {"RTL_RETURN_ALT": 6.0}


def circle(t: float) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    """Speeds up over 4 s to 3 m/s on a circle of 9 m."""
    radius, ramp = 9.0, 4.0
    w = 3.0 / radius
    u = min(max(t, 0.0) / ramp, 1.0)
    angle = w * ramp * (u**3 - u**4 / 2) + w * max(0.0, t - ramp)
    rate, change = w * (3 * u * u - 2 * u**3), (w / ramp * (6 * u - 6 * u * u) if 0 < u < 1 else 0.0)
    s, c = sin(angle), cos(angle)
    return (
        (radius * s, radius * (1 - c), -3.0),
        (radius * c * rate, radius * s * rate, 0.0),
        (radius * (c * change - s * rate**2), radius * (s * change + c * rate**2), 0.0),
    )


def follow(flight: Flight, reference: Reference, seconds: float) -> tuple[float, float]:
    """RMS and worst distance of the truth to the reference, sampled when a setpoint is sent."""
    start, errors = flight.vehicle.t_s, []

    def tick() -> None:
        p, v, a = reference(flight.vehicle.t_s - start)
        errors.append(dist(flight.vehicle.state.position_ned_m, p))
        flight.send(p, v, acceleration=a)

    flight.run(seconds, tick)
    return sqrt(sum(e * e for e in errors) / len(errors)), max(errors)


@pytest.mark.parametrize("seed", [1, 2])
def test_follows_three_metres_a_second_within_eight_centimetres(seed: int) -> None:
    rms, worst = follow(Flight(seed).offboard(), circle, 25.0)
    assert rms < 0.08
    assert worst < 0.2


def test_follows_in_wind_with_gusts() -> None:
    flight = Flight(wind=WindConfig(mean_enu_mps=(4.0, -2.0, 0.0), gust_std_mps=(0.5, 0.5, 0.2))).offboard()
    rms, worst = follow(flight, circle, 20.0)
    assert rms < 0.2
    assert worst < 0.5


def test_a_position_step_settles_without_oscillation() -> None:
    flight = Flight(sensors=EXACT).offboard()
    track: list[float] = []

    def tick() -> None:
        flight.send((3.0, 0.0, -3.0), type_mask=0b111111000)
        track.append(flight.vehicle.state.n)

    flight.run(10.0, tick)
    assert max(track) < 3.45
    assert all(abs(n - 3.0) < 0.03 for n in track[300:])
    crossings = sum((a - 3.0) * (b - 3.0) < 0 and abs(a - b) > 1e-4 for a, b in pairwise(track[:300]))
    assert crossings <= 3


@pytest.mark.parametrize("yaw", [0.5, -2.0, 3.0])
def test_turns_to_the_yaw_asked_for_and_holds_place(yaw: float) -> None:
    flight = Flight().offboard()
    flight.run(8.0, lambda: flight.send(yaw_rad=yaw))
    assert cos(yaw_of(flight.vehicle.state.q_wb_wxyz) - yaw) > cos(0.05)
    assert dist(flight.vehicle.state.position_ned_m, HERE) < 0.15


def test_velocity_setpoints_by_hand_north_east_and_down() -> None:
    flight = Flight().offboard()
    for velocity in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)):
        flight.run(3.0, lambda v=velocity: flight.send(velocity=v, type_mask=0b111000111))
        assert flight.vehicle.state.velocity_ned_mps == pytest.approx(velocity, abs=0.15)


def test_body_frame_velocity_is_turned_by_heading() -> None:
    q = quaternion_from_euler(0.0, 0.0, pi / 2)
    got = interpret_setpoint(SetpointMessage(8, 0, (9, 9, 9), (1.0, 2.0, 3.0), (0, 0, 0), 0, 0), q)
    assert isinstance(got, TrajectorySetpoint)
    assert got.velocity_ned_mps == pytest.approx((-2.0, 1.0, 3.0))
    assert all(value != value for value in got.position_ned_m)


@pytest.mark.parametrize(
    ("frame", "mask", "text"),
    [(7, 0, "coordinate frame 7"), (9, 0, "frame 9"), (1, 0xDFF, "invalid"), (1, 0x200, "force")],
)
def test_setpoints_that_are_refused(frame: int, mask: int, text: str) -> None:
    refusal = interpret_setpoint(SetpointMessage(frame, mask, STILL, STILL, STILL, 0, 0), LEVEL)
    assert isinstance(refusal, Refusal)
    assert text in refusal.text


def test_nan_means_not_given() -> None:
    free = (nan, nan, nan)
    assert isinstance(interpret_setpoint(SetpointMessage(1, 0, free, free, free, 0, 0), LEVEL), Refusal)
    got = interpret_setpoint(SetpointMessage(1, 0, (inf, 1e30, 1.0), STILL, free, nan, nan), LEVEL)
    assert isinstance(got, TrajectorySetpoint)
    assert [value == value for value in got.position_ned_m] == [False, False, True]
    assert not is_flyable(replace_position(got, (1.0, nan, 1.0)))
    assert is_flyable(TrajectorySetpoint(velocity_ned_mps=STILL))
    assert not is_flyable(TrajectorySetpoint(velocity_ned_mps=(0.0, 0.0, nan)))


def replace_position(setpoint: TrajectorySetpoint, position: tuple[float, float, float]) -> TrajectorySetpoint:
    return setpoint._replace(position_ned_m=position)


def test_take_off_is_wanted_by_a_setpoint_above() -> None:
    assert wants_to_climb(TrajectorySetpoint(position_ned_m=(0, 0, -1)), 0.0)
    assert not wants_to_climb(TrajectorySetpoint(position_ned_m=(0, 0, 0.02)), 0.0)
    assert wants_to_climb(TrajectorySetpoint(velocity_ned_mps=(0, 0, -1)), 0.0)
    assert not wants_to_climb(TrajectorySetpoint(velocity_ned_mps=(0, 0, 1)), 0.0)
    assert wants_to_climb(TrajectorySetpoint(acceleration_ned_mps2=(0, 0, -1)), 0.0)


def test_half_a_setpoint_in_the_air_stops_the_vehicle_and_no_number_becomes_nan() -> None:
    flight = Flight().offboard()
    flight.run(4.0, lambda: flight.send((5.0, nan, -3.0), (nan, nan, nan)))
    state = flight.vehicle.state
    assert all(value == value for value in state)
    assert hypot(state.vn, state.ve) < 0.1
    assert state.d == pytest.approx(-3.0, abs=0.3)


def test_custom_modes_and_base_modes_as_measured() -> None:
    assert {mode: mode.custom_mode for mode in (Mode.LOITER, Mode.TAKEOFF, Mode.OFFBOARD, Mode.RTL, Mode.LAND)} == {
        Mode.LOITER: 0x03040000,
        Mode.TAKEOFF: 0x02040000,
        Mode.OFFBOARD: 0x00060000,
        Mode.RTL: 0x05040000,
        Mode.LAND: 0x06040000,
    }
    assert [base_mode(Mode.LOITER, armed, False) for armed in (False, True)] == [29, 157]
    assert [base_mode(Mode.TAKEOFF, armed, False) for armed in (False, True)] == [29, 157]
    assert (
        base_mode(Mode.OFFBOARD, False, True),
        base_mode(Mode.OFFBOARD, True, True),
        base_mode(Mode.OFFBOARD, False, False),
    ) == (17, 145, 1)
    assert set(MODE_TABLE) == set(Mode)
    assert [Mode.from_numbers(*pair) for pair in ((6, 0), (4, 3), (4, 9), (9, 0), (0, 0))] == [
        Mode.OFFBOARD,
        Mode.LOITER,
        None,
        None,
        None,
    ]


def test_armable_four_seconds_after_boot() -> None:
    flight = Flight()
    assert flight.pilot.commander.system_status() is SystemStatus.UNINIT
    flight.run(3.9)
    assert flight.pilot.request_arm() is Result.TEMPORARILY_REJECTED
    assert flight.run(0.1).texts == ["Arming denied: Resolve system health failures first"]
    flight.run(0.1)
    assert flight.pilot.commander.system_status() is SystemStatus.STANDBY
    assert flight.pilot.request_arm() is Result.ACCEPTED
    assert flight.pilot.commander.system_status() is SystemStatus.ACTIVE


def test_disarmed_any_mode_is_accepted_but_arming_then_fails() -> None:
    commander = Commander(ParameterStore({}, 0.5))
    commander.update(READY_AFTER_S, Links())
    for mode in (Mode.OFFBOARD, Mode.POSCTL, Mode.MISSION, Mode.LAND):
        assert commander.request(Event.MODE, 5.0, Links(), mode) is Result.ACCEPTED
        assert commander.request(Event.ARM, 5.0, Links()) is Result.TEMPORARILY_REJECTED


def test_armed_only_runnable_modes_are_accepted() -> None:
    flight = Flight().run(5.0)
    flight.pilot.request_arm()
    for mode, label in ((Mode.OFFBOARD, "Offboard"), (Mode.POSCTL, "Position"), (Mode.MISSION, "Mission")):
        assert flight.pilot.request_mode(mode) is Result.TEMPORARILY_REJECTED
        assert f"Switching to {label} is currently not available" in flight.run(0.02).texts


def test_disarms_itself_ten_seconds_after_arming_without_take_off() -> None:
    flight = Flight().run(5.0)
    flight.pilot.request_arm()
    waited = flight.until(lambda: not flight.pilot.commander.armed, 12.0)
    assert waited == pytest.approx(10.0, abs=0.1)
    assert flight.texts[-1] == "Disarmed by auto preflight disarming"
    assert flight.vehicle.state.d == 0.0


def test_disarming_in_the_air_is_refused_unless_forced() -> None:
    flight = Flight().offboard()
    assert flight.pilot.request_disarm() is Result.TEMPORARILY_REJECTED
    assert "Disarming denied: not landed" in flight.run(0.02).texts
    assert flight.pilot.request_disarm(force=True) is Result.ACCEPTED
    flight.run(2.0)
    assert flight.vehicle.state.d == 0.0


def test_take_off_holds_at_the_altitude_then_lands_and_disarms() -> None:
    flight = Flight(parameters={"MIS_TAKEOFF_ALT": 4.0}).run(5.0)
    assert flight.pilot.request_takeoff(flight.vehicle.estimate, nan) is Result.ACCEPTED
    assert flight.pilot.request_arm() is Result.ACCEPTED
    flight.until(lambda: flight.pilot.commander.mode is Mode.LOITER, 15.0)
    flight.run(3.0)
    assert flight.vehicle.state.d == pytest.approx(-4.0, abs=0.2)
    flight.pilot.request_mode(Mode.LAND)
    flight.until(lambda: flight.pilot.landed, 20.0)
    landed_s = flight.vehicle.t_s
    flight.until(lambda: not flight.pilot.commander.armed, 4.0)
    assert flight.vehicle.t_s - landed_s == pytest.approx(2.0, abs=0.1)
    assert flight.texts[-4:] == [
        "Armed by external command",
        "Takeoff detected",
        "Landing detected",
        "Disarmed by landing",
    ]
    assert hypot(flight.vehicle.state.n, flight.vehicle.state.e) < 0.3


def test_landing_by_offboard_setpoints() -> None:
    flight = Flight().offboard()
    down = {"velocity": (0.0, 0.0, 0.6), "type_mask": 0b111000111}
    flight.run(12.0, lambda: flight.send(**down))
    assert flight.pilot.landed
    assert not flight.pilot.commander.armed


def test_touch_down_is_gentle() -> None:
    flight = Flight().offboard()
    flight.pilot.request_mode(Mode.LAND)
    speeds = []
    flight.run(10.0, lambda: speeds.append(float(flight.vehicle.flight.before[5])))
    assert flight.pilot.landed
    assert max(speeds) < 1.0


def test_offboard_loss_returns_lands_disarms_and_shows_offboard_again() -> None:
    flight = Flight(parameters=SHORT_RETURN).offboard()
    flight.run(3.0, lambda: flight.send((4.0, 3.0, -3.0)))
    lost = flight.until(lambda: "Failsafe activated" in flight.texts, 2.0)
    assert lost == pytest.approx(1.07, abs=0.05)
    assert flight.pilot.commander.flown_mode is Mode.RTL
    assert flight.pilot.commander.system_status() is SystemStatus.CRITICAL
    heights = []
    flight.run(12.0, lambda: heights.append(-flight.vehicle.state.d))
    assert max(heights) == pytest.approx(6.0, abs=0.6)
    flight.until(lambda: not flight.pilot.commander.armed, 60.0)
    assert hypot(flight.vehicle.state.n, flight.vehicle.state.e) < 0.4
    assert flight.pilot.commander.flown_mode is Mode.OFFBOARD
    assert flight.modes == [Mode.LOITER, Mode.OFFBOARD, Mode.RTL, Mode.OFFBOARD]


def test_a_stream_that_comes_back_takes_offboard_back() -> None:
    flight = Flight(parameters=SHORT_RETURN).offboard().run(2.0)
    assert flight.pilot.commander.flown_mode is Mode.RTL
    flight.run(5.0, flight.send)
    assert flight.pilot.commander.flown_mode is Mode.OFFBOARD
    assert dist(flight.vehicle.state.position_ned_m, HERE) < 0.2


@pytest.mark.parametrize(("gap_s", "falls"), [(0.6, False), (1.0, False), (1.25, True)])
def test_gaps_in_the_stream(gap_s: float, falls: bool) -> None:
    flight = Flight(parameters=SHORT_RETURN).offboard()
    for _ in range(3):
        flight.send()
        flight.run(gap_s)
    assert (Mode.RTL in flight.modes) is falls


@pytest.mark.parametrize(
    ("offboard_loss", "manual_loss", "mode"),
    [
        (5, 2, Mode.LOITER),
        (4, 2, Mode.LAND),
        (3, 2, Mode.RTL),
        (0, 2, Mode.RTL),
        (0, 1, Mode.LOITER),
        (0, 3, Mode.LAND),
        (6, 2, Mode.TERMINATE),
    ],
)
def test_offboard_loss_actions(offboard_loss: int, manual_loss: int, mode: Mode) -> None:
    got = decide(
        Mode.OFFBOARD, Need.LOCAL_POSITION, NO_CAUSE, policy(COM_OBL_RC_ACT=offboard_loss, NAV_RCL_ACT=manual_loss)
    )
    assert got == Decision(mode, Reason.OFFBOARD_LOST)


def policy(**values: int) -> tuple[int, ...]:
    """Defaults of the table, but for the values given."""
    store = ParameterStore(values, 0.5)
    return tuple(store.integer(name) for name in POLICY)


def test_failsafe_table() -> None:
    fine = Need.LOCAL_POSITION | Need.OFFBOARD_SIGNAL | Need.OFFBOARD_POSITION
    default = policy()

    def flown(*causes: Reason, present: Need = fine, by: tuple[int, ...] = default) -> Decision:
        return decide(Mode.OFFBOARD, present, frozenset(causes), by)

    assert flown() == Decision(Mode.OFFBOARD)
    assert flown(present=Need.LOCAL_POSITION | Need.MANUAL_CONTROL).mode is Mode.POSCTL
    assert flown(Reason.GCS_LOST).reason is None
    assert flown(Reason.GCS_LOST, by=policy(NAV_DLL_ACT=2)).mode is Mode.RTL
    assert flown(Reason.BATTERY_CRITICAL).reason is None
    assert flown(Reason.BATTERY_CRITICAL, by=policy(COM_LOW_BAT_ACT=3)).mode is Mode.RTL
    assert flown(Reason.BATTERY_EMERGENCY, by=policy(COM_LOW_BAT_ACT=3)) == Decision(
        Mode.LAND, Reason.BATTERY_EMERGENCY
    )
    assert flown(present=Need(0)).mode is Mode.DESCEND
    assert flown(Reason.GEOFENCE, by=policy(GF_ACTION=3)).mode is Mode.RTL
    assert flown(Reason.GEOFENCE, by=policy(GF_ACTION=1)).reason is None
    assert flown(Reason.GEOFENCE, Reason.GCS_LOST, by=policy(GF_ACTION=2, NAV_DLL_ACT=3)).mode is Mode.LAND
    assert flown(present=Need.LOCAL_POSITION, by=policy(COM_OBL_RC_ACT=7)).disarm
    assert decide(Mode.RTL, fine, frozenset({Reason.GEOFENCE}), policy(GF_ACTION=2)) == Decision(Mode.RTL)


def test_critical_battery_returns_home() -> None:
    battery = BatteryConfig(capacity_ah=0.35, initial_charge=0.30)
    flight = Flight(battery=battery, parameters={**SHORT_RETURN, "COM_LOW_BAT_ACT": 3}).offboard()
    flight.run(35.0, flight.send)
    assert "Low battery level" in flight.texts
    assert "Critical battery" in flight.texts
    assert "Failsafe activated" in flight.texts
    assert {Mode.RTL, Mode.LAND} & set(flight.modes)


def test_reposition_goes_there_and_keeps_what_is_not_given() -> None:
    flight = Flight().offboard()
    assert flight.pilot.request_reposition(flight.vehicle.estimate, (6.0, -4.0, nan), nan, 2.0) is Result.ACCEPTED
    flight.run(10.0)
    assert flight.vehicle.state.position_ned_m == pytest.approx((6.0, -4.0, -3.0), abs=0.15)


def test_position_mode_by_sticks() -> None:
    flight = Flight().run(5.0)

    def hold(forward: float, up: float) -> Callable[[], None]:
        return lambda: flight.pilot.receive_sticks(Sticks(forward, 0.0, up, 0.0))

    flight.run(0.2, hold(0.0, 0.0))
    assert flight.pilot.request_mode(Mode.POSCTL) is Result.ACCEPTED
    assert flight.pilot.request_arm() is Result.ACCEPTED
    flight.run(5.0, hold(0.0, 1.0))
    assert flight.vehicle.state.d < -2.0
    flight.run(3.0, hold(0.3, 0.0))
    assert flight.vehicle.state.vn == pytest.approx(3.0, abs=0.3)
    flight.run(5.0, hold(0.0, 0.0))
    assert hypot(flight.vehicle.state.vn, flight.vehicle.state.ve) < 0.1
    flight.run(1.0)
    assert flight.pilot.commander.flown_mode is Mode.RTL


def test_same_seed_same_flight_and_another_seed_another() -> None:
    a, b, c = (Flight(seed).offboard().vehicle.state for seed in (5, 5, 6))
    assert a == b
    assert a != c


def test_parameter_table_names_types_and_ranges() -> None:
    assert list(TABLE) == sorted(TABLE)
    for spec in TABLE.values():
        assert spec.low <= spec.default <= spec.high, spec
        assert len(spec.name) <= 16
    assert {
        "COM_OF_LOSS_T",
        "COM_OBL_RC_ACT",
        "NAV_RCL_ACT",
        "NAV_DLL_ACT",
        "COM_DISARM_LAND",
        "COM_DISARM_PRFLT",
    } <= set(TABLE)
    assert find_parameter_problem({"MPC_XY_P": 1.0, "COM_OBL_RC_ACT": 5}) is None
    for bad, word in (
        ({"MPC_XY_Q": 1.0}, "known"),
        ({"MPC_XY_P": 99.0}, "between"),
        ({"COM_OBL_RC_ACT": 0.5}, "whole"),
    ):
        problem = find_parameter_problem(bad)
        assert problem is not None
        assert word in problem[1]


@pytest.mark.parametrize("period_ms", [2, 5, 7, 8, 10, 13, 16, 20, 25, 40, 50, 100])
def test_physics_step_divides_the_control_period(period_ms: int) -> None:
    step_us = step_for_period_us(1000 * period_ms)
    assert 1000 * period_ms % step_us == 0
    assert 1000 <= step_us <= 2500


def test_approach_speed_is_continuous_and_stops() -> None:
    speeds = [approach_speed(0.01 * i, 5.0, 3.0) for i in range(1000)]
    assert speeds[0] == 0.0
    assert speeds == sorted(speeds)
    assert max(b - a for a, b in pairwise(speeds)) < 0.02
    assert speeds[-1] == 5.0
