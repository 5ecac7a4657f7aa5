"""Whole flights with the full vehicle in lockstep, many seeds under each condition: how well the reference is kept.

Numbers of a flight come from its log: truth against reference while ACTIVE, and the truth's continuous path (samples
at 100 Hz and the chords' middles) against the corridor. `route` leaves out the climb over the start.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig, load_config
from sandwich_sitl.launcher import make_plan, run
from sandwich_sitl.planning.corridor import paper_corridor
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.reference import paper_reference
from sandwich_sitl.progress import Progress
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.regions import outside_m, whole_corridor
from sandwich_sitl.recording.spans import within
from sandwich_sitl.recording.summary import REGION_TOLERANCE_M, active_spans, tracking_error

Array = NDArray[np.float64]

_PERFECT = {
    "vehicle.sensors.estimator": "error_model",
    "vehicle.sensors.estimate_position_std_m": 0.0,
    "vehicle.sensors.estimate_velocity_std_mps": 0.0,
    "vehicle.sensors.estimate_attitude_std_rad": 0.0,
}
_FAST = {"planner.speed_mps": 6.0, "planner.acceleration_mps2": 4.0}
_GUSTS = {"vehicle.wind.mean_enu_mps": [5.0, 0.0, 0.0], "vehicle.wind.gust_std_mps": [1.5, 1.5, 0.7]}
# A fifth heavier, motors slower by half (0.02 -> 0.03 s), three times the drag (0.02 -> 0.06): the autopilot's gains and
# the controller stay as they are.
_OTHER_VEHICLE = {
    "vehicle.airframe.mass_kg": 2.4,
    "vehicle.airframe.motor_time_constant_s": 0.03,
    "vehicle.airframe.quadratic_drag_n_per_mps2": 0.06,
}

CONDITIONS: Mapping[str, Mapping[str, Any]] = {
    "calm, exact estimate": _PERFECT,
    "6 m/s, exact estimate": {**_PERFECT, **_FAST},
    "wind 8 m/s, exact estimate": {**_PERFECT, "vehicle.wind.mean_enu_mps": [8.0, 0.0, 0.0]},
    "default noise": {},
    "noise, gusts round 5 m/s": _GUSTS,
    "noise, gusts, 6 m/s": {**_GUSTS, **_FAST},
    "noise, gusts, another vehicle": {**_GUSTS, **_OTHER_VEHICLE},
    "gusts, filter estimate": {**_GUSTS, "vehicle.sensors.estimator": "filter"},
}
PAPER: Mapping[str, Mapping[str, Any]] = {
    "paper, 0.37 s a node": {"mode": "paper", "mpc.step_s": 0.37, "mpc.bandwidth_radps": 4.0},
    "paper, 0.2 s a node": {"mode": "paper", "mpc.step_s": 0.2, "mpc.bandwidth_radps": 4.0},
    "paper, 0.1 s a node": {"mode": "paper", "mpc.step_s": 0.1, "mpc.bandwidth_radps": 4.0},
    "timed": {},
}

Planner = Callable[[RunConfig, Path, Progress], FlightPlan]


def _nodes(config: RunConfig, path: Path, progress: Progress) -> FlightPlan:
    """The paper's reference and regions for a controller that is ours: one node a step, raw quadrangles."""
    plan = make_plan(config, path, progress)
    reference, corridor = paper_reference(config, plan.channel_map, plan.sandwich_m)
    return dataclasses.replace(plan, reference=reference, corridor=corridor, route_kind="sandwich", proof=None)


def _quadrangles(config: RunConfig, path: Path, progress: Progress) -> FlightPlan:
    """Our reference between the paper's raw quadrangles."""
    plan = make_plan(config, path, progress)
    return dataclasses.replace(plan, corridor=paper_corridor(plan.corridor.neighbours_m), proof=None)


def _ours(config: RunConfig, path: Path, progress: Progress) -> FlightPlan:
    """Our reference and regions for the paper's controller."""
    return make_plan(dataclasses.replace(config, mode="timed"), path, progress)


