"""Bytes in and out: UDP, TCP and serial lines behind one non-blocking interface.

Input: a URI as MAVSDK users write it (`udpin://HOST:PORT`, `udpout://HOST:PORT`, `tcp://HOST:PORT`,
`serial://DEVICE:BAUD`) or as pymavlink users do (`udpin:HOST:PORT`). Times are wall seconds of `time.monotonic`. A
URI that cannot be read and an occupied port raise `InputError`, anything else that keeps the link from opening
`LinkError`. pyserial is imported when a serial line is opened.
"""

import errno
import re
import select
import socket
import time
from dataclasses import dataclass
from typing import Any, Protocol

from sandwich_sitl.errors import InputError, LinkError

_RECEIVE_BUFFER = 4 << 20
_DATAGRAM = 65535
_CONNECT_S = 5.0
_FORMS = "udpin://HOST:PORT, udpout://HOST:PORT, tcp://HOST:PORT or serial://DEVICE:BAUD"


class Transport(Protocol):
    """What a session needs of a link. `datagrams` tells whether one `receive` is one datagram of the peer."""

    datagrams: bool

    def receive(self, deadline: float) -> bytes | None:
        """Bytes that are there or come before `deadline` (`time.monotonic`), else None. A past deadline only looks."""

    def send(self, data: bytes) -> bool:
        """Send; False when nobody to send to is known yet or the line is full."""

    def keep_peer(self) -> None:
        """The last bytes came from a vehicle: answer there from now on."""

    def close(self) -> None:
        """Give the port back."""


@dataclass(frozen=True)
class Uri:
    """A link's URI in parts; `number` is a port, or the baud rate of a serial line."""

    kind: str
    host: str
    number: int


def parse_uri(text: str) -> Uri:
    """Raises `InputError` for anything that is not one of the four forms."""
    match = re.fullmatch(r"(udpin|udpout|tcp|serial):(?://)?(.+):(\d+)", text)
    if match is None:
        raise InputError(f"link.uri '{text}' is not a connection URI; write {_FORMS}")
    kind, host, number = match[1], match[2].strip("[]"), int(match[3])
    if kind != "serial" and not 0 < number < 65536:
        raise InputError(f"link.uri '{text}': port {number} is not within 1..65535")
    if kind == "serial" and number == 0:
        raise InputError(f"link.uri '{text}': the baud rate must be positive, for example 57600")
    return Uri(kind, host, number)


def open_transport(text: str) -> Transport:
    """Open the link that `text` names. Raises `InputError` or `LinkError`."""
    uri = parse_uri(text)
    if uri.kind == "serial":
        return SerialTransport(uri)
    if uri.kind == "tcp":
        return TcpTransport(uri)
    return UdpTransport(uri)


class UdpTransport:
    """`udpin` binds and answers whom it heard last, `udpout` sends to a fixed address from any free port."""

    datagrams = True

    def __init__(self, uri: Uri) -> None:
        family, address = _resolve(uri, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        self._peer: Any = address if uri.kind == "udpout" else None
        self._fixed = uri.kind == "udpout"
        self._last: Any = None
        if not self._fixed:
            self._bind(uri, address)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def receive(self, deadline: float) -> bytes | None:
        """One datagram."""
        while True:
            try:
                data, self._last = self._socket.recvfrom(_DATAGRAM)
            except BlockingIOError:
                if not _wait(self._socket, deadline):
                    return None
            except ConnectionRefusedError:
                if time.monotonic() >= deadline:
                    return None
            else:
                return data

    def send(self, data: bytes) -> bool:
        """One datagram to the peer, if it is known."""
        if self._peer is None:
            return False
        try:
            self._socket.sendto(data, self._peer)
        except (BlockingIOError, ConnectionRefusedError):
            return False
        except OSError as error:
            raise LinkError(f"cannot send to {self._peer[0]}:{self._peer[1]}: {error.strerror}") from error
        return True

    def keep_peer(self) -> None:
        """Answer the sender of the last datagram."""
        if not self._fixed:
            self._peer = self._last

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def _bind(self, uri: Uri, address: Any) -> None:
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            if error.errno == errno.EADDRINUSE:
                raise InputError(
                    f"UDP port {uri.number} on {uri.host} is occupied by another process; "
                    "end that process or give another port in link.uri"
                ) from error
            raise LinkError(f"cannot listen on {uri.host}:{uri.number}: {error.strerror}") from error


class TcpTransport:
    """A TCP client (ArduPilot's SITL listens on 5760)."""

    datagrams = False

    def __init__(self, uri: Uri) -> None:
        self._name = f"{uri.host}:{uri.number}"
        try:
            self._socket = socket.create_connection((uri.host, uri.number), timeout=_CONNECT_S)
        except OSError as error:
            reason = error.strerror or "no answer"
            raise LinkError(f"cannot connect to tcp://{self._name} ({reason}); is the vehicle listening?") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)

    def receive(self, deadline: float) -> bytes | None:
        """Whatever bytes there are."""
        while True:
            try:
                data = self._socket.recv(_DATAGRAM)
            except BlockingIOError:
                if not _wait(self._socket, deadline):
                    return None
            except OSError as error:
                raise LinkError(f"tcp://{self._name} is lost: {error.strerror}") from error
            else:
                if not data:
                    raise LinkError(f"tcp://{self._name} was closed by the vehicle")
                return data

    def send(self, data: bytes) -> bool:
        """All bytes or, when the line is full, none."""
        if not select.select((), (self._socket,), (), 0.0)[1]:
            return False
        try:
            self._socket.sendall(data)
        except BlockingIOError as error:
            raise LinkError(f"tcp://{self._name} takes no more bytes; the vehicle has stopped reading") from error
        except OSError as error:
            raise LinkError(f"tcp://{self._name} is lost: {error.strerror}") from error
        return True

    def keep_peer(self) -> None:
        """There is only one."""

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class SerialTransport:
    """A serial line by pyserial."""

    datagrams = False

    def __init__(self, uri: Uri) -> None:
        import serial

        self._error: type[Exception] = serial.SerialException
        self._name = uri.host
        try:
            self._line = serial.Serial(uri.host, uri.number, timeout=0, write_timeout=0.1)
        except serial.SerialException as error:
            raise LinkError(f"cannot open serial line {uri.host}: {error}") from error

    def receive(self, deadline: float) -> bytes | None:
        """Whatever bytes there are."""
        while True:
            try:
                data = bytes(self._line.read(_DATAGRAM))
            except self._error as error:
                raise LinkError(f"serial line {self._name} is lost: {error}") from error
            if data:
                return data
            if not _wait(self._line, deadline):
                return None

    def send(self, data: bytes) -> bool:
        """Write within 0.1 s."""
        try:
            self._line.write(data)
        except self._error as error:
            raise LinkError(f"serial line {self._name} is lost: {error}") from error
        return True

    def keep_peer(self) -> None:
        """There is only one."""

    def close(self) -> None:
        """Close the line."""
        self._line.close()


def _resolve(uri: Uri, kind: socket.SocketKind) -> tuple[int, Any]:
    try:
        found = socket.getaddrinfo(uri.host, uri.number, type=kind)
    except OSError as error:
        raise InputError(f"link.uri: host '{uri.host}' is not known ({error.strerror}); give an address") from error
    family, _, _, _, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, address


def _wait(readable: Any, deadline: float) -> bool:
    remaining = deadline - time.monotonic()
    return remaining > 0.0 and bool(select.select((readable,), (), (), remaining)[0])
