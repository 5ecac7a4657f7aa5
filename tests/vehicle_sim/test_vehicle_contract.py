"""PX4's behaviour row by row, as MAVLink messages; and the vehicle's own state table, walked row by row.

The names `row_NN` are the rows of the description of PX4 that the vehicle follows; what was measured on PX4 is stated as numbers.
"""

import itertools
import math
import struct
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.commander import Commander, Links
from vehicle_sim.autopilot.contract import TABLE, Effect, Event, Fact, find_row
from vehicle_sim.autopilot.failsafe import FAILSAFES, POLICY, Decision, Reason, decide
from vehicle_sim.autopilot.modes import MODE_TABLE, Mode, Need, runnable
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.endpoints import parse_endpoints
from vehicle_sim.parts import BatteryConfig

from .node_client import (
    LAND,
    LOITER,
    OFFBOARD,
    RTL,
    Client,
    beat,
    gcs_heartbeat,
    in_offboard,
    named,
    new_client,
    setpoint,
    stream,
    texts,
)


@pytest.fixture
def client() -> Client:
    return new_client()


@pytest.fixture
def flying() -> Client:
    return in_offboard(new_client(parameters={"RTL_RETURN_ALT": 6.0}))


def test_row_01_frames_and_targets_of_setpoints(client: Client) -> None:
    client.send(gcs_heartbeat())
    client.run(0.1)
    pilot = client.node.vehicle.autopilot
    for frame in (7, 9):
        assert texts(client.send(setpoint(frame=frame))) == [
            f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported"
        ]
    client.send(setpoint(system=9))
    assert not pilot.offboard_signal()
    for frame, mask in ((1, 0), (8, 0b111000111)):
        fresh = new_client()
        fresh.run(0.1)
        fresh.send(setpoint(frame=frame, mask=mask))
        assert fresh.node.vehicle.autopilot.offboard_signal(), frame


def test_row_02_and_03_masks_force_and_nan(client: Client) -> None:
    client.send(gcs_heartbeat())
    client.run(0.1)
    assert texts(client.send(setpoint(mask=0xDFF))) == ["SET_POSITION_TARGET_LOCAL_NED invalid"]
    assert texts(client.send(setpoint((math.nan,) * 3, mask=0b111111000))) == ["SET_POSITION_TARGET_LOCAL_NED invalid"]
    assert texts(client.send(setpoint(mask=0x200))) == ["SET_POSITION_TARGET_LOCAL_NED force not supported"]
    assert not client.node.vehicle.autopilot.offboard_signal()


def test_row_04_one_message_is_proof_of_life_for_com_of_loss_t(client: Client) -> None:
    client.run(1.0)
    client.send(setpoint())
    pilot = client.node.vehicle.autopilot
    client.run(0.9)
    assert pilot.offboard_signal()
    client.run(0.2)
    assert not pilot.offboard_signal()


def test_row_05_accelerations_fly_without_a_position_and_positions_do_not() -> None:
    for mask, flown in ((0b000111111, OFFBOARD), (0b111111000, LAND)):
        client = in_offboard(new_client(parameters={"SYS_FAILURE_EN": 1}))
        assert client.results(420, 4, 1) == [0]
        position = (0.0, 0.0, -3.0)
        heard = stream(client, 6.5, setpoint(position, mask=mask))
        assert beat(heard)[0] == flown


def test_row_06_modes_disarmed_and_armed(client: Client, flying: Client) -> None:
    client.run(5.0)
    for main, sub in ((6, 0), (3, 0), (4, 4), (4, 6)):
        assert client.results(176, 1, main, sub) == [0, 0]
        assert client.results(400, 1) == [1]
    assert flying.results(176, 1, 3, 0) == [0, 1]
    assert flying.results(176, 1, 4, 4) == [0, 1]


def test_row_07_do_set_mode_is_acknowledged_twice(client: Client) -> None:
    client.run(5.0)
    assert client.results(176, 1, 6, 0) == [0, 0]
    assert client.results(400, 1) == [1]
    assert client.results(176, 1, 4, 3) == [0, 0]
    assert client.results(400, 1) == [0]
    assert client.results(176, 1, 6, 0) == [0, 1]
    assert "Switching to Offboard is currently not available" in [text.text for _, text in client.node.journal.texts]


