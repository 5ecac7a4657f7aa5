"""Connection URIs: `udpout://HOST:PORT` sends to that client, `udpin://HOST:PORT` waits there for clients, `tcp://HOST:PORT` listens."""

from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

from vehicle_sim.errors import EndpointError

Address = tuple[str, int]
DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 14580
_SCHEMES = ("udpout", "udpin", "tcp")


@dataclass(frozen=True)
class Endpoint:
    """Where to bind, and the client to send to from the start, if any."""

    kind: Literal["udp", "tcp"]
    bind: Address
    target: Address | None = None


def parse_endpoints(uris: list[str], bind: str | None, instance: int = 0) -> list[Endpoint]:
    """Read every --connect, and --bind, which is for the first `udpout`. Instance i adds i to ports, as PX4's do.

    Raises `EndpointError` with the right form.
    """
    first = next((uri for uri in uris if uri.startswith("udpout://")), None)
    if bind is not None and first is None:
        raise EndpointError(f"--bind {bind}: is for udpout; udpin and tcp bind to the address of --connect")
    return [_parse(uri, bind if uri is first else None, uri is first, instance) for uri in uris]


def _parse(uri: str, bind: str | None, is_first: bool, instance: int) -> Endpoint:
    parts = urlsplit(uri)
    if parts.scheme not in _SCHEMES:
        raise EndpointError(f"--connect {uri}: must be udpout://HOST:PORT, udpin://HOST:PORT or tcp://HOST:PORT")
    host, port = parse_address(uri.partition("://")[2].rstrip("/"), f"--connect {uri}")
    address = (host, port + instance if port else 0)
    if parts.scheme == "tcp":
        return Endpoint("tcp", address)
    if parts.scheme == "udpin":
        return Endpoint("udp", address)
    if port == 0:
        raise EndpointError(f"--connect {uri}: port 0 cannot be sent to; give the client's port")
    if bind is not None:
        own_host, own_port = parse_address(bind, f"--bind {bind}")
        return Endpoint("udp", (own_host, own_port + instance if own_port else 0), address)
    return Endpoint("udp", (DEFAULT_HOST, DEFAULT_PORT + instance if is_first else 0), address)


def parse_address(text: str, where: str) -> Address:
    """HOST:PORT."""
    host, _, port = text.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise EndpointError(f"{where}: must name HOST:PORT, such as 127.0.0.1:14580")
    return host, int(port)
