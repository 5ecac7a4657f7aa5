"""Masks, commands and telemetry against pymavlink's own decoder and encoder."""

import struct
from math import inf, nan, pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.config import MpcConfig, PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.control.tracker import accepted_motion
from sandwich_sitl.errors import LinkError
from sandwich_sitl.link.guard import Fence, fence_around, objection
from sandwich_sitl.link.inbox import Inbox
from sandwich_sitl.link.messages import Encoder
from sandwich_sitl.link.modes import mode_of
from sandwich_sitl.link.outbox import Outbox
from sandwich_sitl.link.telemetry import Telemetry
from sandwich_sitl.link.wire import FrameSplitter
from sandwich_sitl.mission.commands import Arm, ReadParameter, SetMessageInterval, SetMode, TakeOff
from sandwich_sitl.mission.setpoint import Setpoint
from sandwich_sitl.mission.vehicle_view import (
    AckOf,
    AckResult,
    Autopilot,
    CommandAck,
    FlightMode,
    StatusText,
    SystemStatus,
)

ORIGIN = (10.0, 20.0)
metres = st.floats(-1e3, 1e3, width=32)
vectors = st.tuples(metres, metres, metres).map(np.array)


def encoder(autopilot: Autopilot = Autopilot.PX4) -> Encoder:
    made = Encoder(245, 191, ORIGIN)
    made.address(1, 1, autopilot)
    return made


def read(raw: bytes) -> Any:
    return mavlink.MAVLink(None).decode(bytearray(raw))


class Vehicle:
    """Packs messages as the vehicle and feeds them to an inbox."""

    def __init__(self) -> None:
        self.mav = mavlink.MAVLink(None, 1, 1)
        self.splitter = FrameSplitter()
        self.frames: list[bytes] = []
        self.inbox = Inbox(Telemetry(ORIGIN, (245, 191)), lambda _t, _way, raw: self.frames.append(raw))
        self.say(self.mav.heartbeat_encode(2, 12, 29, 4 << 16 | 3 << 24, 3))

    def say(self, message: Any, sequence: int | None = None) -> None:
        self.mav.seq = (self.mav.seq + 1) % 256 if sequence is None else sequence
        self.inbox.take(self.splitter.feed_datagram(message.pack(self.mav)), 1.5)

    @property
    def view(self) -> Any:
        return self.inbox.telemetry.view(heard=True)


@given(vectors | st.none(), vectors | st.none(), vectors | st.none(), st.floats(-pi, pi))
def test_setpoint_masks_say_what_is_given(r: Any, v: Any, a: Any, yaw: float) -> None:
    setpoint = Setpoint(r, v, a, yaw)
    if r is None and v is None and a is None:
        with pytest.raises(LinkError):
            encoder().setpoint(setpoint, 40)
        return
    message = read(encoder().setpoint(setpoint, 40))
    assert (message.time_boot_ms, message.target_system, message.target_component) == (40, 1, 1)
    assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
    assert message.type_mask == 0x800 + 0x007 * (r is None) + 0x038 * (v is None) + 0x1C0 * (a is None)
    if r is not None:
        assert (message.y + 10.0, message.x + 20.0, -message.z) == pytest.approx(tuple(r), abs=1e-3)
    if v is not None:
        assert (message.vy, message.vx, -message.vz) == pytest.approx(tuple(v), abs=1e-3)
    if a is not None:
        assert (message.afy, message.afx, -message.afz) == pytest.approx(tuple(a), abs=1e-3)
    assert np.exp(1j * message.yaw) == pytest.approx(np.exp(1j * (pi / 2 - yaw)), abs=1e-5)


def test_idle_tick_ignores_every_axis_and_is_no_force() -> None:
    assert read(encoder().idle(20)).type_mask == 0xDFF


