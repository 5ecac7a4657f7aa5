"""A link's URI, as MAVSDK users write it (`udpin://HOST:PORT`) or as pymavlink users do (`udpin:HOST:PORT`)."""

import re
from dataclasses import dataclass

FORMS = "udpin://HOST:PORT, udpout://HOST:PORT, tcp://HOST:PORT or serial://DEVICE:BAUD"


@dataclass(frozen=True)
class Uri:
    """A link's URI in parts; `number` is a port (0, of `udpin` alone: any free one), or the baud rate of a serial line."""

    kind: str
    host: str
    number: int


def parse_uri(text: str) -> Uri:
    """Raises `ValueError` for anything that is not one of the four forms."""
    match = re.fullmatch(r"(udpin|udpout|tcp|serial):(?://)?(.+):(\d+)", text, re.ASCII)
    if match is None:
        raise ValueError(f"is not a connection URI; write {FORMS}")
    kind, host, number = match[1], match[2].strip("[]"), int(match[3])
    if kind == "serial" and number == 0:
        raise ValueError("the baud rate must be positive, for example 57600")
    if kind != "serial" and not (kind != "udpin") <= number < 65536:
        raise ValueError(f"port {number} is not within 1..65535")
    return Uri(kind, host, number)


def valid_uri(text: str) -> str:
    """The text, when it is a URI; for the configuration. Raises `ValueError`."""
    parse_uri(text)
    return text