def test_row_08_mode_numbers_in_heartbeat_by_hand(flying: Client) -> None:
    flying.send(gcs_heartbeat())
    assert beat(stream(flying, 1.1)) == (0x00060000, 145, 4)
    for (main, sub), shown in {(4, 3): 0x03040000, (4, 5): 0x05040000, (4, 6): 0x06040000}.items():
        flying.command(176, 1, main, sub)
        assert beat(flying.run(1.1)) == (shown, 157, 4)


def test_row_09_arming_and_disarming_refused(flying: Client) -> None:
    early = new_client()
    early.send(gcs_heartbeat())
    early.run(1.0)
    heard = early.command(400, 1)
    assert [m.result for m in named(heard, "COMMAND_ACK")] == [1]
    assert texts(heard) == ["Arming denied: Resolve system health failures first"]
    heard = flying.command(400, 0)
    assert [m.result for m in named(heard, "COMMAND_ACK")] == [1]
    assert texts(heard) == ["Disarming denied: not landed"]
    assert flying.results(400, 0, 21196) == [0]
    assert not beat(flying.run(1.1))[1] & 128


@pytest.mark.parametrize(("wait_s", "armed"), [(9.5, True), (11.0, False)])
def test_row_10_auto_disarm_on_the_ground(client: Client, wait_s: float, armed: bool) -> None:
    client.run(5.0)
    assert client.results(400, 1) == [0]
    client.run(wait_s)
    assert client.node.vehicle.autopilot.commander.armed is armed


def test_row_10_auto_disarm_after_landing(flying: Client) -> None:
    flying.command(176, 1, 4, 6)
    pilot = flying.node.vehicle.autopilot
    while not pilot.landed:
        flying.run(0.1)
        assert flying.node.vehicle.t_s < 60
    landed_s = flying.node.vehicle.t_s
    while pilot.commander.armed:
        flying.run(0.1)
        assert flying.node.vehicle.t_s < landed_s + 5
    assert flying.node.vehicle.t_s - landed_s == pytest.approx(2.0, abs=0.25)


def test_row_11_heartbeat(client: Client) -> None:
    beats = named(client.run(10.0), "HEARTBEAT")
    assert len(beats) == 10
    assert {(b.type, b.autopilot) for b in beats} == {(2, 12)}
    assert [b.system_status for b in beats] == [0, 0, 0, 0, *([3] * 6)]


def test_row_12_offboard_loss_returns_lands_and_shows_offboard_again(flying: Client) -> None:
    stream(flying, 0.2)
    sent_s = flying.node.vehicle.t_s - 0.05
    while flying.node.vehicle.autopilot.commander.decision.reason is None:
        flying.run(0.01)
        assert flying.node.vehicle.t_s < sent_s + 3
    assert flying.node.vehicle.t_s - sent_s == pytest.approx(1.07, abs=0.06)
    heard = flying.run(1.1)
    assert beat(heard) == (RTL, 157, 5)
    assert "Failsafe activated" in [text.text for _, text in flying.node.journal.texts]
    heard = flying.run(60.0)
    assert beat(heard)[0] == OFFBOARD
    assert not beat(heard)[1] & 128


def test_row_12_a_stream_that_resumes_takes_offboard_back(flying: Client) -> None:
    assert beat(flying.run(3.0))[0] == RTL
    assert beat(stream(flying, 2.0)) == (OFFBOARD, 145, 4)


def test_row_13_sticks_do_not_end_offboard_unless_com_rc_override_says_so() -> None:
    for override, mode in ((1, OFFBOARD), (2, 0x00030000)):
        client = in_offboard(new_client(parameters={"COM_RC_OVERRIDE": override}))
        for deflection in (0, 0, 600, 700):
            client.send(mavlink.MAVLink_manual_control_message(1, deflection, 0, 500, 0, 0))
            client.send(setpoint())
            client.run(0.1)
        assert client.node.vehicle.autopilot.commander.flown_mode.custom_mode == mode, override


