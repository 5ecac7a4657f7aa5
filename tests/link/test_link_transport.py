"""URIs, occupied ports, and whom a listening socket answers."""

import socket
import time
from pathlib import Path

import numpy as np
import pytest
from fake_autopilot import free_port

from sandwich_sitl.config import ClockConfig, LinkConfig
from sandwich_sitl.errors import InputError, LinkError
from sandwich_sitl.link.guard import Fence
from sandwich_sitl.link.session import LinkSession
from sandwich_sitl.link.transport import check_openable, open_transport
from sandwich_sitl.link_uri import Uri, parse_uri
from sandwich_sitl.mission.setpoint import Setpoint

HOST = "127.0.0.1"
_SETPOINT = 84  # SET_POSITION_TARGET_LOCAL_NED


@pytest.mark.parametrize(
    ("text", "uri"),
    [
        ("udpin://127.0.0.1:14540", Uri("udpin", HOST, 14540)),
        ("udpin://127.0.0.1:0", Uri("udpin", HOST, 0)),
        ("udpin:127.0.0.1:14540", Uri("udpin", HOST, 14540)),
        ("udpout://drone.local:14580", Uri("udpout", "drone.local", 14580)),
        ("udpout:[::1]:14580", Uri("udpout", "::1", 14580)),
        ("tcp:127.0.0.1:5760", Uri("tcp", HOST, 5760)),
        ("serial:///dev/ttyACM0:57600", Uri("serial", "/dev/ttyACM0", 57600)),
    ],
)
def test_uris(text: str, uri: Uri) -> None:
    assert parse_uri(text) == uri


@pytest.mark.parametrize(
    "text", ["", "udp://1.2.3.4:5", "udpin://host", "udpin://h:70000", "udpout://h:0", "tcp://h:x", "serial:///d:0"]
)
def test_bad_uris_name_the_key(text: str) -> None:
    for use in (open_transport, check_openable):
        with pytest.raises(InputError, match=r"link\.uri") as caught:
            use(text)
        assert "\n" not in str(caught.value)


def test_occupied_port_names_port_and_fix() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((HOST, 0))
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=rf"{port}.*occupied.*link\.uri"):
            open_transport(f"udpin://{HOST}:{port}")
        with pytest.raises(InputError, match=rf"{port}.*occupied.*link\.uri"):
            check_openable(f"udpin://{HOST}:{port}")
    check_openable(f"udpin://{HOST}:{port}")


def test_an_address_of_another_machine() -> None:
    for use in (open_transport, check_openable):
        with pytest.raises(InputError, match=r"192\.0\.2\.1:14540 .*give an address of this machine"):
            use("udpin://192.0.2.1:14540")


def test_nobody_listening_on_tcp() -> None:
    with pytest.raises(LinkError, match="cannot connect"):
        open_transport(f"tcp://{HOST}:{free_port()}")


def test_missing_serial_line(tmp_path: Path) -> None:
    for use in (open_transport, check_openable):
        with pytest.raises(InputError, match=r"tty cannot be opened \(No such file or directory\); give the device"):
            use(f"serial://{tmp_path / 'tty'}:57600")


def test_unknown_host() -> None:
    with pytest.raises(InputError, match="is not known"):
        open_transport("udpout://no-such-host.invalid:14580")


def test_listener_answers_only_a_peer_it_was_told_to_keep() -> None:
    port = free_port()
    listener = open_transport(f"udpin://{HOST}:{port}")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station,
    ):
        for peer in (vehicle, station):
            peer.bind((HOST, 0))
            peer.settimeout(1.0)
        assert not listener.send(b"nobody yet")
        vehicle.sendto(b"v", (HOST, port))
        assert listener.receive(time.monotonic() + 1.0) == b"v"
        listener.keep_peer()
        station.sendto(b"s", (HOST, port))
        assert listener.receive(time.monotonic() + 1.0) == b"s"
        assert listener.send(b"for the vehicle")
        assert vehicle.recv(100) == b"for the vehicle"
    listener.close()


def test_receive_keeps_its_deadline() -> None:
    listener = open_transport(f"udpin://{HOST}:{free_port()}")
    begun = time.monotonic()
    assert listener.receive(begun + 0.05) is None
    assert 0.04 < time.monotonic() - begun < 2.0
    listener.close()


def test_tcp_carries_bytes_and_tells_of_the_end() -> None:
    with socket.create_server((HOST, 0)) as server:
        client = open_transport(f"tcp://{HOST}:{server.getsockname()[1]}")
        vehicle, _ = server.accept()
        with vehicle:
            vehicle.sendall(b"abc")
            assert client.receive(time.monotonic() + 1.0) == b"abc"
            assert client.send(b"def")
            assert vehicle.recv(10) == b"def"
        with pytest.raises(LinkError, match="closed by the vehicle"):
            client.receive(time.monotonic() + 1.0)
        client.close()


def test_lockstep_needs_datagrams() -> None:
    with socket.create_server((HOST, 0)) as server:
        link = LinkConfig(uri=f"tcp://{HOST}:{server.getsockname()[1]}")
        with pytest.raises(InputError, match="lockstep needs a UDP link"):
            LinkSession(link, ClockConfig(mode="lockstep"), 0.02, (0.0, 0.0), lambda *_: None)


def test_no_vehicle_announces_itself() -> None:
    link = LinkConfig(uri=f"udpin://{HOST}:{free_port()}")
    arguments = (link, ClockConfig(mode="lockstep"), 0.02, (0.0, 0.0), lambda *_: None)
    with (
        LinkSession(*arguments, connect_timeout_s=0.3) as session,
        pytest.raises(LinkError, match=r"announced itself within 0\.3 s"),
    ):
        session.next_tick()
    with LinkSession(*arguments, stop_requested=lambda: True) as session:
        assert session.next_tick() == 0.0
        assert not session.view.heard


def test_set_points_that_the_fence_refuses_are_counted_and_not_sent() -> None:
    link, frames = LinkConfig(uri=f"udpin://{HOST}:{free_port()}"), list[bytes]()
    with LinkSession(
        link, ClockConfig(mode="realtime"), 0.01, (0.0, 0.0), lambda _t, _way, frame: frames.append(frame),
        fence=Fence((0.0, 0.0, 10.0, 10.0), (0.0, 5.0)),
    ) as session:  # fmt: skip
        for x_m in (1.0, 11.0, 12.0, 1.0):
            session.next_tick()
            reason = session.send(Setpoint(np.array([x_m, 1.0, 2.0]), np.zeros(3), None, 0.0), [])
            assert (reason is not None) == (x_m > 10.0)
        assert session.statistics.refused == 2
    sent = [frame for frame in frames if int.from_bytes(frame[7:10], "little") == _SETPOINT]
    assert len(sent) == 2


def test_realtime_ticks_keep_an_absolute_schedule() -> None:
    link = LinkConfig(uri=f"udpin://{HOST}:{free_port()}")
    with LinkSession(link, ClockConfig(mode="realtime"), 0.01, (0.0, 0.0), lambda *_: None) as session:
        ticks = [session.next_tick() for _ in range(51)]
        time.sleep(0.05)
        session.next_tick()
        assert session.statistics.late_ticks >= 1
        assert session.statistics.worst_late_s >= 0.03
    assert ticks[-1] - ticks[0] >= 0.5 - 1e-3
