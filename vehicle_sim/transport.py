"""Sockets of the vehicle: UDP ports and TCP listeners as one inbox of (client, bytes) and one outbox. Nothing here blocks for ever.

A client is `(number of the endpoint, address)`. What arrives over TCP is cut at frame borders first.
"""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from vehicle_sim.endpoints import Address, Endpoint
from vehicle_sim.errors import EndpointError
from vehicle_sim.protocol.codec import StreamSplitter

_MAX_DATAGRAM = 65535
_MAX_BATCH = 64
_SAFE_DATAGRAM = 1400
_MAX_TCP_CLIENTS = 8


class Client(NamedTuple):
    """Who is spoken with."""

    endpoint: int
    address: Address


class Transport:
    """All sockets of one vehicle."""

    def __init__(self, endpoints: list[Endpoint]) -> None:
        self._udp: dict[int, socket.socket] = {}
        self._listeners: dict[int, socket.socket] = {}
        self._streams: dict[Client, tuple[socket.socket, StreamSplitter]] = {}
        self.targets: list[Client] = []
        try:
            for number, endpoint in enumerate(endpoints):
                if endpoint.kind == "udp":
                    self._udp[number] = _bound(endpoint.bind, socket.SOCK_DGRAM)
                    if endpoint.target is not None:
                        self.targets.append(Client(number, _resolve(endpoint.target)))
                else:
                    self._listeners[number] = _bound(endpoint.bind, socket.SOCK_STREAM)
        except EndpointError:
            self.close()
            raise

    def address(self, endpoint: int) -> Address:
        """Where an endpoint is bound."""
        host, port = (self._udp.get(endpoint) or self._listeners[endpoint]).getsockname()[:2]
        return str(host), int(port)

    def receive(self, wait_s: float) -> list[tuple[Client, bytes]]:
        """What has come, after waiting at most `wait_s` for something to come."""
        sockets = [*self._udp.values(), *self._listeners.values(), *(sock for sock, _ in self._streams.values())]
        ready = set(select.select(sockets, [], [], wait_s)[0])
        found: list[tuple[Client, bytes]] = []
        for number, sock in self._udp.items():
            if sock in ready:
                found += _datagrams(number, sock)
        for number, listener in self._listeners.items():
            if listener in ready:
                self._accept(number, listener)
        for client in [client for client, (sock, _) in self._streams.items() if sock in ready]:
            data = self._read(client)
            if data:
                found.append((client, data))
        return found

    def send(self, client: Client, frames: list[bytes]) -> None:
        """A client that is gone is no reason to stop: errors of the network stack are the client's silence."""
        if client.endpoint in self._udp:
            for datagram in join(frames):
                self.send_datagram(client, datagram)
        elif client in self._streams and frames:
            try:
                self._streams[client][0].sendall(b"".join(frames))
            except OSError:
                self.drop(client)

    def send_datagram(self, client: Client, datagram: bytes) -> None:
        """One UDP datagram as it is."""
        try:
            self._udp[client.endpoint].sendto(datagram, client.address)
        except OSError:
            return

    def is_datagram(self, client: Client) -> bool:
        """Spoken with over UDP."""
        return client.endpoint in self._udp

    def drop(self, client: Client) -> None:
        """Close a TCP connection."""
        if client in self._streams:
            self._streams.pop(client)[0].close()

    def is_open(self, client: Client) -> bool:
        """False for a TCP client that has gone."""
        return client.endpoint in self._udp or client in self._streams

    def close(self) -> None:
        """Close everything."""
        for sock in (*self._udp.values(), *self._listeners.values(), *(sock for sock, _ in self._streams.values())):
            sock.close()

    def _accept(self, number: int, listener: socket.socket) -> None:
        try:
            sock, address = listener.accept()
        except OSError:
            return
        if len(self._streams) >= _MAX_TCP_CLIENTS:
            sock.close()
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.settimeout(_TCP_SEND_S)
        self._streams[Client(number, (str(address[0]), int(address[1])))] = (sock, StreamSplitter())

    def _read(self, client: Client) -> bytes:
        sock, splitter = self._streams[client]
        try:
            data = sock.recv(_MAX_DATAGRAM)
        except OSError:
            data = b""
        if not data:
            self.drop(client)
            return b""
        return splitter.feed(data)


_TCP_SEND_S = 0.2


@contextmanager
def open_transport(endpoints: list[Endpoint]) -> Iterator[Transport]:
    """Sockets that close with the block."""
    transport = Transport(endpoints)
    try:
        yield transport
    finally:
        transport.close()


def join(frames: list[bytes]) -> list[bytes]:
    """Frames joined into datagrams that fit an Ethernet frame."""
    joined: list[bytes] = []
    for frame in frames:
        if joined and len(joined[-1]) + len(frame) <= _SAFE_DATAGRAM:
            joined[-1] += frame
        else:
            joined.append(frame)
    return joined


def _datagrams(number: int, sock: socket.socket) -> list[tuple[Client, bytes]]:
    found: list[tuple[Client, bytes]] = []
    while len(found) < _MAX_BATCH:
        try:
            datagram, address = sock.recvfrom(_MAX_DATAGRAM)
        except BlockingIOError:
            break
        except ConnectionError:
            continue
        found.append((Client(number, (str(address[0]), int(address[1]))), datagram))
    return found


def _bound(bind: Address, kind: socket.SocketKind) -> socket.socket:
    sock = None
    try:
        sock = socket.socket(socket.AF_INET, kind)
        if kind == socket.SOCK_STREAM:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(bind)
        if kind == socket.SOCK_STREAM:
            sock.listen(_MAX_TCP_CLIENTS)
    except OSError as error:
        if sock is not None:
            sock.close()
        raise EndpointError(
            f"{bind[0]}:{bind[1]} cannot be bound ({error.strerror or error}); end the program that holds the port or choose "
            "another with --bind"
        ) from error
    sock.setblocking(False)
    return sock


def _resolve(address: Address) -> Address:
    """The address as `recvfrom` will show it."""
    try:
        found = socket.getaddrinfo(*address, family=socket.AF_INET, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise EndpointError(f"{address[0]}:{address[1]}: unknown host ({error.strerror or error})") from error
    host, port = found[0][4][:2]
    return str(host), int(port)
