"""How far down its ladder a flight came (`control.assurance`), and why the mission braked, read from its log alone.

The upper two rungs, and the tick that finds no more plan, are the controller's; from the next tick on the mission
brakes and holds, and its states tell. A mission that is asked to stop brakes along the plan in force.
"""

import json
from collections import Counter
from typing import Any

import numpy as np

from sandwich_sitl.config import MissionConfig
from sandwich_sitl.control.assurance import Fault, Rung
from sandwich_sitl.mission.orders import State
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.spans import state_spans, within

Section = dict[str, Any]

_REFUSED = "set-point not sent"
_SHORTLY_S = 1.0  # before braking; a fence that refuses is borne for less


def assurance_section(log: RunLog) -> Section:
    """Ticks on each rung, also of a mission that was asked to brake, how often a plan was refused and how often accepted
    again, faults in ticks, and why the mission braked, None when it did not.
    """
    asked = np.array([fault == Fault.STOP for fault in log.control.fault], dtype=np.bool_)
    rung = log.control.rung[~asked]  # a stop that the mission asked for is its braking, and no fallback
    before = np.concatenate([[0], rung[:-1]])  # a flight that begins without a plan has fallen back too
    fell = int(np.count_nonzero((rung > 0) & (before == 0))) if rung.size else 0
    rose = int(np.count_nonzero((rung == 0) & (before > 0))) if rung.size else 0
    return {
        "plan": int(np.count_nonzero(rung == Rung.PLAN)),
        "shifted": int(np.count_nonzero(rung == Rung.SHIFTED)),
        "brake": int(np.count_nonzero(rung == Rung.BRAKE)) + _ticks_in(log, State.BRAKE),
        "hold": _ticks_in(log, State.HOLD),
        "fallbacks": fell,
        "recoveries": rose,
        "faults": dict(sorted(Counter(fault for fault in log.control.fault if fault and fault != Fault.STOP).items())),
        "braked_for": _cause(log),
    }


def _ticks_in(log: RunLog, state: State) -> int:
    return int(np.count_nonzero(within(log.timings.t_s, state_spans(log, state))))


def _cause(log: RunLog) -> str | None:
    """What the last ticks before braking show; when they were in order, what the mission says."""
    braking = state_spans(log, State.BRAKE)
    if not braking:
        return None
    begun_s = braking[0][0]
    last = int(np.searchsorted(log.control.t_s, begun_s, side="right")) - 1
    if last >= 0 and log.control.rung[last] == Rung.BRAKE:
        return log.control.fault[last]
    refused = [line for line in log.lines if line.message.startswith(_REFUSED)]
    if refused and begun_s - _SHORTLY_S <= refused[-1].t_s <= begun_s:
        return refused[-1].message
    if last >= 0:
        off_m = float(np.linalg.norm(log.control.estimate_r_m[last] - log.control.reference_m[last]))
        if off_m > _lost_track_m(log):
            return f"the vehicle was {off_m:.2f} m off its reference"
    return str(log.metadata.get("result", {}).get("reason", "")) or "unknown"


def _lost_track_m(log: RunLog) -> float:
    mission = json.loads(log.metadata.get("run", {}).get("config", "{}")).get("mission", {})
    return float(mission.get("lost_track_m", MissionConfig().lost_track_m))
