"""How fast the vehicle is alone: an OFFBOARD flight with set-points at 50 Hz and every onboard stream encoded for one client.

Prints simulated over wall-clock time and over processor time, and the microseconds of each part for a simulated second. Nothing is sent.
"""

import gc
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin
from time import perf_counter, process_time
from typing import Any

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.results import Result
from vehicle_sim.autopilot.setpoints import SetpointMessage
from vehicle_sim.config import VehicleConfig
from vehicle_sim.errors import VehicleError
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

_TICK_US = 20_000
_RADIUS_M, _SPEED_MPS, _HEIGHT_M = 9.0, 3.0, 3.0


@dataclass(frozen=True)
class BenchResult:
    """Factors, steps a second, messages a second, microseconds of each part for a simulated second."""

    seconds: float
    wall_factor: float
    processor_factor: float
    steps_hz: float
    messages_hz: float
    parts_us: dict[str, float]


def run_bench(seconds: float, config: VehicleConfig | None = None) -> BenchResult:
    """Fly a circle for that long, once plainly and once with the parts timed."""
    node = Node(Vehicle(config or VehicleConfig(), 1), lockstep=False)
    session = node.session("client")
    _take_off(node)
    gc.collect()
    gc.freeze()
    begin_s, begin_cpu_s = perf_counter(), process_time()
    messages = _fly(node, seconds)
    wall_s, cpu_s = perf_counter() - begin_s, process_time() - begin_cpu_s
    vehicle = node.vehicle
    parts: dict[str, float] = {}
    for owner, method, name in (
        (node, "advance_to", "whole tick"),
        (vehicle, "advance", "advance: physics and autopilot"),
        (vehicle.autopilot, "tick", "of that, the autopilot outside the kernel"),
        (session, "poll", "telemetry encoded"),
        (vehicle.autopilot, "receive_setpoint", "set-points taken in"),
    ):
        _time_calls(owner, method, name, parts)
    _fly(node, seconds)
    return BenchResult(
        seconds,
        seconds / wall_s,
        seconds / cpu_s,
        1e6 / vehicle.step_us,
        messages / seconds,
        {name: spent / seconds * 1e6 for name, spent in parts.items()},
    )


def describe(result: BenchResult) -> str:
    """The table that is printed."""
    lines = [
        f"{result.seconds:g} s of OFFBOARD flight, physics and rate loop at {result.steps_hz:g} Hz, "
        f"{result.messages_hz:.0f} messages a second encoded",
        f"x real time: {result.wall_factor:.0f} by the wall clock, {result.processor_factor:.0f} by processor time",
        "microseconds for a simulated second (timed in a second flight; timing itself costs some):",
    ]
    lines += [f"  {name:45s} {spent:7.0f}" for name, spent in result.parts_us.items()]
    return "\n".join(lines)


def _take_off(node: Node) -> None:
    pilot = node.vehicle.autopilot
    _fly(node, 5.0)
    if (pilot.request_mode(Mode.OFFBOARD), pilot.request_arm()) != (Result.ACCEPTED, Result.ACCEPTED):
        raise VehicleError("the bench's vehicle cannot be armed with this configuration; try the default one")
    _fly(node, 6.0)


def _fly(node: Node, seconds: float) -> int:
    vehicle, session, messages = node.vehicle, node.session("client"), 0
    end_us = vehicle.t_us + round(seconds * 1e6)
    while vehicle.t_us < end_us:
        vehicle.autopilot.receive_setpoint(_circle(vehicle.t_s), vehicle.estimate)
        node.advance_to(vehicle.t_us + _TICK_US)
        messages += len(node.take(session))
        node.journal.clear()
    return messages


def _circle(t_s: float) -> SetpointMessage:
    r, v = _RADIUS_M, _SPEED_MPS
    angle = v / r * t_s
    s, c = sin(angle), cos(angle)
    place, velocity = (r * s, r * (1.0 - c), -_HEIGHT_M), (v * c, v * s, 0.0)
    return SetpointMessage(1, 0, place, velocity, (-v * v / r * s, v * v / r * c, 0.0), 0.0, 0.0)


def _time_calls(owner: Any, method: str, name: str, spent: dict[str, float]) -> None:
    original: Callable[..., Any] = getattr(owner, method)
    spent[name] = 0.0

    def timed(*arguments: Any) -> Any:
        begin_s = perf_counter()
        result = original(*arguments)
        spent[name] += perf_counter() - begin_s
        return result

    setattr(owner, method, timed)