@pytest.mark.parametrize(("action", "mode"), [(0, OFFBOARD), (1, LOITER), (2, RTL), (3, LAND)])
def test_row_14_ground_station_loss(action: int, mode: int) -> None:
    client = in_offboard(new_client(parameters={"NAV_DLL_ACT": action}))
    assert beat(stream(client, 5.0))[0] == mode


@pytest.mark.parametrize(("action", "mode"), [(0, OFFBOARD), (2, LAND), (3, RTL)])
def test_row_15_battery_levels_and_actions(action: int, mode: int) -> None:
    pack = BatteryConfig(capacity_ah=5.0, initial_charge=0.35)
    client = in_offboard(new_client(battery=pack, parameters={"COM_LOW_BAT_ACT": action}))
    client.node.vehicle.flight.battery[0] = 0.149
    heard = stream(client, 1.2)
    client.node.vehicle.flight.battery[0] = 0.069
    heard += stream(client, 1.2)
    said = [text for text in texts(heard) if "attery" in text]
    assert said[:2] == ["Low battery level", "Critical battery"]
    assert beat(heard)[0] == mode
    client.node.vehicle.flight.battery[0] = 0.049
    heard = stream(client, 1.2)
    assert [text for text in texts(heard) if "attery" in text][:1] == ["Emergency battery level"]
    assert beat(heard)[0] == (LAND if action else OFFBOARD)


def test_row_16_rates_within_five_percent(client: Client) -> None:
    client.run(6.0)
    counts = Counter(m.get_type() for m in client.run(20.0))
    expected = {
        "ATTITUDE": 100, "HIGHRES_IMU": 50, "ATTITUDE_QUATERNION": 50, "GLOBAL_POSITION_INT": 50, "ODOMETRY": 30,
        "LOCAL_POSITION_NED": 30, "TIMESYNC": 10, "ALTITUDE": 10, "VFR_HUD": 10, "SERVO_OUTPUT_RAW": 10,
        "ATTITUDE_TARGET": 10, "POSITION_TARGET_LOCAL_NED": 10, "GPS_RAW_INT": 8, "SYS_STATUS": 5,
        "EXTENDED_SYS_STATE": 5, "HEARTBEAT": 1, "ESTIMATOR_STATUS": 1, "SYSTEM_TIME": 1, "PING": 1,
        "SCALED_PRESSURE": 1, "HOME_POSITION": 0.5, "BATTERY_STATUS": 0.5, "VIBRATION": 0.5,
    }  # fmt: skip
    assert {name: counts[name] / 20 for name in expected} == pytest.approx(expected, rel=0.05)
    client.node.advance_to(client.node.vehicle.t_us + 20_000_000)
    frames = client.take()
    assert sum(frame[7:10] == (436).to_bytes(3, "little") for frame in frames) == 10  # CURRENT_MODE


def test_row_17_ports_of_instances() -> None:
    for instance in (0, 3):
        (endpoint,) = parse_endpoints(["udpout://127.0.0.1:14540"], None, instance)
        assert (endpoint.bind, endpoint.target) == (("127.0.0.1", 14580 + instance), ("127.0.0.1", 14540 + instance))


def test_failed_sensors_show_in_the_telemetry() -> None:
    client = new_client(parameters={"SYS_FAILURE_EN": 1})
    healthy = named(client.run(6.0), "SYS_STATUS")[-1].onboard_control_sensors_health
    assert client.results(420, 4, 1) == client.results(420, 2, 1) == [0]
    assert client.results(420, 0, 1) == [3]
    heard = client.run(1.0)
    assert healthy & 0x24 == 0x24
    assert named(heard, "SYS_STATUS")[-1].onboard_control_sensors_health & 0x24 == 0
    assert named(heard, "GPS_RAW_INT")[-1].fix_type == 1
    assert new_client().results(420, 4, 1) == [2]


def test_row_18_timesync(client: Client) -> None:
    client.run(1.5)
    (answer,) = named(client.send(mavlink.MAVLink_timesync_message(0, 12345)), "TIMESYNC")
    assert (answer.tc1, answer.ts1) == (1_500_000_000, 12345)


