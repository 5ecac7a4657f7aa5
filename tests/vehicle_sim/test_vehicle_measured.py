"""What was measured on PX4 (main of March 2026, built-in simulator, no parameter changed), as numbers, message by message."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.modes import Mode

from .node_client import (
    LAND,
    LOITER,
    OFFBOARD,
    OTHER,
    RTL,
    TAKEOFF,
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
    return in_offboard(new_client())


def said(client: Client) -> list[str]:
    """Everything the vehicle has said so far."""
    return [text.text for _, text in client.node.journal.texts]


def test_measured_armable_after_four_seconds_and_flies_offboard(client: Client) -> None:
    while not client.node.vehicle.autopilot.commander.is_ready():
        client.run(0.1)
    assert client.node.vehicle.t_s == pytest.approx(4.0, abs=0.3)
    stream(client, 0.2)
    assert client.results(176, 1, 6, 0) == [0, 0]
    assert client.results(400, 1) == [0]
    stream(client, 7.0)
    assert client.node.vehicle.state.d < -2.5


def test_measured_heartbeats_disarmed(client: Client) -> None:
    assert beat(client.run(1.1)) == (LOITER, 29, 0)
    assert beat(client.run(5.0)) == (LOITER, 29, 3)
    client.command(176, 1, 4, 2)
    assert beat(client.run(1.1)) == (TAKEOFF, 29, 3)
    client.command(176, 1, 6, 0)
    assert beat(client.run(1.1)) == (OFFBOARD, 1, 3)
    assert beat(stream(client, 1.1)) == (OFFBOARD, 17, 3)


def test_measured_heartbeats_armed(flying: Client) -> None:
    assert beat(stream(flying, 1.1)) == (OFFBOARD, 145, 4)
    for sub, shown in ((3, LOITER), (2, TAKEOFF), (5, RTL), (6, LAND)):
        flying.command(176, 1, 4, sub)
        assert beat(flying.run(1.1)) == (shown, 157, 4)


def test_measured_offboard_without_a_stream(client: Client, flying: Client) -> None:
    flying.command(176, 1, 4, 3)
    flying.run(2.0)
    assert flying.results(176, 1, 6, 0) == [0, 1]
    assert said(flying)[-1] == "Switching to Offboard is currently not available"
    client.run(5.0)
    assert client.results(176, 1, 6, 0) == [0, 0]
    assert client.results(400, 1) == [1]
    assert said(client)[-1] == "Arming denied: Resolve system health failures first"


def test_measured_results(flying: Client) -> None:
    assert flying.results(400, 0) == [1]
    assert said(flying)[-1] == "Disarming denied: not landed"
    assert flying.results(9999) == [3]
    assert flying.results(512, 9999) == [2]
    assert flying.results(511, 9999, 1e5) == [4]
    assert flying.results(176, 1, 12, 0) == flying.results(176, 1, 4, 12) == [0, 1]
    assert flying.command(400, 0, system=7) == []


@pytest.mark.parametrize(("frame", "result"), [(5, 0), (0, 0), (3, 9), (6, 9)])
def test_measured_frames_of_command_int(flying: Client, frame: int, result: int) -> None:
    goto = mavlink.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, 1, 0, math.nan, 473977420, 85455940, 500)
    assert [m.result for m in named(flying.send(goto), "COMMAND_ACK")] == [result]


@pytest.mark.parametrize(
    ("message", "counted"),
    [
        (setpoint(), True),
        (setpoint(frame=8, mask=0b111000111), True),
        (setpoint(frame=7), False),
        (setpoint(frame=9), False),
        (setpoint(mask=0xDFF), False),
        (setpoint((math.nan,) * 3, mask=0b111111000), False),
    ],
)
def test_measured_what_counts_as_a_stream(client: Client, message: Any, counted: bool) -> None:
    client.send(gcs_heartbeat())
    client.run(0.5)
    complaints = texts(client.send(message))
    assert client.node.vehicle.autopilot.offboard_signal() is counted
    assert bool(complaints) is not counted


def test_measured_time_boot_ms_of_a_setpoint_is_ignored(client: Client) -> None:
    client.run(2.0)
    for stamp in (0, 4_000_000_000, 1):
        message = setpoint()
        message.time_boot_ms = stamp
        client.run(1.5)
        assert not client.node.vehicle.autopilot.offboard_signal()
        client.send(message)
        assert client.node.vehicle.autopilot.offboard_signal()


def test_measured_loss_of_offboard_climbs_to_thirty_metres_returns_and_disarms(flying: Client) -> None:
    stream(flying, 6.0, setpoint((6.0, 0.0, -3.0)))
    pilot, highest_m, landed_s = flying.node.vehicle.autopilot, 0.0, math.inf
    while pilot.commander.armed:
        flying.run(0.1)
        state = flying.node.vehicle.state
        highest_m = max(highest_m, -state.d)
        if highest_m < 29.0 and -state.d > 4.0:
            assert state.n == pytest.approx(6.0, abs=1.0)  # climbs before it returns
        if pilot.landed:
            landed_s = min(landed_s, flying.node.vehicle.t_s)
        assert flying.node.vehicle.t_s < 150
    assert highest_m == pytest.approx(30.0, abs=1.0)
    assert math.hypot(flying.node.vehicle.state.n, flying.node.vehicle.state.e) < 0.5
    assert flying.node.vehicle.t_s - landed_s == pytest.approx(2.0, abs=0.25)
    assert beat(flying.run(1.1))[0] == OFFBOARD


def test_measured_com_obl_rc_act_5_holds() -> None:
    flying = in_offboard(new_client(parameters={"COM_OBL_RC_ACT": 5}))
    assert beat(flying.run(3.0)) == (LOITER, 157, 5)


def test_measured_armed_and_not_flown(client: Client) -> None:
    client.run(5.0)
    assert client.results(400, 1) == [0]
    armed_s = client.node.vehicle.t_s
    while client.node.vehicle.autopilot.commander.armed:
        client.run(0.1)
        assert client.node.vehicle.t_s < armed_s + 15
    assert client.node.vehicle.t_s - armed_s == pytest.approx(10.5, abs=0.7)
    assert said(client)[-1] == "Disarmed by auto preflight disarming"


def test_measured_sys_status_when_ready(client: Client) -> None:
    status = named(client.run(6.0), "SYS_STATUS")[-1]
    assert status.onboard_control_sensors_present == 0x300402F
    assert status.onboard_control_sensors_enabled == 0x301402F
    assert status.onboard_control_sensors_health == 0x1320C83F


def test_measured_gaps_in_the_stream(flying: Client) -> None:
    for _ in range(5):
        flying.send(setpoint())
        flying.run(0.6)
    assert flying.node.vehicle.autopilot.commander.flown_mode is Mode.OFFBOARD
    for _ in range(5):
        flying.send(setpoint())
        flying.run(1.0)
    assert flying.node.vehicle.autopilot.commander.flown_mode is Mode.OFFBOARD
    flown = set()
    for _ in range(4):
        flying.send(setpoint())
        for _ in range(5):
            flying.run(0.25)
            flown.add(flying.node.vehicle.autopilot.commander.flown_mode)
    assert flown == {Mode.OFFBOARD, Mode.RTL}


def test_measured_texts_only_to_ground_stations(client: Client) -> None:
    other = Client(client.node, OTHER)
    client.send(gcs_heartbeat())
    other.send(gcs_heartbeat(18))
    client.run(1.0)
    heard = client.command(400, 1)
    assert texts(heard)
    assert not texts(other.receive())