@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e30])
@pytest.mark.parametrize("field", ["r_m", "v_mps", "a_mps2"])
def test_setpoint_that_is_not_finite_is_never_encoded(field: str, bad: float) -> None:
    values = {"r_m": np.zeros(3), "v_mps": np.zeros(3), "a_mps2": np.zeros(3), field: np.array((0.0, bad, 0.0))}
    with pytest.raises(LinkError, match="finite"):
        encoder().setpoint(Setpoint(**values, yaw_rad=0.0), 0)
    with pytest.raises(LinkError, match="finite"):
        encoder().setpoint(Setpoint(np.zeros(3), None, None, nan), 0)


@pytest.mark.parametrize(
    ("autopilot", "mode", "parameters"),
    [
        (Autopilot.PX4, FlightMode.OFFBOARD, (1, 6, 0)),
        (Autopilot.PX4, FlightMode.LAND, (1, 4, 6)),
        (Autopilot.ARDUPILOT, FlightMode.OFFBOARD, (1, 4, 0)),
        (Autopilot.ARDUPILOT, FlightMode.LAND, (1, 9, 0)),
    ],
)
def test_mode_numbers(autopilot: Autopilot, mode: FlightMode, parameters: tuple[int, int, int]) -> None:
    message = read(encoder(autopilot).command(SetMode(mode)))
    assert message.command == 176
    assert (message.param1, message.param2, message.param3) == parameters


@pytest.mark.parametrize(
    ("custom_mode", "mode"),
    [(0x03040000, "loiter"), (0x02040000, "takeoff"), (0x00060000, "offboard"), (0x05040000, "rtl"),
     (0x06040000, "land"), (0x00030000, "position"), (0x12345678, "other")],
)  # fmt: skip
def test_modes_as_measured_on_px4(custom_mode: int, mode: str) -> None:
    assert mode_of(Autopilot.PX4, custom_mode) == mode


def test_mode_without_a_number_is_refused() -> None:
    with pytest.raises(LinkError, match="has no number"):
        encoder(Autopilot.UNKNOWN).command(SetMode(FlightMode.LAND))


def test_no_command_disarms() -> None:
    for command in (SetMode(FlightMode.LAND), Arm(), TakeOff(5.0), SetMessageInterval(32, 20000)):
        message = read(encoder().command(command))
        assert message.command != 400 or message.param1 == 1.0


def test_heartbeat_is_an_onboard_controllers() -> None:
    message = read(encoder().heartbeat())
    assert (message.type, message.autopilot, message.get_srcSystem(), message.get_srcComponent()) == (18, 8, 245, 191)


