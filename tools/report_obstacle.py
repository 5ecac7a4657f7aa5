"""Report an obstacle to a flight over Zenoh.

    python tools/report_obstacle.py crane 30,12 34,12 34,18 [--height 20] [--vehicle uav1] [--connect tcp/127.0.0.1:7447]

The payload is JSON, {"name": .., "polygon": [[x, y], ..], "height_m": ..}, on the key sitl/VEHICLE/obstacles; positions
are metres in the world's frame, x east, y north.
"""

import argparse
import json
import signal
import sys
import time

import zenoh

from sandwich_sitl.config import ZenohConfig
from sandwich_sitl.errors import InputError, LinkError, SandwichError
from sandwich_sitl.mission.reports import parse_obstacle
from sandwich_sitl.recording.streams import session_config
from sandwich_sitl.recording.topics import obstacle_key

_LISTENER_S = 10.0
_POLL_S = 0.02


def main() -> int:
    """Returns the exit status: 0 when a flight was there to hear it, 2 for an obstacle that is none, 5 without a flight."""
    parser = argparse.ArgumentParser(description="Report an obstacle to a flight over Zenoh.")
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("corners", nargs="+", metavar="X,Y", help="corners of the outline in order, metres")
    parser.add_argument("--height", type=float, metavar="M", help="above the ground; left out: unknown")
    parser.add_argument("--vehicle", default=ZenohConfig().vehicle_name, metavar="NAME", help="zenoh.vehicle_name")
    parser.add_argument("--connect", default=ZenohConfig().listen[0], metavar="END_POINT", help="one of zenoh.listen")
    options = parser.parse_args()
    try:
        payload = _payload(options)
        parse_obstacle(payload)
        _report(options.connect, options.vehicle, payload)
    except SandwichError as error:
        print(f"report_obstacle: {error}", file=sys.stderr)
        return error.exit_status
    return 0


def _payload(options: argparse.Namespace) -> bytes:
    try:
        polygon = [[float(x) for x in corner.split(",")] for corner in options.corners]
    except ValueError as error:
        raise InputError(f"corners: {error}; write each as X,Y") from error
    said = {"name": options.name, "polygon": polygon}
    return json.dumps(said if options.height is None else {**said, "height_m": options.height}).encode()


def _report(end_point: str, vehicle: str, payload: bytes) -> None:
    try:
        session = zenoh.open(session_config(ZenohConfig(listen=(), connect=(end_point,))))
    except zenoh.ZError as error:
        raise InputError(f"--connect {end_point}: {str(error).splitlines()[0]}") from error
    with session:
        publisher = session.declare_publisher(obstacle_key(vehicle), reliability=zenoh.Reliability.RELIABLE)
        deadline_s = time.monotonic() + _LISTENER_S
        while not publisher.matching_status.matching:
            if time.monotonic() > deadline_s:
                raise LinkError(f"no flight of '{vehicle}' listens on {end_point} within {_LISTENER_S:g} s")
            time.sleep(_POLL_S)
        publisher.put(payload, encoding="application/json")


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    sys.exit(main())
