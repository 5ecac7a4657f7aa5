"""Connection URIs: `udpout://HOST:PORT` sends to that client, `udpin://HOST:PORT` waits there for clients."""

from dataclasses import dataclass
from urllib.parse import urlsplit

from vehicle_sim.errors import EndpointError

Address = tuple[str, int]
DEFAULT_BIND: Address = ("127.0.0.1", 14580)


@dataclass(frozen=True)
class Endpoints:
    """Where to bind, and the client to send to from the start, if any."""

    bind: Address
    target: Address | None


def parse_endpoints(uri: str, bind: str | None) -> Endpoints:
    """Read --connect and --bind. Raises `EndpointError` with the right form."""
    parts = urlsplit(uri)
    if parts.scheme not in ("udpout", "udpin"):
        raise EndpointError(f"--connect {uri}: must be udpout://HOST:PORT or udpin://HOST:PORT")
    address = parse_address(uri.partition("://")[2].rstrip("/"), f"--connect {uri}")
    if parts.scheme == "udpin":
        if bind is not None:
            raise EndpointError(f"--bind {bind}: is for udpout; udpin binds to the address of --connect")
        return Endpoints(address, None)
    if address[1] == 0:
        raise EndpointError(f"--connect {uri}: port 0 cannot be sent to; give the client's port")
    return Endpoints(parse_address(bind, f"--bind {bind}") if bind is not None else DEFAULT_BIND, address)


def parse_address(text: str, where: str) -> Address:
    """HOST:PORT."""
    host, _, port = text.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise EndpointError(f"{where}: must name HOST:PORT, such as 127.0.0.1:14580")
    return host, int(port)
