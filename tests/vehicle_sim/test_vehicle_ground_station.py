"""A ground station's boot traffic: everything it asks is answered or refused within a second, and a second station is served too."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.config import VehicleConfig
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

from .node_client import EXACT, Client, gcs_heartbeat, named

#: AUTOPILOT_VERSION, HOME_POSITION, EXTENDED_SYS_STATE, GPS_GLOBAL_ORIGIN, MISSION_CURRENT.
SERVED = (148, 242, 245, 49, 42)
#: PROTOCOL_VERSION, COMPONENT_METADATA, COMPONENT_INFORMATION, CAMERA_INFORMATION, GIMBAL_MANAGER_INFORMATION, AVAILABLE_MODES.
REFUSED = (300, 397, 395, 259, 280, 435)


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


def test_boot_traffic_is_answered_item_by_item(station: Client) -> None:
    for number in SERVED:
        heard = station.command(512, number)
        assert named(heard, "COMMAND_ACK")[0].result == 0
        assert [m for m in heard if m.get_msgId() == number], number
    for number in REFUSED:
        assert station.results(512, number) == [2], number
    assert station.results(520, 1) == [0]
    (digest,) = ask(station, mavlink.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1), "PARAM_VALUE")
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = named(station.run(1.0), "PARAM_VALUE")
    assert values[0].param_id == "_HASH_CHECK"
    assert values[0].param_value == digest.param_value
    assert len(values) == values[0].param_count + 1
    (again,) = ask(station, mavlink.MAVLink_param_request_read_message(1, 1, b"", 17), "PARAM_VALUE")
    assert again.param_id == values[18].param_id
    for kind in (0, 1, 2):
        (count,) = ask(station, mavlink.MAVLink_mission_request_list_message(1, 1, kind), "MISSION_COUNT")
        assert (count.count, count.mission_type) == (0, kind)
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
