"""GPS lost in flight, over real UDP: the vehicle's own account of its accuracy stops the flight before its failsafe does."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sandwich_sitl.control.assurance import Fault
from sandwich_sitl.recording.reader import RunLog

from .conftest import Process

Start = Callable[..., Process]
LOST_S = 17.0
UNCERTAIN = str(Fault.UNCERTAIN)


def flown(start: Start, config: Path, out: Path, back_s: float | None, *changes: str) -> tuple[RunLog, Any, int]:
    """Log, summary and exit status of a flight by GPS, which is lost at `LOST_S`."""
    failures: list[dict[str, object]] = [{"at_s": LOST_S, "part": "gps"}]
    if back_s is not None:
        failures.append({"at_s": back_s, "part": "gps", "ok": True})
    words = ["vehicle.sensors.estimator=filter", f"vehicle.failures={json.dumps(failures)}", *changes]
    sets = [part for word in words for part in ("--set", word)]
    process = start("sandwich_sitl.cli", "run", str(config), "--out", str(out), *sets)
    status = process.finish(90)
    return RunLog.read(out / "run.mcap"), json.loads((out / "summary.json").read_text()), status


def test_gps_lost_in_flight_stops_the_vehicle_lands_it_and_says_why(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    log, summary, status = flown(start, short_config, tmp_path, None)
    assert (summary["outcome"], status) == ("held", 6), summary["reason"]
    assert "no longer knows its position" in summary["reason"]
    assert "allowed are 0.45 m (assurance.position_std_m)" in summary["reason"]
    states = list(dict.fromkeys(log.mission.state))
    assert states[states.index("ACTIVE") :] == ["ACTIVE", "BRAKE", "HOLD", "LAND", "DONE"]
    assert not log.mission.armed[-1]
    when = dict(zip(log.mission.state, log.mission.t_s, strict=True))
    assert when["LAND"] - when["HOLD"] == pytest.approx(0.02, abs=1e-6)
    assert when["LAND"] < LOST_S + 5.0  # before the autopilot's own failsafe
    uncertain = np.array([fault == UNCERTAIN for fault in log.control.fault])
    assert LOST_S < log.control.t_s[uncertain][0] < LOST_S + 3.0
    speed = np.linalg.norm(log.control.setpoint_v_mps, axis=1)
    assert speed[~uncertain][-1] > 2.0
    assert speed[-1] < 1e-6
    assurance = summary["assurance"]
    assert (assurance["faults"], assurance["braked_for"]) == ({UNCERTAIN: int(uncertain.sum())}, UNCERTAIN)
    said = [line.message for line in log.lines]
    assert any(line.startswith("vehicle: it knows its position to 0.4") for line in said)
    assert any(line.startswith(f"assurance: {UNCERTAIN}; slowing down") for line in said)
    assert any("Disarmed by landing" in line for line in said)
    assert summary["flight"]["min_clearance_m"] > 0.4


@pytest.mark.slow
def test_gps_that_returns_before_the_vehicle_has_stopped_is_flown_by_again(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    log, summary, status = flown(start, short_config, tmp_path, LOST_S + 2.2)
    assert (summary["outcome"], status) == ("landed", 0), summary["reason"]
    assurance = summary["assurance"]
    assert set(assurance["faults"]) == {UNCERTAIN}
    assert (assurance["fallbacks"], assurance["recoveries"], assurance["brake"]) == (1, 1, 0)
    assert log.control.reference_rate.min() < 0.9


@pytest.mark.slow
def test_a_vehicle_that_is_not_allowed_to_be_as_uncertain_as_it_is_does_not_arm(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    few = ("assurance.position_std_m=0.3", "mission.ready_timeout_s=8")
    log, summary, status = flown(start, short_config, tmp_path, None, *few)
    assert (summary["outcome"], status) == ("refused", 6)
    assert "it knows its position to 0.4" in summary["reason"]
    assert not any(log.mission.armed)