def test_row_19_parameters_are_bytewise_and_typed(client: Client) -> None:
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = named(client.run(2.0), "PARAM_VALUE")
    assert values[0].param_id == "_HASH_CHECK"
    action = next(v for v in values if v.param_id == "NAV_RCL_ACT")
    assert (action.param_type, struct.unpack("<i", struct.pack("<f", action.param_value))[0]) == (6, 2)
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"NAV_RCL_ACT", 3.0, 9))
    assert client.node.vehicle.autopilot.parameters.integer("NAV_RCL_ACT") == 2


def test_row_20_requests_and_refusals(client: Client) -> None:
    client.run(5.0)
    assert client.results(512, 9999) == [2]
    assert client.results(512, 395) == [2]
    assert client.results(512, 259) == [2]
    assert client.results(512, 148) == [0]
    assert client.results(511, 9999, 100000) == [4]
    assert client.results(511, 30, 0) == [0]
    assert client.results(9999) == [3]
    assert client.command(400, 1, system=7) == []
    message = mavlink.MAVLink_command_long_message(1, 100, 512, 0, 259, 0, 0, 0, 0, 0, 0)
    assert client.send(message) == []
    bad_frame = mavlink.MAVLink_command_int_message(1, 1, 3, 192, 0, 0, -1, 1, 0, 0, 0, 0, 500)
    assert [m.result for m in named(client.send(bad_frame), "COMMAND_ACK")] == [9]


def test_row_22_takeoff_in_offboard_by_a_setpoint_above_or_upward_velocity() -> None:
    for message, leaves in (
        (setpoint((0, 0, -2)), True),
        (setpoint((0, 0, 0.1)), False),
        (
            mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0b111000111, 0, 0, 0, 0, 0, -1, *[0] * 5),
            True,
        ),
        (
            mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0b111000111, 0, 0, 0, 0, 0, 1, *[0] * 5),
            False,
        ),
    ):
        client = new_client()
        stream(client, 4.6, message)
        client.command(176, 1, 6)
        assert client.results(400, 1) == [0]
        stream(client, 5.0, message)
        assert (client.node.vehicle.state.d < -0.5) is leaves


def test_row_24_what_mavsdk_needs(client: Client) -> None:
    heard = client.run(6.0)
    status = named(heard, "SYS_STATUS")[-1]
    for bit in (0x1, 0x2, 0x4, 0x20):
        assert status.onboard_control_sensors_present & bit
        assert status.onboard_control_sensors_health & bit
    assert status.onboard_control_sensors_health & 0x10000000  # pre-arm checks
    assert named(heard, "HOME_POSITION")
    (version,) = named(client.command(512, 148), "AUTOPILOT_VERSION")
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT


def test_geofence_acts_and_the_uploaded_zone_counts() -> None:
    for action, mode in ((0, OFFBOARD), (1, OFFBOARD), (2, LOITER), (3, RTL), (5, LAND)):
        client = in_offboard(new_client(parameters={"GF_ACTION": action, "GF_MAX_HOR_DIST": 3.0}))
        assert beat(stream(client, 4.5, setpoint((6.0, 0.0, -3.0))))[0] == mode, action
    client = in_offboard(new_client(parameters={"GF_MAX_VER_DIST": 4.0, "GF_ACTION": 2}))
    assert beat(stream(client, 4.0, setpoint((0.0, 0.0, -9.0))))[0] == LOITER


# --- the table itself -----------------------------------------------------------------------------------------------------


def situations() -> Iterator[tuple[Commander, float, Links, Mode | None]]:
    """Every combination of the settings that the facts depend on."""
    for armed, landed, flown, good, mode, asked, waited, lost in itertools.product(
        (False, True),
        (False, True),
        (False, True),
        (False, True),
        (Mode.LOITER, Mode.LAND, Mode.MISSION),
        (None, Mode.RTL, Mode.MISSION),
        (False, True),
        (False, True),
    ):
        commander = Commander(ParameterStore({"NAV_DLL_ACT": 6 if lost else 0}, 0.5))
        commander.health.landed, commander.health.estimate_good = landed, good
        commander.armed, commander.has_flown, commander.mode = armed, flown, mode
        t_s = 30.0 if waited else 5.0
        commander._armed_s = commander._landed_s = 0.0 if waited else 4.0
        links = Links() if lost else Links(gcs_s=t_s)
        commander._decide(t_s, links)
        yield commander, t_s, links, asked


