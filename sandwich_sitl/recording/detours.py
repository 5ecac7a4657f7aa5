"""What obstacles that were not known before take-off made of a flight, read from its log alone.

Obstacles that count for the clearance: those of the vehicle's own configuration (the true ones, from the time at which
they appear) and those that were reported by name and outline (from when they were heard of). What a range sensor saw
is a guess about the true ones, and does not count.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.planning.prisms import Prisms
from sandwich_sitl.recording.reader import RunLog

Array = NDArray[np.float64]
Section = dict[str, Any]


@dataclass(frozen=True)
class Appeared:
    """An obstacle that is there from `t_s` on, and how high it is in the way."""

    name: str
    t_s: float
    polygon: shapely.Polygon
    top_m: float


def appeared(log: RunLog) -> tuple[Appeared, ...]:
    """Obstacles that the map did not show: the vehicle's own, then the reported ones."""
    configuration = json.loads(log.metadata.get("vehicle", {}).get("configuration", "{}"))
    hidden = configuration.get("vehicle", {}).get("obstacles", ())
    floors = log.plan is not None and log.plan.floors is not None

    def top(height_m: float | None) -> float:
        return height_m if floors and height_m is not None else np.inf

    own = tuple(
        Appeared(o["name"], float(o["appears_s"]), shapely.Polygon(o["polygon_m"]), top(o.get("height_m")))
        for o in hidden
    )
    named = tuple(
        Appeared(o.name, o.heard_s, shapely.Polygon(o.ring_m), top(o.height_m))
        for o in log.reported
        if o.source == "message"
    )
    return own + named


def appeared_clearance_m(log: RunLog, flown: NDArray[np.bool_]) -> float | None:
    """Least distance of the true path, at its samples `flown` (N,), to obstacles while they were there."""
    least = []
    for obstacle in appeared(log):
        path_m = log.truth.r_m[flown & (log.truth.t_s >= obstacle.t_s)]
        if len(path_m):
            ring_m = shapely.get_coordinates(obstacle.polygon.exterior)
            least.append(Prisms([ring_m], np.array([obstacle.top_m])).distance_of_path_m(path_m))
    return min(least, default=None)


def detours_section(log: RunLog) -> Section:
    """How many obstacles were heard of and how many plans they led to; seconds from report to set-point, and wall time."""
    updates = [update for update in log.updates if update.verdict != "onward"]
    waits_s = np.array([update.t_s - update.heard_s for update in updates])
    wall_ms = 1e3 * np.array(json.loads(log.metadata.get("replans", {}).get("wall_s", "[]")))
    return {
        "obstacles": len(log.reported),
        "replans": len(updates),
        "routes": sum(update.verdict == "route" for update in log.updates),
        "stops": sum(update.verdict == "stop" for update in log.updates),
        "report_to_setpoint_s": _middle_and_most(waits_s),
        "planning_ms": _middle_and_most(wall_ms),
        "reasons": list(dict.fromkeys(update.reason for update in log.updates if update.reason)),
    }


def _middle_and_most(values: Array) -> Section:
    if not values.size:
        return {"p50": None, "max": None}
    return {"p50": float(np.median(values)), "max": float(values.max())}