_UNCHECKED = {"assurance.region_tolerance_m": 1e3}  # raw quadrangles may miss their own reference
ABLATION: Mapping[str, tuple[Mapping[str, Any], Planner]] = {
    "ours": ({}, make_plan),
    "A* route instead of the tight": ({"planner.route": "sandwich"}, make_plan),
    "a node a step, raw quadrangles": (_UNCHECKED, _nodes),
    "raw quadrangles": (_UNCHECKED, _quadrangles),
    "Euler, no limits, no check": ({"mode": "paper"}, _ours),
    "the same, step 0.05 s": ({"mode": "paper", "mpc.step_s": 0.05, "mpc.horizon_steps": 40}, _ours),
    "no offset aimed off": ({"tracking.offset_limit_m": 1e-6}, make_plan),
    "no delay made up for": ({"tracking.delay_s": 0.0}, make_plan),
    "neither": ({"tracking.offset_limit_m": 1e-6, "tracking.delay_s": 0.0}, make_plan),
    "bandwidth 4 rad/s": ({"mpc.bandwidth_radps": 4.0}, make_plan),
    "horizon 0.5 s": ({"mpc.step_s": 0.025}, make_plan),
}
# By GPS, whose errors and loss want more room than the 0.6 m of the shipped runs.
_BY_GPS = {"vehicle.sensors.estimator": "filter", "planner.margin_m": 1.5}
# A little above what the vehicle says of itself in normal flight, so that it rests before its own failsafe acts.
_GPS_LOST = {**_BY_GPS, "assurance.position_std_m": 0.45}
FAULTS: Mapping[str, Mapping[str, Any]] = {
    "wind step of 12 m/s": {"vehicle.failures": [{"at_s": 25, "part": "wind", "wind_enu_mps": [0, 12, 0]}]},
    "GPS lost for 5 s": {
        **_GPS_LOST,
        "vehicle.failures": [{"at_s": 25, "part": "gps"}, {"at_s": 30, "part": "gps", "ok": True}],
    },
    "GPS lost": {**_GPS_LOST, "vehicle.failures": [{"at_s": 25, "part": "gps"}]},
    "barometer lost": {**_BY_GPS, "vehicle.failures": [{"at_s": 25, "part": "barometer"}]},
    "magnetometer lost": {"vehicle.failures": [{"at_s": 25, "part": "magnetometer"}]},
    "battery empties": {"vehicle.failures": [{"at_s": 25, "part": "battery"}]},
    "half a battery, a tired pack": {"vehicle.battery.initial_charge": 0.3, "vehicle.battery.capacity_ah": 1.0},
    "estimate off by 0.3 m": {
        "vehicle.sensors.estimate_position_std_m": 0.3, "vehicle.sensors.estimate_correlation_s": 2.0
    },
}  # fmt: skip


@dataclass(frozen=True)
class Flown:
    """One flight: outcome, errors in metres (RMS and worst; RMS and worst of the route), least clearance, share of time
    outside of the corridor and of the region of that time, ticks off the own plan, largest slack.
    """

    condition: str
    seed: int
    outcome: str
    rms_m: float
    worst_m: float
    route_rms_m: float
    route_worst_m: float
    clearance_m: float
    off_corridor: float
    off_region: float
    fallback_ticks: int
    slack_m: float


def fly_all(
    config_path: Path,
    conditions: Mapping[str, Mapping[str, Any]],
    seeds: Sequence[int],
    overrides: Mapping[str, Any],
    work: Path,
    planners: Mapping[str, Planner] | None = None,
    scene: Callable[[int], Mapping[str, Any]] | None = None,
) -> Iterator[Flown]:
    """Fly every condition with every seed, one by one as they are asked for; logs are overwritten in the directory `work`.

    `planners` has the conditions whose plan is not what the configuration asks for; `scene` gives a seed's own world.
    """
    for condition, changes in conditions.items():
        for seed in seeds:
            own = scene(seed) if scene else {}
            config = load_config(
                config_path,
                {
                    "link.uri": "udpin://127.0.0.1:0",
                    "zenoh.enabled": False,
                    **own,
                    **overrides,
                    **changes,
                    "seed": seed,
                },
            )
            with Progress() as progress:
                result = run(config, config_path, work, progress, False, planner=(planners or {}).get(condition))
            yield measure(condition, seed, result.summary, RunLog.read(work / "run.mcap"))


