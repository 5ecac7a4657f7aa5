"""The vehicle program as `bench loop` starts it: `vehicle-sim`'s own command line, observed.

    python -m sandwich_sitl.bench.loop_vehicle REPORT.npz {plain|timed} VEHICLE-SIM-ARGUMENTS

At its end it leaves processor time, peak memory and, when `timed`, the parts of every tick in REPORT.npz.
"""

import sys
from collections.abc import Callable, Sequence
from time import process_time

import numpy as np

from sandwich_sitl.bench.child import peak_memory_mib
from sandwich_sitl.bench.stopwatch import REST, Stopwatch
from vehicle_sim.cli import main
from vehicle_sim.protocol.node import Node
from vehicle_sim.protocol.session import Session
from vehicle_sim.recorder import Recorder
from vehicle_sim.server import Server
from vehicle_sim.transport import Transport
from vehicle_sim.vehicle import Vehicle

_PARTS = (
    (Transport, "receive", "wait for the other side"),
    (Server, "_decode", "decode"),
    (Node, "handle", "messages handled"),
    (Vehicle, "advance", "physics and autopilot"),
    (Session, "poll", "telemetry encoded"),
    (Recorder, "sample", "truth sampled"),
    (Server, "_send_to_peer", "send"),
    (Server, "_record", "record"),
)


def observed(arguments: Sequence[str]) -> int:
    """Run `vehicle-sim` and write the report; its exit status."""
    report, how, *given = arguments
    watch = Stopwatch()
    if how == "timed":
        for owner, method, part in _PARTS:
            watch.around(owner, method, part)
        watch.around(Server, "_take_lockstep", REST, ends_tick=True)
    spent: list[float] = []
    serve = Server.run

    def run(self: Server, stopped: Callable[[], bool]) -> None:
        begin = process_time()
        serve(self, stopped)
        spent.append(process_time() - begin)

    Server.run = run  # type: ignore[method-assign]
    status = main(given)
    parts = watch.parts().arrays()
    np.savez(report, processor_s=sum(spent), memory_mib=peak_memory_mib(), **parts)  # type: ignore[arg-type]
    return status


if __name__ == "__main__":
    sys.exit(observed(sys.argv[1:]))
