"""MAVLink towards clients, without a socket: commands and results, parameters, streams, malformed input."""

import random
import struct
from collections import Counter
from math import degrees, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.results import Severity, Text
from vehicle_sim.config import VehicleConfig
from vehicle_sim.parts import HomeConfig
from vehicle_sim.protocol.codec import Codec, split_frames
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

from .node_client import CLIENT, EXACT, OTHER, Client, named


@pytest.fixture
def client() -> Client:
    return Client(Node(Vehicle(VehicleConfig(sensors=EXACT, initial_yaw_deg=90.0), 1), lockstep=False))


def test_streams_run_at_the_onboard_rates(client: Client) -> None:
    client.run(6.0)
    counts = Counter(m.get_type() for m in client.run(10.0))
    expected = {
        **dict.fromkeys(("HIGHRES_IMU", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT"), 50),
        **dict.fromkeys(("LOCAL_POSITION_NED", "ODOMETRY"), 30),
        **dict.fromkeys(("TIMESYNC", "ALTITUDE", "VFR_HUD", "SERVO_OUTPUT_RAW", "ATTITUDE_TARGET"), 10),
        **dict.fromkeys(("SYS_STATUS", "EXTENDED_SYS_STATE"), 5),
        **dict.fromkeys(
            ("HEARTBEAT", "ESTIMATOR_STATUS", "SYSTEM_TIME", "PING", "SCALED_PRESSURE", "MISSION_CURRENT"), 1
        ),
        **dict.fromkeys(("HOME_POSITION", "BATTERY_STATUS", "VIBRATION"), 0.5),
        "POSITION_TARGET_LOCAL_NED": 10,
        "ATTITUDE": 100,
        "GPS_RAW_INT": 8,
    }
    assert {name: count / 10 for name, count in counts.items()} == pytest.approx(expected, rel=0.02)


def test_fields_of_the_state_by_hand(client: Client) -> None:
    messages = client.run(6.0)
    heartbeat = named(messages, "HEARTBEAT")[-1]
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.base_mode, heartbeat.custom_mode) == (2, 12, 29, 0x03040000)
    assert [m.system_status for m in named(messages, "HEARTBEAT")] == [0, 0, 0, 0, 3, 3]
    assert degrees(named(messages, "ATTITUDE")[-1].yaw) == pytest.approx(90.0, abs=0.01)
    place = named(messages, "GLOBAL_POSITION_INT")[-1]
    home = HomeConfig()
    assert (place.lat, place.lon, place.hdg) == (round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), 9000)
    assert place.alt == 488_000
    imu = named(messages, "HIGHRES_IMU")[-1]
    assert imu.zacc == pytest.approx(-9.807, abs=0.3)  # at rest the accelerometer points up, which is -z
    assert imu.ymag == pytest.approx(-0.212, abs=0.02)  # facing east, north is on the left
    status = named(messages, "SYS_STATUS")[-1]
    sensors = 0x1 | 0x2 | 0x4 | 0x20
    needed = sensors | 0x10000000
    assert status.onboard_control_sensors_present & sensors == sensors
    assert status.onboard_control_sensors_health & needed == needed
    assert not named(messages, "SYS_STATUS")[0].onboard_control_sensors_health & 0x10000000
    assert named(messages, "GPS_RAW_INT")[-1].fix_type == 3
    assert named(messages, "EXTENDED_SYS_STATE")[-1].landed_state == 1
    assert named(messages, "HOME_POSITION")[-1].latitude == round(home.latitude_deg * 1e7)


def test_state_north_east_and_up_have_the_right_signs(client: Client) -> None:
    vehicle = client.node.vehicle
    client.run(5.0)
    vehicle.state = vehicle.state._replace(n=10.0, e=20.0, d=-30.0, vn=1.0, ve=2.0, vd=-3.0)
    client.receive()
    for name in (32, 33, 141, 74):
        assert client.results(512, name) == [0]
    client.command(512, 32)
    local, place, altitude, hud = (
        next(m for m in client.command(512, number) if m.get_type() != "COMMAND_ACK") for number in (32, 33, 141, 74)
    )
    assert (local.x, local.y, local.z) == pytest.approx((10, 20, -30), abs=0.01)
    home = HomeConfig()
    assert (place.lat / 1e7 - home.latitude_deg) * 111_190 == pytest.approx(10.0, abs=0.1)
    assert (place.lon / 1e7 - home.longitude_deg) * 75_400 == pytest.approx(20.0, abs=0.1)
    assert (place.relative_alt, place.vx, place.vy, place.vz) == (30_000, 100, 200, -300)
    assert altitude.altitude_relative == pytest.approx(30.0, abs=0.02)
    assert hud.climb == pytest.approx(3.0, abs=0.05)


