"""The mission protocol and missions in flight, fences, attitude set-points, files that are not there."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.geofence import Zone
from vehicle_sim.autopilot.setpoints import interpret_attitude
from vehicle_sim.config import VehicleConfig
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

from .node_client import EXACT, OTHER, Client, gcs_heartbeat, in_offboard, named, setpoint, stream

LAT, LON = 47.397742, 8.545594
ACCEPTED, NO_SPACE, UNSUPPORTED, ERROR, INVALID = 0, 4, 3, 1, 5


@pytest.fixture
def client() -> Client:
    return Client(Node(Vehicle(VehicleConfig(sensors=EXACT), 1), lockstep=False))


def item(
    number: int, command: int = 16, n: float = 0.0, e: float = 0.0, up: float = 5.0, kind: int = 0, **more: Any
) -> Any:
    x, y = round((LAT + n / 111_190) * 1e7), round((LON + e / 75_400) * 1e7)
    parameters = more.get("parameters", (0.0, 0.0, 0.0, math.nan))
    frame = more.get("frame", 6)
    return mavlink.MAVLink_mission_item_int_message(1, 1, number, frame, command, 0, 1, *parameters, x, y, up, kind)


def upload(client: Client, items: list[Any], kind: int = 0) -> int:
    """The MAV_MISSION_RESULT of an upload that answers every request."""
    heard = client.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for _ in range(4 * len(items) + 4):
        verdicts = named(heard, "MISSION_ACK")
        if verdicts:
            return int(verdicts[0].type)
        asked = named(heard, "MISSION_REQUEST_INT")
        heard = client.send(items[asked[-1].seq]) if asked else client.run(0.1)
    raise AssertionError("the upload does not end")


def download(client: Client, kind: int = 0) -> list[Any]:
    (count,) = named(client.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind)), "MISSION_COUNT")
    found: list[Any] = []
    for number in range(count.count):
        found += named(client.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, kind)), "MISSION_ITEM_INT")
    client.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
    return found


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.sampled_from((16, 19, 22)), st.floats(-300, 300), st.floats(-300, 300)), max_size=12))
def test_what_is_uploaded_is_downloaded(places: list[tuple[int, float, float]]) -> None:
    client = Client(Node(Vehicle(VehicleConfig(sensors=EXACT), 1), lockstep=False))
    items = [item(k, command, n, e) for k, (command, n, e) in enumerate(places)]
    if items:
        assert upload(client, items) == ACCEPTED
    down = download(client)
    assert [(d.seq, d.command, d.x, d.y, d.z) for d in down] == [(i.seq, i.command, i.x, i.y, i.z) for i in items]


def test_a_mission_is_flown_paused_resumed_and_ends_in_hold(client: Client) -> None:
    client.send(gcs_heartbeat())
    client.run(5.0)
    corners = [(8.0, 0.0), (8.0, 8.0), (0.0, 8.0)]
    items = [item(0, 22), item(1, 178, parameters=(1.0, 4.0, -1.0, 0.0), frame=2)]
    items += [item(2 + k, n=n, e=e) for k, (n, e) in enumerate(corners)]
    assert upload(client, items) == ACCEPTED
    assert client.results(176, 1, 4, 4) == [0, 0]
    assert client.results(400, 1) == [0]
    vehicle, reached, least = client.node.vehicle, [], [math.inf] * 3
    paused = False
    for _ in range(600):
        heard = client.run(0.1)
        reached += [m.seq for m in named(heard, "MISSION_ITEM_REACHED")]
        here = vehicle.state
        least = [min(best, math.hypot(here.n - n, here.e - e)) for best, (n, e) in zip(least, corners, strict=True)]
        if 2 in reached and not paused:
            paused = True
            assert client.results(193, 0) == [0]
            client.run(4.0)
            assert math.hypot(vehicle.state.vn, vehicle.state.ve) < 0.1
            assert client.results(193, 1) == [0]
        if 4 in reached:
            break
    assert reached == [0, 1, 2, 3, 4]
    assert max(least) < 2.0
    client.run(3.0)
    assert vehicle.autopilot.commander.flown_mode.name == "LOITER"
    assert vehicle.state.position_ned_m == pytest.approx((0.0, 8.0, -5.0), abs=0.4)
    (current,) = named(client.command(512, 42), "MISSION_CURRENT")
    assert (current.total, current.mission_state) == (5, mavlink.MISSION_STATE_COMPLETE)


def test_a_mission_that_begins_with_a_waypoint_climbs_first_and_one_that_lands_disarms(client: Client) -> None:
    client.send(gcs_heartbeat())
    client.run(5.0)
    assert upload(client, [item(0, 16, 15.0), item(1, 21, 15.0, 4.0)]) == ACCEPTED
    client.command(176, 1, 4, 4)
    assert client.results(400, 1) == [0]
    while client.node.vehicle.state.d > -4.0:
        client.run(0.1)
        assert math.hypot(client.node.vehicle.state.n, client.node.vehicle.state.e) < 0.5
        assert client.node.vehicle.t_s < 20
    while client.node.vehicle.autopilot.commander.armed:
        client.run(0.5)
        assert client.node.vehicle.t_s < 80
    assert client.node.vehicle.state.position_ned_m == pytest.approx((15.0, 4.0, 0.0), abs=0.5)


def test_jumps_are_counted_and_end(client: Client) -> None:
    client.send(gcs_heartbeat())
    client.run(5.0)
    jump = item(2, 177, parameters=(0.0, 2.0, 0.0, 0.0), frame=2)
    assert upload(client, [item(0, n=4.0), item(1, n=-4.0), jump]) == ACCEPTED
    client.command(176, 1, 4, 4)
    client.command(400, 1)
    reached = [m.seq for _ in range(80) for m in named(client.run(0.5), "MISSION_ITEM_REACHED")]
    assert reached == [0, 1, 0, 1, 0, 1, 2]


def test_row_21_uploads_are_asked_again_time_out_and_are_refused(client: Client) -> None:
    client.run(0.1)
    heard = client.send(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    assert [m.seq for m in named(heard, "MISSION_REQUEST_INT")] == [0]
    assert 3 <= len(named(client.run(1.0), "MISSION_REQUEST_INT")) <= 5  # every 250 ms
    other = Client(client.node, OTHER, system=99)
    (busy,) = named(other.send(mavlink.MAVLink_mission_count_message(1, 1, 1, 0)), "MISSION_ACK")
    assert busy.type == ERROR
    client.run(5.0)
    assert not named(client.run(1.0), "MISSION_REQUEST_INT")
    assert "Operation timeout" in [text.text for _, text in client.node.journal.texts]
    assert upload(client, [item(0, 2600)]) == UNSUPPORTED
    assert upload(client, [item(0, frame=1)]) == mavlink.MAV_MISSION_UNSUPPORTED_FRAME
    (full,) = named(client.send(mavlink.MAVLink_mission_count_message(1, 1, 5000, 0)), "MISSION_ACK")
    assert full.type == NO_SPACE
    assert client.results(224, 7) == [2]
    (sequence,) = named(client.send(mavlink.MAVLink_mission_request_int_message(1, 1, 3, 0)), "MISSION_ACK")
    assert sequence.type == mavlink.MAV_MISSION_INVALID_SEQUENCE


def test_rally_list_is_empty_and_clearing_empties_every_list(client: Client) -> None:
    assert download(client, 2) == []
    (refused,) = named(client.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 2)), "MISSION_ACK")
    assert refused.type == UNSUPPORTED
    fence = [
        item(k, 5001, n, e, kind=1, parameters=(4.0, 0, 0, 0))
        for k, (n, e) in enumerate(((9, 9), (9, -9), (-9, -9), (-9, 9)))
    ]
    assert upload(client, fence, 1) == ACCEPTED
    assert upload(client, fence[:3], 1) == INVALID
    assert len(download(client, 1)) == 4
    assert upload(client, [item(0)]) == ACCEPTED
    (done,) = named(client.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 255)), "MISSION_ACK")
    assert done.type == ACCEPTED
    assert download(client, 0) == download(client, 1) == []
    assert client.node.vehicle.autopilot.zones == ()


def test_an_uploaded_fence_stops_the_vehicle(client: Client) -> None:
    fence = [item(0, 5003, kind=1, parameters=(5.0, 0, 0, 0))]
    assert upload(client, fence, 1) == ACCEPTED
    in_offboard(client)
    stream(client, 10.0, setpoint((60.0, 0.0, -3.0)))
    assert client.node.vehicle.autopilot.commander.flown_mode.name == "LOITER"
    assert client.node.vehicle.state.n < 40.0


def test_zones_by_hand() -> None:
    ell = Zone(((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0)), inclusion=True)
    assert [ell.contains(*p) for p in ((2, 2), (8, 2), (2, 8), (8, 8), (-1, 2), (2, 11))] == [True] * 3 + [False] * 3
    ring = Zone(((3.0, 4.0),), inclusion=False, radius_m=5.0)
    assert ring.contains(0.0, 0.0)
    assert not ring.contains(-0.1, 0.0)


def test_attitude_setpoints_fly_by_tilt_and_by_rates(client: Client) -> None:
    in_offboard(client)
    vehicle = client.node.vehicle
    hover = vehicle.autopilot.parameters["MPC_THR_HOVER"]
    half = math.radians(-5.0) / 2
    nose_down = mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, 7, [math.cos(half), 0.0, math.sin(half), 0.0], 0.0, 0.0, 0.0, hover
    )
    stream(client, 2.0, nose_down)
    assert vehicle.state.vn > 0.8
    assert abs(vehicle.state.ve) < 0.2
    turn = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 128, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.5, hover)
    stream(client, 1.5, turn)
    assert vehicle.state.r == pytest.approx(0.5, abs=0.05)
    stream(client, 6.0)
    assert vehicle.state.position_ned_m == pytest.approx((0.0, 0.0, -3.0), abs=0.3)


def test_attitude_masks_by_hand() -> None:
    level, spin = (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3)
    by_attitude = interpret_attitude(7, level, spin, 0.5)
    assert by_attitude == (level, (0.0, 0.0, 0.0), 0.5)
    by_rates = interpret_attitude(128, level, spin, 0.5)
    assert by_rates == (None, spin, 0.5)
    assert interpret_attitude(128 | 1, level, spin, 0.5) is None
    assert interpret_attitude(64, level, spin, 0.5) == (level, (0.0, 0.0, 0.3), 0.0)
    assert interpret_attitude(0, (math.nan,) * 4, spin, 0.5) is None
    assert interpret_attitude(0, (0.0,) * 4, spin, 0.5) is None


def test_file_transfer_and_logs_are_refused_at_once(client: Client) -> None:
    request = [5, 0, 0, 3, *([0] * 247)]
    (answer,) = named(
        client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, request)), "FILE_TRANSFER_PROTOCOL"
    )
    assert list(answer.payload[:6]) == [6, 0, 0, 129, 1, 3]
    assert answer.payload[12] == 7
    (entry,) = named(client.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF)), "LOG_ENTRY")
    assert entry.num_logs == 0
