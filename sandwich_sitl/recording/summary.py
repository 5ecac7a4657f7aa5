"""The numbers of a run, every one computed from its log alone.

Input: a `RunLog`. Seconds of the flight are the vehicle's boot time; `wall_seconds` comes from metadata `result`. A
number that the log cannot give (no truth, no plan, killed early) is None.

Definitions. The flight lasts from arming to disarming; `path_flown_m` is the horizontal length of the true path in
that time and `min_clearance_m` the distance of that continuous path to the obstacles that were not grown: in plan, with
floors in space, to prisms of their heights, so that what is flown over counts by the air between; and in plan to those
that appeared in flight, from then on. Errors are
|truth - reference| in 3-D while the mission is ACTIVE, the reference interpolated to the truth's times.
"""

import json
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.check import examine
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.prisms import Prisms
from sandwich_sitl.recording.detours import appeared_clearance_m, detours_section
from sandwich_sitl.recording.ladder import assurance_section
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.regions import outside_m, whole_corridor
from sandwich_sitl.recording.spans import Span, spans, state_spans, within
from sandwich_sitl.recording.tracks import Frame

Array = NDArray[np.float64]
Section = dict[str, Any]

ACTIVE = "ACTIVE"
SAFETY_VIOLATION = "safety_violation"
REGION_TOLERANCE_M = 1e-9
INFEASIBLE_STATUS = (-1,)  # the solver gave no answer


def summarise(log: RunLog) -> Section:
    """The summary as plain data, ready for JSON."""
    run, result = log.metadata.get("run", {}), log.metadata.get("result", {})
    seed = run.get("seed")
    flight = _flight_section(log)
    outcome, reason = _verdict(result.get("outcome", "unfinished"), result.get("reason", ""), flight, log.plan)
    return {
        "name": run.get("name") or (log.plan.name if log.plan else None),
        "outcome": outcome,
        "reason": reason,
        "seed": int(seed) if seed is not None else None,
        "clock": run.get("clock"),
        "map": _map_section(log.plan),
        "route": _route_section(log.plan),
        "floors": _floors_section(log.plan),
        "flight": flight,
        "mpc": _mpc_section(log),
        "assurance": assurance_section(log),
        "detours": detours_section(log),
        "link": _link_section(log),
    }


def _verdict(outcome: str, reason: str, flight: Section, plan: FlightPlan | None) -> tuple[str, str]:
    """A landing that came nearer to an obstacle than the vehicle's radius is a safety violation."""
    clearance = flight["min_clearance_m"]
    if plan is None or clearance is None or clearance >= plan.vehicle_radius_m:
        return outcome, reason
    passed = f"passed {clearance:.3f} m from an obstacle, the vehicle's radius is {plan.vehicle_radius_m:g} m"
    return SAFETY_VIOLATION, f"{passed}; otherwise: {outcome}"


def format_summary(summary: Section) -> str:
    """The summary as lines for a terminal: one section a line, values with their keys' units."""
    head = " ".join(f"{key} {_shown(summary[key])}" for key in ("name", "seed", "clock"))
    reason = f" ({summary['reason']})" if summary["reason"] else ""
    lines = [f"outcome  {summary['outcome']}{reason}", f"run      {head}"]
    for section in ("map", "route", "floors", "flight", "mpc", "assurance", "detours", "link"):
        if section == "floors" and summary[section]["altitude_m"] is None:
            continue
        items = ", ".join(f"{key} {_shown(value)}" for key, value in summary[section].items())
        lines.append(f"{section:8s} {items}")
    return "\n".join(lines)


def route_lengths(plan: FlightPlan) -> Section:
    """The three routes' lengths and the Sandwich route's reduction against grid A*, in percent of the latter."""
    sandwich_m, grid_m, exact_m = (path_length(xy) for xy in (plan.sandwich_m, plan.grid_astar_m, plan.exact_m))
    return {
        "sandwich_m": sandwich_m,
        "grid_astar_m": grid_m,
        "exact_m": exact_m,
        "reduction_percent": 100.0 * (grid_m - sandwich_m) / grid_m if grid_m > 0 else None,
    }