def measure(condition: str, seed: int, summary: Mapping[str, Any], log: RunLog) -> Flown:
    """The numbers of one flight."""
    at_s, error = tracking_error(log)
    aloft_m = log.control.reference_m[:, 2]
    route = error[np.interp(at_s, log.control.t_s, aloft_m) > aloft_m.max() - 0.01] if error.size else error
    own, union = _outside(log)
    flight, assurance = summary["flight"], summary["assurance"]
    return Flown(
        condition, seed, summary["outcome"], _rms(error), _worst(error), _rms(route), _worst(route),
        float(flight["min_clearance_m"] if flight["min_clearance_m"] is not None else np.inf),
        union, own, assurance["shifted"] + assurance["brake"], float(summary["mpc"]["max_slack_m"] or 0.0),
    )  # fmt: skip


def _outside(log: RunLog) -> tuple[float, float]:
    """Shares of true places outside of the region of their time, and outside of every region; NaN without any."""
    corridor, truth, control = whole_corridor(log), log.truth, log.control
    on = within(truth.t_s, active_spans(log))
    if corridor is None or not on.any() or not control.t_s.size:
        return float("nan"), float("nan")
    places, times = truth.r_m[on], truth.t_s[on]
    middles, between = (places[1:] + places[:-1]) / 2, (times[1:] + times[:-1]) / 2
    places, times = np.concatenate([places, middles]), np.concatenate([times, between])
    region = control.region[np.clip(np.searchsorted(control.t_s, times, side="right") - 1, 0, None)]
    own = outside_m(corridor, places, region) > REGION_TOLERANCE_M
    union = own.copy()
    for m in range(len(corridor.Gamma)):
        left = np.flatnonzero(union)
        union[left] = outside_m(corridor, places[left], np.full(len(left), m)) > REGION_TOLERANCE_M
    return float(own.mean()), float(union.mean())


def table(flights: Sequence[Flown]) -> str:
    """One line a condition: errors over all its seeds, RMS of the whole and of the route also as ratio to the first's."""
    lines = [
        f"{'condition':32s} {'landed':>8s} {'RMS m':>7s} {'worst':>7s} {'ratio':>6s} {'route RMS':>9s} {'worst':>7s} {'ratio':>6s} "
        f"{'clearance':>9s} {'off corridor':>12s} {'off region':>10s} {'fallback':>8s} {'slack m':>8s}"
    ]
    first: tuple[float, float] | None = None
    for condition in dict.fromkeys(f.condition for f in flights):
        group = [f for f in flights if f.condition == condition]
        rms, route_rms = _rms(np.array([f.rms_m for f in group])), _rms(np.array([f.route_rms_m for f in group]))
        first = first or (rms, route_rms)
        landed = f"{sum(f.outcome == 'landed' for f in group)}/{len(group)}"
        lines.append(
            f"{condition:32s} {landed:>8s} {rms:7.3f} {max(f.worst_m for f in group):7.3f} {rms / first[0]:6.2f} "
            f"{route_rms:9.3f} {max(f.route_worst_m for f in group):7.3f} {route_rms / first[1]:6.2f} "
            f"{min(f.clearance_m for f in group):9.3f} {max(f.off_corridor for f in group):12.2%} "
            f"{max(f.off_region for f in group):10.2%} {sum(f.fallback_ticks for f in group):8d} "
            f"{max(f.slack_m for f in group):8.3f}"
        )
    return "\n".join(lines)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _worst(values: Array) -> float:
    return float(values.max()) if values.size else float("nan")
