"""Bytes in and out: UDP, TCP and serial lines behind one non-blocking interface.

Input: a URI (`link_uri`). Times are wall seconds of `time.monotonic`. What this machine cannot open (a port that is taken,
an address or a serial line that it does not have) raises `InputError`, a peer that does not answer `LinkError`. pyserial is
imported when a serial line is opened.
"""

import errno
import os
import select
import socket
import time
from pathlib import Path
from typing import Any, Protocol

from sandwich_sitl.errors import InputError, LinkError
from sandwich_sitl.link_uri import Uri, parse_uri

_RECEIVE_BUFFER = 4 << 20
_DATAGRAM = 65535
_CONNECT_S = 5.0


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


def open_transport(text: str) -> Transport:
    """Open the link that `text` names. Raises `InputError` or `LinkError`."""
    uri = _read(text)
    if uri.kind == "serial":
        return SerialTransport(uri)
    if uri.kind == "tcp":
        return TcpTransport(uri)
    return UdpTransport(uri)


def check_openable(text: str) -> None:
    """Raise `InputError` for a link that this machine cannot open. Nothing is sent; a TCP peer is not asked."""
    uri = _read(text)
    if uri.kind == "serial" and not Path(uri.host).exists():
        raise InputError(_no_line(uri, "No such file or directory"))
    if uri.kind in ("udpin", "udpout"):
        UdpTransport(uri).close()


def _read(text: str) -> Uri:
    try:
        return parse_uri(text)
    except ValueError as error:
        raise InputError(f"link.uri '{text}': {error}") from error


def _no_line(uri: Uri, reason: str) -> str:
    return f"link.uri: serial line {uri.host} cannot be opened ({reason}); give the device of one that is there"


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
                    f"UDP port {uri.number} on {uri.host} is occupied by another process; end that process or give another "
                    f"port, as --set link.uri=udpin://{uri.host}:PORT"
                ) from error
            raise InputError(
                f"link.uri: cannot listen on {uri.host}:{uri.number} ({error.strerror}); give an address of this machine, "
                "such as 127.0.0.1, or 0.0.0.0 for all of them, and a port above 1023"
            ) from error


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
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise InputError(_no_line(uri, reason)) from error

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