def test_results_of_commands_as_measured(client: Client) -> None:
    client.run(5.0)
    assert client.results(9999) == [3]
    assert client.results(512, 9999) == [2]
    assert client.results(512, 148) == [0]
    assert client.results(511, 9999, 100000) == [4]
    assert client.results(511, 30, 0) == [0]
    assert client.results(176, 1, 9, 0) == [0, 1]
    assert client.results(176, 1, 4, 9) == [0, 1]
    assert client.results(176, 1, 0x00060000, 0) == [0, 1]
    assert client.results(176, nan, nan, nan) == [0, 1]
    assert client.results(176, 1, 6, 0) == [0, 0]
    assert client.results(400, 1) == [1]
    assert client.results(400, nan) == [2]
    assert client.results(176, 1, 4, 3) == [0, 0]
    assert client.results(400, 1) == [0]
    assert client.results(176, 1, 6, 0) == [0, 1]
    assert client.command(400, 1, system=7) == []


def test_acknowledgement_names_the_sender_and_int_frames_are_checked(client: Client) -> None:
    client.run(5.0)
    for frame, result in ((5, 0), (0, 0), (3, 9), (6, 9)):
        message = mavlink.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, 1, 0, nan, 473977420, 85455940, 500)
        (acknowledgement,) = named(client.send(message), "COMMAND_ACK")
        assert acknowledgement.result == result
        assert (acknowledgement.target_system, acknowledgement.target_component) == (245, 190)


def test_message_intervals_are_a_clients_own(client: Client) -> None:
    other = Client(client.node, OTHER)
    assert client.results(511, 30, 1e6) == [0]
    assert client.results(511, 105, -1) == [0]
    mine = Counter(m.get_type() for m in client.run(2.0))
    theirs = Counter(m.get_type() for m in other.receive())
    assert (mine["ATTITUDE"], mine["HIGHRES_IMU"]) == (2, 0)
    assert (theirs["ATTITUDE"], theirs["HIGHRES_IMU"]) == (200, 100)
    interval = named(client.command(510, 30), "MESSAGE_INTERVAL")[0]
    assert interval.interval_us == 1_000_000
    client.command(511, 30, 0)
    assert Counter(m.get_type() for m in client.run(1.0))["ATTITUDE"] == 100


def test_texts_go_to_ground_stations_alone_in_chunks(client: Client) -> None:
    other = Client(client.node, OTHER)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    other.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    long = "".join(chr(65 + i % 26) for i in range(120))
    client.node.vehicle.autopilot.commander.texts.append(Text(Severity.INFO, long))
    chunks = named(client.run(0.1), "STATUSTEXT")
    assert "".join(chunk.text for chunk in chunks) == long
    assert [chunk.chunk_seq for chunk in chunks] == [0, 1, 2]
    assert len({chunk.id for chunk in chunks}) == 1
    assert chunks[0].id != 0
    assert named(other.receive(), "STATUSTEXT") == []
    assert [text.text for _, text in client.node.journal.texts] == [long]


def test_time_and_ping_are_answered_from_the_boot_clock(client: Client) -> None:
    client.run(1.5)
    (answer,) = named(client.send(mavlink.MAVLink_timesync_message(0, 12345)), "TIMESYNC")
    assert (answer.tc1, answer.ts1) == (client.node.vehicle.t_us * 1000, 12345)
    assert client.send(mavlink.MAVLink_timesync_message(5, 12345)) == []
    (pong,) = named(client.send(mavlink.MAVLink_ping_message(77, 3, 0, 0)), "PING")
    assert (pong.time_usec, pong.seq, pong.target_system, pong.target_component) == (77, 3, 245, 190)


def test_parameter_list_is_complete_and_bytewise(client: Client) -> None:
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = named(client.run(2.0), "PARAM_VALUE")
    assert values[0].param_id == "_HASH_CHECK"
    assert values[0].param_index == 65535
    assert [v.param_index for v in values[1:]] == list(range(values[0].param_count))
    by_name = {v.param_id: v for v in values}
    assert by_name["COM_OF_LOSS_T"].param_value == 1.0
    action = by_name["NAV_RCL_ACT"]
    assert (action.param_type, struct.unpack("<i", struct.pack("<f", action.param_value))[0]) == (6, 2)


def test_parameters_are_read_set_and_refused(client: Client) -> None:
    def set_to(name: str, value: float, kind: int) -> list[Any]:
        return named(client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind)), "PARAM_VALUE")

    (read,) = named(client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"MPC_XY_P", -1)), "PARAM_VALUE")
    assert read.param_type == 9
    assert set_to("MPC_XY_P", 1.25, 9)[0].param_value == 1.25
    store = client.node.vehicle.autopilot.parameters
    assert store["MPC_XY_P"] == 1.25
    five = struct.unpack("<f", struct.pack("<i", 5))[0]
    assert set_to("COM_OBL_RC_ACT", five, 6)
    assert store.integer("COM_OBL_RC_ACT") == 5
    for name, value, kind in (
        ("MPC_XY_P", five, 6),
        ("COM_OBL_RC_ACT", 3.0, 9),
        ("MPC_XY_P", nan, 9),
        ("MPC_XY_P", 99.0, 9),
    ):
        set_to(name, value, kind)
    assert (store["MPC_XY_P"], store.integer("COM_OBL_RC_ACT")) == (1.25, 5)
    assert set_to("NO_SUCH", 1.0, 9) == []
    assert client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 9999)) == []


