"""The compiled kernel against the same code as plain Python, and prepared payloads against pymavlink's own packing."""

import inspect
import struct
from hashlib import sha256
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20 import development
from pymavlink.generator.mavcrc import x25crc

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.setpoints import SetpointMessage
from vehicle_sim.config import VehicleConfig
from vehicle_sim.flight import advance
from vehicle_sim.noise import NOISE_COLUMNS, NoiseTable
from vehicle_sim.obstacles import RangeSensor, Scene
from vehicle_sim.parts import FailureConfig, ObstacleConfig, RangeSensorConfig, WindConfig
from vehicle_sim.protocol.codec import Codec
from vehicle_sim.protocol.node import Node
from vehicle_sim.protocol.payloads import base_length, payload_of
from vehicle_sim.telemetry import identity
from vehicle_sim.telemetry.streams import STREAMS
from vehicle_sim.vehicle import Vehicle

STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def flying() -> Vehicle:
    """In the air under OFFBOARD, in wind, off its setpoint, with every sensor."""
    wind = WindConfig((3.0, 1.0, 0.0), (1.0, 1.0, 0.5), dryden_w20_mps=8.0)
    wall = ObstacleConfig("wall", ((8.0, 5.0), (9.0, 5.0), (9.0, -5.0)))
    sensor = RangeSensor(RangeSensorConfig(), Scene.of([wall], (0.0, 0.0)), 3)
    vehicle = Vehicle(VehicleConfig(wind=wind), 3, range_sensor=sensor)
    for k in range(500):
        vehicle.autopilot.receive_setpoint(
            SetpointMessage(1, 0, (2.0, 1.0, -4.0), (0.5, 0.0, 0.0), STILL, 0.7, 0.1), vehicle.estimate
        )
        if k == 230:
            vehicle.autopilot.request_mode(Mode.OFFBOARD)
            vehicle.autopilot.request_arm()
        vehicle.advance(8)
    assert vehicle.state.d < -1.0
    return vehicle


def test_compiled_and_plain_python_give_the_same_bits(flying: Vehicle) -> None:
    noise = NoiseTable(9, NOISE_COLUMNS, 64).values
    plain = inspect.unwrap(advance.py_func)  # type: ignore[attr-defined]
    compiled_record, plain_record = flying.flight.record.copy(), flying.flight.record.copy()
    for at in range(0, 64, 4):
        advance(compiled_record, flying.constants.record, noise, at, 4)
        plain(plain_record, flying.constants.record, noise, at, 4)
        for name in compiled_record.dtype.names:
            assert np.array_equal(compiled_record[name], plain_record[name], equal_nan=True), (at, name)
    assert not np.array_equal(compiled_record["x"], flying.flight.record["x"])


def test_steps_one_by_one_or_in_batches_are_the_same_flight() -> None:
    one, many = (Vehicle(VehicleConfig(), 5) for _ in range(2))
    for _ in range(2500):
        one.step()
    for count in (1, 7, 992, 1500):
        many.advance(count)
    assert one.flight.record.tobytes() == many.flight.record.tobytes()
    assert one.t_us == many.t_us == 2500 * one.step_us


@pytest.mark.parametrize("message_id", sorted(set(STREAMS) - {identity.PROTOCOL_VERSION}))
def test_every_stream_packs_byte_for_byte_as_pymavlink_does(flying: Vehicle, message_id: int) -> None:
    built = STREAMS[message_id][0](flying)
    payload = built if isinstance(built, tuple) else payload_of(built)
    frame = Codec(1).encode(payload)
    dialect: Any = mavlink if message_id in mavlink.mavlink_map else development
    message: Any = dialect.MAVLink(None, 1, 1).decode(bytearray(frame))
    assert message.get_msgId() == message_id
    assert message.pack(dialect.MAVLink(None, 1, 1)) == frame
    assert message.get_type() == dialect.mavlink_map[message_id].msgname


def test_modes_are_listed_as_the_dialect_that_knows_them_packs_them() -> None:
    for number, payload in enumerate(identity.available_modes(0), 1):
        frame = Codec(1).encode(payload)
        message: Any = development.MAVLink(None, 1, 1).decode(bytearray(frame))
        assert (message.get_type(), message.mode_index) == ("AVAILABLE_MODES", number)
        assert message.pack(development.MAVLink(None, 1, 1)) == frame
        assert [payload] == identity.available_modes(number)


def test_protocol_version_is_packed_as_its_definition_says(flying: Vehicle) -> None:
    """No dialect of pymavlink has it; its checksum seed is made of the names and types of its fields."""
    crc = x25crc()
    crc.accumulate_str("PROTOCOL_VERSION uint16_t version uint16_t min_version uint16_t max_version ")
    for name in ("spec_version_hash", "library_version_hash"):
        crc.accumulate_str(f"uint8_t {name} ")
        crc.accumulate(bytearray((8,)))
    number, seed, length, data = identity.protocol_version(flying)
    assert (number, seed, length) == (300, bytes((crc.crc & 0xFF ^ crc.crc >> 8,)), len(data))
    assert struct.unpack("<3H", data[:6]) == (200, 100, 200)


def test_length_without_extensions_by_hand() -> None:
    known = {
        mavlink.MAVLink_heartbeat_message: 9,
        mavlink.MAVLink_attitude_message: 28,
        mavlink.MAVLink_battery_status_message: 36,
        mavlink.MAVLink_highres_imu_message: 62,
        mavlink.MAVLink_command_ack_message: 3,
        mavlink.MAVLink_statustext_message: 51,
        mavlink.MAVLink_param_value_message: 25,
        mavlink.MAVLink_mission_count_message: 4,
        mavlink.MAVLink_sys_status_message: 31,
    }
    assert {kind: base_length(kind) for kind in known} == known


def digest_of_a_flight(seed: int) -> str:
    """Every frame of twelve seconds with wind, failures and an estimator, as one number."""
    config = VehicleConfig(
        wind=WindConfig((2.0, 1.0, 0.0), dryden_w20_mps=6.0),
        failures=(FailureConfig(at_s=9.0, part="gps"), FailureConfig(at_s=10.0, part="motor", instance=2)),
    )
    node = Node(Vehicle(config, seed), lockstep=True)
    session, pilot = node.session("client"), node.vehicle.autopilot
    digest = sha256()
    for k in range(600):
        pilot.receive_setpoint(SetpointMessage(1, 0, (2.0, 1.0, -4.0), STILL, STILL, 0.7, 0.0), node.vehicle.estimate)
        if k == 230:
            pilot.request_mode(Mode.OFFBOARD)
            pilot.request_arm()
        node.advance_to(node.vehicle.t_us + 20_000)
        digest.update(b"".join(node.take(session)))
        node.journal.clear()
    return digest.hexdigest()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_a_hundred_times_faults_included() -> None:
    assert len({digest_of_a_flight(7) for _ in range(100)}) == 1
    assert digest_of_a_flight(8) != digest_of_a_flight(7)