def test_telemetry_becomes_a_view() -> None:
    vehicle = Vehicle()
    mav = vehicle.mav
    vehicle.say(mav.heartbeat_encode(2, 12, 145, 6 << 16, 5))
    vehicle.say(mav.sys_status_encode(0, 0, 0x1320C83F, 0, 16000, 100, 77, 0, 0, 0, 0, 0, 0))
    vehicle.say(mav.extended_sys_state_encode(0, 1))
    vehicle.say(mav.local_position_ned_encode(12340, 3.0, 1.0, -2.0, 0.0, 4.0, 1.0))
    vehicle.say(mav.attitude_quaternion_encode(12340, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    vehicle.say(mav.attitude_encode(12350, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0))
    view = vehicle.view
    assert (view.autopilot, view.armed, view.mode) == (Autopilot.PX4, True, FlightMode.OFFBOARD)
    assert (view.system_status, view.landed, view.prearm_ok) == (SystemStatus.CRITICAL, True, True)
    assert (view.r_m.tolist(), view.v_mps.tolist()) == ([11.0, 23.0, 2.0], [4.0, 0.0, -1.0])
    assert (view.position_time_s, view.battery_percent, view.heartbeat_s) == (12.34, 77.0, 1.5)
    assert view.q_wxyz == pytest.approx([0.5**0.5, 0.0, 0.0, 0.5**0.5])


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("value", [nan, inf])
def test_a_position_that_is_no_number_is_not_taken_in(place: int, value: float) -> None:
    vehicle = Vehicle()
    vehicle.say(vehicle.mav.local_position_ned_encode(12340, 3.0, 1.0, -2.0, 0.0, 4.0, 1.0))
    broken = [value if k == place else 1.0 for k in range(6)]
    vehicle.say(vehicle.mav.local_position_ned_encode(12360, *broken))
    view = vehicle.view
    assert (view.r_m.tolist(), view.v_mps.tolist()) == ([11.0, 23.0, 2.0], [4.0, 0.0, -1.0])
    assert view.position_time_s == 12.34
    assert view.not_finite == ("LOCAL_POSITION_NED",)
    assert vehicle.view.not_finite == ()


@pytest.mark.parametrize("value", [nan, -inf])
def test_an_attitude_that_is_no_number_is_not_taken_in(value: float) -> None:
    vehicle = Vehicle()
    vehicle.say(vehicle.mav.attitude_encode(12340, 0.1, -0.2, 1.0, 0.0, 0.0, 0.0))
    before = vehicle.view.q_wxyz.tolist()
    vehicle.say(vehicle.mav.attitude_encode(12360, 0.1, value, 1.0, 0.0, 0.0, 0.0))
    vehicle.say(vehicle.mav.attitude_quaternion_encode(12380, 1.0, 0.0, 0.0, value, 0.0, 0.0, 0.0))
    view = vehicle.view
    assert view.q_wxyz.tolist() == before
    assert view.not_finite == ("ATTITUDE", "ATTITUDE_QUATERNION")


def test_what_the_autopilot_says_of_its_accuracy_stands_until_it_says_better() -> None:
    vehicle = Vehicle()

    def say(position_std_m: float) -> float | None:
        vehicle.say(vehicle.mav.estimator_status_encode(0, 831, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, position_std_m, 0.2))
        std_m: float | None = vehicle.view.position_std_m
        return std_m

    assert vehicle.view.position_std_m is None
    assert not vehicle.view.is_uncertain(0.0)
    assert say(nan) is None
    assert say(0.5) == 0.5
    assert vehicle.view.is_uncertain(0.49)
    assert not vehicle.view.is_uncertain(0.5)
    assert [say(word) for word in (nan, -1.0, -inf)] == [0.5] * 3
    assert say(inf) == inf
    assert vehicle.view.is_uncertain(1e6)


def test_status_texts_are_joined_and_handed_out_once() -> None:
    vehicle = Vehicle()
    long = "Arming denied: Resolve system health failures first, and some more of it"
    vehicle.say(vehicle.mav.statustext_encode(4, b"short"))
    vehicle.say(vehicle.mav.statustext_encode(2, long[:50].encode(), 9, 0))
    vehicle.say(vehicle.mav.statustext_encode(2, long[50:].encode(), 9, 1))
    assert vehicle.view.status_texts == (StatusText(4, "short"), StatusText(2, long))
    assert vehicle.view.status_texts == ()


def test_acknowledgements_for_others_are_left_out() -> None:
    vehicle = Vehicle()
    vehicle.say(vehicle.mav.command_ack_encode(176, 0, 0, 0, 245, 191))
    vehicle.say(vehicle.mav.command_ack_encode(176, 1, 0, 0, 0, 0))
    vehicle.say(vehicle.mav.command_ack_encode(400, 0, 0, 0, 255, 190))
    assert vehicle.view.acks == (
        CommandAck(AckOf.SET_MODE, AckResult.ACCEPTED),
        CommandAck(AckOf.SET_MODE, AckResult.TEMPORARILY_REJECTED),
    )


@given(st.integers(-(2**31), 2**31 - 1))
def test_px4_integer_parameters_are_bytewise(value: int) -> None:
    vehicle = Vehicle()
    raw = bytearray(vehicle.mav.param_value_encode(b"NAV_RCL_ACT", 0.0, 6, 1, 0).pack(vehicle.mav))
    raw[10:14] = struct.pack("<i", value)
    crc = mavlink.x25crc(bytes(raw[1:-2]) + bytes((mavlink.MAVLink_param_value_message.crc_extra,))).crc
    raw[-2:] = struct.pack("<H", crc)
    vehicle.inbox.take(vehicle.splitter.feed_datagram(bytes(raw)), 2.0)
    assert vehicle.view.parameters == {"NAV_RCL_ACT": value}


def test_a_ground_station_is_not_the_vehicle() -> None:
    inbox = Inbox(Telemetry(ORIGIN, (245, 191)), lambda *_: None)
    station = mavlink.MAVLink(None, 255, 190)
    raw = station.heartbeat_encode(6, 8, 0, 0, 4).pack(station)
    assert not inbox.take(FrameSplitter().feed_datagram(raw), 0.0)
    assert inbox.vehicle is None


def test_losses_are_counted_and_duplicates_are_not() -> None:
    vehicle = Vehicle()
    start = vehicle.mav.seq
    message = vehicle.mav.extended_sys_state_encode(0, 1)
    for step in (1, 2, 2, 5, 4, 6, 300):
        vehicle.say(message, (start + step) % 256)
    assert vehicle.inbox.lost == 2 + 37  # 3 and 4 were missing at 5; 7 to 43 at 300 - 256


@given(st.binary(max_size=30), st.integers(1, 40))
def test_frames_survive_noise_and_any_cut_of_the_stream(noise: bytes, piece: int) -> None:
    noise = noise.replace(b"\xfd", b"\x00").replace(b"\xfe", b"\x00")
    vehicle = mavlink.MAVLink(None, 1, 1)
    raws = [vehicle.system_time_encode(0, number).pack(vehicle) for number in range(5)]
    stream = noise + raws[0] + raws[1] + noise + raws[2] + raws[3] + noise + raws[4]
    splitter = FrameSplitter()
    frames = [f for i in range(0, len(stream), piece) for f in splitter.feed(stream[i : i + piece])]
    assert [frame.raw for frame in frames] == raws


def test_damaged_frames_are_dropped_and_old_and_signed_ones_read() -> None:
    vehicle = mavlink.MAVLink(None, 1, 1)
    good = vehicle.system_time_encode(0, 7).pack(vehicle)
    old = vehicle.system_time_encode(0, 8).pack(vehicle, force_mavlink1=True)
    vehicle.signing.secret_key, vehicle.signing.sign_outgoing = b"k" * 32, True
    signed = vehicle.system_time_encode(0, 9).pack(vehicle)
    splitter = FrameSplitter()
    frames = splitter.feed_datagram(good[:-1] + bytes((good[-1] ^ 1,)) + old + signed + good)
    assert [frame.raw for frame in frames] == [old, signed, good]
    assert splitter.damaged == 1


def test_requests_are_repeated_three_times_and_struck_off_when_answered() -> None:
    box = Outbox(encoder())
    box.order([SetMessageInterval(32, 20000), ReadParameter("COM_OF_LOSS_T")])
    sent = [len(box.due(tick * 0.02)) for tick in range(26)]
    assert sent == [2] + [0] * 24 + [2]
    box.answered(1, {})
    assert [len(box.due(now)) for now in (1.0, 1.5, 2.0)] == [1, 0, 0]
    assert box.unanswered == [ReadParameter("COM_OF_LOSS_T")]


def test_mode_changes_are_sent_once_and_never_repeated_by_the_link() -> None:
    box = Outbox(encoder())
    assert len(box.order([SetMode(FlightMode.OFFBOARD), Arm()])) == 2
    assert all(box.due(tick * 0.1) == [] for tick in range(50))


PERIOD_S = 0.02
FENCE = fence_around((0.0, 0.0, 50.0, 40.0), 10.0, speed_mps=3.0, acceleration_mps2=3.0)
INSIDE = np.array((10.0, 10.0, 5.0))
NEXT = np.array((10.7, 10.0, 5.0))
FAR = np.array((21.0, 10.0, 5.0))


@pytest.mark.parametrize(
    ("setpoint", "words"),
    [
        (Setpoint(np.array((nan, 0.0, 0.0)), None, None, 0.0), "outside"),
        (Setpoint(np.array((60.0, 10.0, 5.0)), None, None, 0.0), "outside"),
        (Setpoint(np.array((10.0, 10.0, 15.5)), None, None, 0.0), "outside"),
        (Setpoint(INSIDE, np.array((nan, 0.0, 0.0)), None, 0.0), "velocity"),
        (Setpoint(INSIDE, np.array((0.0, 21.0, 0.0)), None, 0.0), "velocity"),
        (Setpoint(INSIDE, None, np.array((0.0, 0.0, inf)), 0.0), "acceleration"),
        (Setpoint(INSIDE, None, None, nan), "yaw"),
        (Setpoint(NEXT, None, None, 0.0), "last setpoint"),
        (Setpoint(INSIDE, None, None, 0.0), None),
    ],
)  # fmt: skip
def test_fence(setpoint: Setpoint, words: str | None) -> None:
    reason = objection(setpoint, Setpoint(INSIDE, None, None, 0.0), PERIOD_S, INSIDE, FENCE)
    assert (reason is None) if words is None else (reason is not None and words in reason)


@pytest.mark.parametrize(("since_s", "refused"), [(0.0233, True), (0.0234, False), (0.3, False)])
def test_the_fence_bounds_a_speed_so_that_after_a_pause_the_next_setpoint_may_lie_further_on(
    since_s: float, refused: bool
) -> None:
    """0.7 m at 30 m/s take 0.02333 s."""
    reason = objection(Setpoint(NEXT, None, None, 0.0), Setpoint(INSIDE, None, None, 0.0), since_s, INSIDE, FENCE)
    assert (reason is not None) == refused


@pytest.mark.parametrize("rate_hz", [50.0, 250.0, 500.0])
@pytest.mark.parametrize(("height_m", "refused"), [(0.2, False), (0.65, True)])
def test_the_push_off_passes_the_fence_at_every_rate_and_no_leap_does(
    rate_hz: float, height_m: float, refused: bool
) -> None:
    up = Setpoint(INSIDE + np.array((0.0, 0.0, height_m)), np.array((0.0, 0.0, 0.5)), None, 0.0)
    reason = objection(up, Setpoint(INSIDE, None, None, 0.0), 1.0 / rate_hz, INSIDE, FENCE)
    assert (reason is not None) == refused


@pytest.mark.parametrize(("speed_mps", "acceleration_mps2"), [(12.0, 6.0), (33.0, 25.0)])
def test_the_fence_lets_everything_pass_that_a_plan_may_do(speed_mps: float, acceleration_mps2: float) -> None:
    """A plan is accepted up to its bounds across and along z at once; in a period it goes no further than that."""
    config = RunConfig(
        world=WorldConfig(bounds_m=(0, 0, 50, 40)), start_m=(0, 0), goal_m=(20, 0), altitude_m=10,
        planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6),
        mpc=MpcConfig(speed_mps=speed_mps, acceleration_mps2=acceleration_mps2, tilt_deg=79.0),
    )  # fmt: skip
    across, climb, push, lift, _ = accepted_motion(config)
    v_mps, a_mps2 = np.array((across, 0.0, climb)), np.array((push, 0.0, lift))
    fence = fence_around((0.0, 0.0, 50.0, 40.0), 10.0, np.hypot(across, climb), np.hypot(push, lift))
    on = Setpoint(INSIDE + PERIOD_S * v_mps, v_mps, a_mps2, 0.0)
    assert objection(on, Setpoint(INSIDE, v_mps, a_mps2, 0.0), PERIOD_S, INSIDE, fence) is None
    east = np.array((1.0, 0.0, 0.0))
    faster = Setpoint(INSIDE, 1.01 * max(20.0, np.hypot(across, climb)) * east, None, 0.0)
    assert "velocity" in str(objection(faster, None, PERIOD_S, INSIDE, fence))
    harder = Setpoint(INSIDE, None, 1.01 * max(20.0, np.hypot(push, lift)) * east, 0.0)
    assert "acceleration" in str(objection(harder, None, PERIOD_S, INSIDE, fence))


def test_fence_keeps_setpoints_near_the_vehicle() -> None:
    far = objection(Setpoint(INSIDE, None, None, 0.0), None, PERIOD_S, FAR, Fence((0, 0, 50, 40), (0, 20)))
    assert far is not None
    assert "from the vehicle" in far