def test_every_row_of_the_table_is_reached_and_does_what_it_says() -> None:
    reached = set()
    for event in Event:
        for commander, t_s, links, asked in situations():
            facts = commander.facts(t_s, links, asked)
            row = find_row(event, facts)
            reached.add(TABLE.index(row))
            before = (commander.armed, commander.mode)
            commander.texts.clear()
            result = commander.request(event, t_s, links, asked)
            assert row.result is None or result is row.result
            label = MODE_TABLE[asked].label if asked is not None else ""
            assert [text.text for text in commander.texts] == ([row.text.format(mode=label)] if row.text else [])
            after = {
                Effect.NOTHING: before,
                Effect.ARM: (True, before[1]),
                Effect.DISARM: (False, before[1]),
                Effect.SET_MODE: (before[0], asked),
                Effect.OVERRIDE: (before[0], asked),
                Effect.TERMINATE: (before[0], Mode.TERMINATE),
            }[row.effect]
            assert (commander.armed, commander.mode) == after, (row, Fact(facts))
    assert reached == set(range(len(TABLE)))


def test_safety_laws_hold_for_all_facts() -> None:
    """Said without the table: what may never happen, whatever is known."""
    for facts in range(1 << len(Fact)):
        known = Fact(facts)
        arm, disarm, mode = (find_row(event, facts) for event in (Event.ARM, Event.DISARM, Event.MODE))
        if arm.effect is Effect.ARM:
            assert Fact.HEALTHY in known
            assert Fact.MODE_RUNNABLE in known
        if disarm.effect is Effect.DISARM:
            assert Fact.LANDED in known
        if mode.effect in (Effect.SET_MODE, Effect.OVERRIDE) and Fact.ARMED in known:
            assert Fact.ASKED_RUNNABLE in known
        if find_row(Event.TICK, facts).effect is Effect.DISARM:
            assert Fact.LANDED in known or Fact.FAILSAFE_DISARMS in known


@pytest.mark.parametrize("row", FAILSAFES, ids=lambda row: f"{row.reason.name}-{row.parameter}-{row.value}")
def test_every_failsafe_row_acts(row: Any) -> None:
    store = ParameterStore({row.parameter: row.value}, 0.5)
    policy = tuple(store.integer(name) for name in POLICY)
    present = int(Need.LOCAL_POSITION | Need.OFFBOARD_SIGNAL | Need.OFFBOARD_POSITION)
    causes: frozenset[Reason] = frozenset({row.reason})
    if row.reason is Reason.OFFBOARD_LOST:
        present, causes = int(Need.LOCAL_POSITION | Need.MANUAL_CONTROL), frozenset()
    decision = decide(Mode.OFFBOARD, present, causes, policy)
    by_action = {"NONE": Mode.OFFBOARD, "WARN": Mode.OFFBOARD, "HOLD": Mode.LOITER, "RETURN": Mode.RTL}
    by_action |= {"LAND": Mode.LAND, "TERMINATE": Mode.TERMINATE, "DISARM": Mode.OFFBOARD}
    assert decision.mode is (row.fallback or by_action[row.action.name])
    assert decision.disarm is (row.action.name == "DISARM")


def test_a_failsafe_never_ends_in_a_mode_that_cannot_be_flown() -> None:
    store = ParameterStore({}, 0.5)
    policies = [
        tuple(value if name == row.parameter else store.integer(name) for name in POLICY)
        for row in FAILSAFES
        for value in (row.value,)
    ]
    needs = [
        int(sum(combination)) for n in range(6) for combination in itertools.combinations([int(x) for x in Need], n)
    ]
    for mode, present, policy in itertools.product(Mode, needs, policies):
        for causes in (frozenset[Reason](), frozenset({Reason.GCS_LOST}), frozenset(row.reason for row in FAILSAFES)):
            decision = decide(mode, present, causes, policy)
            assert isinstance(decision, Decision)
            assert runnable(decision.mode, present) or decision.disarm, (mode, Need(present), policy, decision)
