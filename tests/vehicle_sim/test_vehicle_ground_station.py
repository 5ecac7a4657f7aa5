"""A ground station's boot traffic: everything it asks is answered or refused within a second, and a second station is served too."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20 import development

from vehicle_sim.config import VehicleConfig
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

from .node_client import EXACT, Client, gcs_heartbeat, named

#: Served besides: HOME_POSITION, EXTENDED_SYS_STATE, GPS_GLOBAL_ORIGIN, MISSION_CURRENT, ESTIMATOR_STATUS.
SERVED = (242, 245, 49, 42, 230)
#: COMPONENT_METADATA, COMPONENT_INFORMATION_BASIC, COMPONENT_INFORMATION; camera, video, gimbal manager.
REFUSED = (397, 396, 395, 259, 269, 280)


@pytest.fixture
def station() -> Client:
    client = Client(Node(Vehicle(VehicleConfig(sensors=EXACT), 1), lockstep=False), "station", system=255)
    client.send(gcs_heartbeat())
    client.run(5.0)
    return client


def ask(client: Client, message: Any, kind: str, limit_s: float = 1.0) -> list[Any]:
    heard = named(client.send(message), kind)
    while not heard and limit_s > 0:
        limit_s -= 0.05
        heard = named(client.run(0.05), kind)
    assert heard, kind
    return heard


def asked_for(client: Client, number: int, parameter: int = 0) -> tuple[int, list[Any]]:
    """REQUEST_MESSAGE: its result, and the messages of that number, read with the dialect that knows all of them."""
    client.receive()
    client.post(mavlink.MAVLink_command_long_message(1, 1, 512, 0, number, parameter, 0, 0, 0, 0, 0))
    reader = development.MAVLink(None, 1, 1)
    heard: list[Any] = [reader.decode(bytearray(frame)) for frame in client.take()]
    return named(heard, "COMMAND_ACK")[0].result, [m for m in heard if m.get_msgId() == number]


def test_boot_in_the_order_of_qgroundcontrol(station: Client) -> None:
    """Version, modes, component information, parameters, mission, fence, rally points: its InitialConnectStateMachine."""
    result, (version,) = asked_for(station, 148)
    assert (result, version.flight_sw_version >> 24) == (0, 1)
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    check_modes(station)
    for number in REFUSED:
        assert asked_for(station, number) == (2, []), number
    check_parameters(station)
    for kind in (0, 1, 2):
        (count,) = ask(station, mavlink.MAVLink_mission_request_list_message(1, 1, kind), "MISSION_COUNT")
        assert (count.count, count.mission_type) == (0, kind)
    for number in SERVED:
        result, heard = asked_for(station, number)
        assert (result, len(heard)) == (0, 1), number
    assert station.results(512, 300) == station.results(519, 1) == station.results(520, 1) == [0]


def check_modes(station: Client) -> None:
    """One by one until the number that the first one states; beyond it, refused."""
    _, (first,) = asked_for(station, 435, 1)
    modes = [asked_for(station, 435, number)[1][0] for number in range(1, first.number_modes + 1)]
    assert asked_for(station, 435, first.number_modes + 1) == (2, [])
    standard = {mode.custom_mode: mode.standard_mode for mode in modes if mode.standard_mode}
    assert standard == {
        0x00020000: development.MAV_STANDARD_MODE_ALTITUDE_HOLD,
        0x00030000: development.MAV_STANDARD_MODE_POSITION_HOLD,
        0x04040000: development.MAV_STANDARD_MODE_MISSION,
        0x05040000: development.MAV_STANDARD_MODE_SAFE_RECOVERY,
        0x02040000: development.MAV_STANDARD_MODE_TAKEOFF,
        0x06040000: development.MAV_STANDARD_MODE_LAND,
    }
    named_modes = {mode.mode_name: mode.custom_mode for mode in modes if not mode.standard_mode}
    assert named_modes["Hold"] == 0x03040000
    assert named_modes["Offboard"] == 0x00060000
    assert len(asked_for(station, 435, 0)[1]) == len(modes)
    result, (current,) = asked_for(station, 436)
    assert (result, current.custom_mode, current.intended_custom_mode) == (0, 0x03040000, 0x03040000)


def check_parameters(station: Client) -> None:
    """The hash alone, the list, and one of the list again by its number."""
    (digest,) = ask(station, mavlink.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1), "PARAM_VALUE")
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = named(station.run(1.0), "PARAM_VALUE")
    assert values[0].param_id == "_HASH_CHECK"
    assert values[0].param_value == digest.param_value
    assert len(values) == values[0].param_count + 1
    (again,) = ask(station, mavlink.MAVLink_param_request_read_message(1, 1, b"", 17), "PARAM_VALUE")
    assert again.param_id == values[18].param_id


def test_a_station_sets_its_own_rates(station: Client) -> None:
    for message_id, interval_us in ((30, 100_000), (33, 200_000), (147, 1_000_000)):
        assert station.results(511, message_id, interval_us) == [0]
    heard = station.run(10.0)
    rates = {kind: len(named(heard, kind)) / 10 for kind in ("ATTITUDE", "GLOBAL_POSITION_INT", "BATTERY_STATUS")}
    assert rates == pytest.approx({"ATTITUDE": 10, "GLOBAL_POSITION_INT": 5, "BATTERY_STATUS": 1}, rel=0.05)


def test_the_hash_changes_with_a_parameter_and_every_station_hears_of_it(station: Client) -> None:
    other = Client(station.node, "other", system=254)
    read = mavlink.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1)
    (before,) = ask(station, read, "PARAM_VALUE")
    other.receive()
    station.send(mavlink.MAVLink_param_set_message(1, 1, b"MPC_XY_CRUISE", 6.0, 9))
    assert [m.param_id for m in named(other.receive(), "PARAM_VALUE")] == ["MPC_XY_CRUISE"]
    (after,) = ask(station, read, "PARAM_VALUE")
    assert after.param_value != before.param_value