def active_spans(log: RunLog) -> list[Span]:
    """Intervals [from, to) in which the mission's state was ACTIVE."""
    return state_spans(log, ACTIVE)


def tracking_error(log: RunLog) -> tuple[Array, Array]:
    """Times (N,) and |truth - reference| (N,) in metres while ACTIVE, at the truth's times."""
    control_on = within(log.control.t_s, active_spans(log))
    t_s, reference_m = log.control.t_s[control_on], log.control.reference_m[control_on]
    if t_s.size == 0 or log.truth.t_s.size == 0:
        return np.empty(0), np.empty(0)
    inside = within(log.truth.t_s, active_spans(log)) & (log.truth.t_s >= t_s[0]) & (log.truth.t_s <= t_s[-1])
    at_s = log.truth.t_s[inside]
    return at_s, np.linalg.norm(log.truth.r_m[inside] - _interpolate(at_s, t_s, reference_m), axis=1)


def _map_section(plan: FlightPlan | None) -> Section:
    keys = (
        "channels",
        "nodes",
        "bays",
        "flow",
        "folded_cells",
        "repaired_cells",
        "min_jacobian_ratio",
        "coverage",
        "check",
        "seconds",
    )
    if plan is None:
        return dict.fromkeys(keys)
    quality = plan.channel_map.quality
    seconds = plan.seconds.get("channel map")
    values = (
        plan.channel_map.channels,
        plan.channel_map.nodes,
        len(plan.channel_map.bays),
        plan.channel_map.flow,
        quality.folded_cells,
        quality.repaired_cells,
        quality.min_jacobian_ratio,
        quality.coverage,
        "; ".join(examine(plan.channel_map).failures) or "passed",
        seconds,
    )
    return dict(zip(keys, values, strict=True))


def _route_section(plan: FlightPlan | None) -> Section:
    """Lengths; `duration_ratio` is the timed way's over the time-optimal law's along the same curve."""
    if plan is None:
        keys = ("sandwich_m", "grid_astar_m", "exact_m", "reduction_percent", "tight_m", "duration_ratio")
        return dict.fromkeys(keys)
    return route_lengths(plan) | {
        "tight_m": path_length(plan.tight_m) if len(plan.tight_m) else None,
        "duration_ratio": plan.flight.duration_s / plan.flight.least_duration_s if plan.flight else None,
    }


def _floors_section(plan: FlightPlan | None) -> Section:
    """The floor that the route rises to, and the way in space between the floors of start and goal."""
    keys = ("altitude_m", "length_m", "climbed_m", "descended_m", "changes", "least_headroom_m")
    if plan is None or plan.floors is None:
        return dict.fromkeys(keys)
    floors, headroom_m = plan.floors, plan.proof.least_headroom_m if plan.proof else None
    values = plan.map_altitude_m, floors.length_m, floors.climbed_m, floors.descended_m, floors.changes, headroom_m
    return dict(zip(keys, values, strict=True))


def _flight_section(log: RunLog) -> Section:
    in_flight = spans(log, log.mission.armed.tolist())
    flown = within(log.truth.t_s, in_flight)
    path_m = log.truth.r_m[flown]
    clearances_m = [clearance_m(path_m, log.plan), appeared_clearance_m(log, flown)]
    _, error_m = tracking_error(log)
    wall_text = log.metadata.get("result", {}).get("wall_seconds")
    wall_s = float(wall_text) if wall_text is not None else None
    return {
        "duration_s": sum(end - start for start, end in in_flight),
        "path_flown_m": path_length(path_m[:, :2]) if len(path_m) else None,
        "rms_error_m": float(np.sqrt(np.mean(error_m**2))) if error_m.size else None,
        "max_error_m": float(error_m.max()) if error_m.size else None,
        "min_clearance_m": min((metres for metres in clearances_m if metres is not None), default=None),
        "quadrangle_violations": _quadrangle_violations(log),
        "wall_seconds": wall_s,
        "realtime_factor": (log.span_s[1] - log.span_s[0]) / wall_s if wall_s else None,
    }