def test_refused_setpoints_are_no_proof_of_life(client: Client) -> None:
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    client.run(5.0)
    for frame, mask in ((7, 0), (9, 0), (1, 0xDFF)):
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, frame, mask, 0, 0, -2, 0, 0, 0, 0, 0, 0, 0, 0
        )
        texts = named(client.send(message), "STATUSTEXT")
        assert {text.severity for text in texts} == {2}
        assert not client.node.vehicle.autopilot.offboard_signal()
    elsewhere = mavlink.MAVLink_set_position_target_local_ned_message(0, 9, 1, 1, 0, *([0.0] * 11))
    client.send(elsewhere)
    assert not client.node.vehicle.autopilot.offboard_signal()


def test_global_setpoint_north_of_home_flies_north(client: Client) -> None:
    client.run(5.0)
    frame, lat = 6, round((HomeConfig().latitude_deg + 5.0 / 111_190) * 1e7)
    lon = round(HomeConfig().longitude_deg * 1e7)
    setpoint = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, 0b110111111000, lat, lon, 4.0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    client.send(setpoint)
    client.command(176, 1, 6, 0)
    client.command(400, 1)
    for _ in range(300):
        client.send(setpoint)
        client.run(0.04)
    assert client.node.vehicle.state.position_ned_m == pytest.approx((5.0, 0.0, -4.0), abs=0.2)


def test_two_frames_and_rubbish_in_one_datagram() -> None:
    codec = Codec(1)
    first = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 9, 9))
    second = mavlink.MAVLink_timesync_message(0, 1).pack(mavlink.MAVLink(None, 9, 9))
    found = codec.decode(b"\x00\xfd" + first + b"\xfe\x01rubbish" + second + b"\xfd")
    assert [received.message.get_type() for received in found] == ["HEARTBEAT", "TIMESYNC"]
    assert [received.frame for received in found] == [first, second]
    assert list(split_frames(b"")) == []


def test_sequence_numbers_have_no_gap(client: Client) -> None:
    client.run(2.0)
    sequence = [frame[4] for _, frame in client.node.journal.sent]
    assert sequence == [i % 256 for i in range(len(sequence))]


def test_thousands_of_mutated_frames_change_nothing_they_should_not() -> None:
    rng = random.Random(11)
    node = Node(Vehicle(VehicleConfig(), 1), lockstep=False)
    client = Client(node)
    sender = mavlink.MAVLink(None, 245, 190)
    originals = [
        mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_int_message(1, 1, 5, 192, 0, 0, -1, 1, 0, nan, 0, 0, nan),
        mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, *([1.0] * 11)),
        mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, 0, 0, 0, *([1.0] * 9)),
        mavlink.MAVLink_param_set_message(1, 1, b"MPC_XY_P", 1.0, 9),
        mavlink.MAVLink_param_request_read_message(1, 1, b"MPC_XY_P", -1),
        mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0),
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        mavlink.MAVLink_mission_count_message(1, 1, 1, 0),
        mavlink.MAVLink_timesync_message(0, 1),
        mavlink.MAVLink_ping_message(1, 1, 0, 0),
        mavlink.MAVLink_set_mode_message(1, 1, 0x00060000),
    ]
    frames = [bytearray(message.pack(sender)) for message in originals]
    extra = [mavlink.mavlink_map[message.get_msgId()].crc_extra for message in originals]
    accepted = 0
    for k in range(6000):
        which = rng.randrange(len(frames))
        frame = bytearray(frames[which])
        for _ in range(rng.randrange(1, 6)):
            frame[rng.randrange(10 if k % 2 else 0, len(frame) - 2)] = rng.choice((0, 255, 127, rng.randrange(256)))
        if k % 2:  # a correct checksum, so that the handlers see the mutated payload
            frame[-2:] = struct.pack("<H", mavlink.x25crc(frame[1:-2] + bytes([extra[which]])).crc)
        for received in client.codec.decode(bytes(frame[: rng.randrange(1, len(frame) + 40)])):
            node.handle(CLIENT, received)
            accepted += 1
        if k % 50 == 0:
            client.run(0.02)
    assert accepted > 1500
    client.run(1.0)
    assert all(value == value for value in node.vehicle.state)
    assert named(client.run(1.1), "HEARTBEAT")