def clearance_m(path_m: Array, plan: FlightPlan | None) -> float | None:
    """Least distance of the continuous path (N, 3) to the obstacles themselves; 0 when it touches one."""
    if plan is None or not plan.obstacles_m or len(path_m) == 0:
        return None
    return Prisms(plan.obstacles_m, plan.blocking_heights_m).distance_of_path_m(path_m)


def _quadrangle_violations(log: RunLog) -> int | None:
    """Control samples while ACTIVE at which the true position lies outside its region."""
    chosen = within(log.control.t_s, active_spans(log)) & (log.control.region >= 0)
    corridor = whole_corridor(log)
    if corridor is None or log.truth.t_s.size == 0:
        return None
    r_m = _interpolate(log.control.t_s[chosen], log.truth.t_s, log.truth.r_m)
    return int(np.count_nonzero(outside_m(corridor, r_m, log.control.region[chosen]) > REGION_TOLERANCE_M))


def _mpc_section(log: RunLog) -> Section:
    solved = log.control.solver_status != 0
    slack_m = log.control.slack_m[solved & np.isfinite(log.control.slack_m)]
    timings = log.timings
    return {
        "ticks": int(np.count_nonzero(solved)),
        "solve_ms": _percentiles(timings.solve_s[timings.solve_s > 0] * 1e3),
        "loop_ms": _percentiles(timings.loop_s[timings.solve_s > 0] * 1e3),
        "infeasible": int(np.isin(log.control.solver_status, INFEASIBLE_STATUS).sum()),
        "deadline_misses": int(np.count_nonzero(timings.late_s > 0)),
        "max_slack_m": float(slack_m.max()) if slack_m.size else None,
    }


def _link_section(log: RunLog) -> Section:
    """Frames, and `refused`: set-points that the fence kept from being sent."""
    received = log.frames_of("/mavlink/rx")
    refused = log.metadata.get("result", {}).get("refused")
    return {
        "sent": len(log.frames_of("/mavlink/tx")),
        "received": len(received),
        "lost": lost_frames(received),
        "refused": int(refused) if refused is not None else None,
    }


def lost_frames(frames: tuple[Frame, ...]) -> int:
    """Gaps in the MAVLink sequence numbers of each sender; a repeated or late frame is no loss."""
    last: dict[tuple[int, int], int] = {}
    lost: dict[tuple[int, int], int] = defaultdict(int)
    for frame in frames:
        header = _sequence_and_sender(frame.data)
        if header is None:
            continue
        sequence, sender = header
        step = (sequence - last.get(sender, sequence - 1)) % 256
        if 0 < step < 128:
            lost[sender] += step - 1
            last[sender] = sequence
    return sum(lost.values())


def _sequence_and_sender(frame: bytes) -> tuple[int, tuple[int, int]] | None:
    """Sequence number and (system, component) of a MAVLink 2 or 1 frame."""
    if len(frame) >= 10 and frame[0] == 0xFD:
        return frame[4], (frame[5], frame[6])
    if len(frame) >= 8 and frame[0] == 0xFE:
        return frame[2], (frame[3], frame[4])
    return None


def _interpolate(at_s: Array, t_s: Array, values: Array) -> Array:
    return np.column_stack([np.interp(at_s, t_s, column) for column in values.T])


def _percentiles(values: Array) -> Section:
    if values.size == 0:
        return {"p50": None, "p99": None, "max": None}
    p50, p99, most = np.percentile(values, (50, 99, 100))
    return {"p50": float(p50), "p99": float(p99), "max": float(most)}


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "/".join(_shown(item) for item in value.values())
    if isinstance(value, float):
        return f"{value:.3f}"
    return "-" if value is None else value if isinstance(value, str) else json.dumps(value)
