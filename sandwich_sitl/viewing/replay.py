"""`replay`: a run's log as a Rerun recording with its blueprint embedded.

Input: `run.mcap` (or one process's own log, which shows less). The whole log is converted by columns, in a second or
two.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.errors import InputError, SandwichError
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.prisms import Prisms
from sandwich_sitl.recording.detours import appeared
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.regions import whole_corridor
from sandwich_sitl.recording.scene import UNKNOWN_HEIGHT_FACTOR
from sandwich_sitl.recording.summary import tracking_error
from sandwich_sitl.recording.tracks import PoseTrack
from sandwich_sitl.viewing.entities import APPLICATION, EntityLog, log_flown_path, log_plan, log_styles
from sandwich_sitl.viewing.layout import layout
from sandwich_sitl.viewing.planning_space import PlanningSpace

Array = NDArray[np.float64]

DEFAULT_RADIUS_M = 0.4


def replay(path: Path, save: Path | None = None) -> None:
    """Show the run at `path`, or write it to `save` (.rrd) instead.

    Raises `InputError` when the log cannot be read or `save` cannot be written, `SandwichError` when the viewer fails.
    """
    log = RunLog.read(path)
    if log.notice is not None:
        print(log.notice, file=sys.stderr)
    if save is not None:
        write_recording(log, save)
        return
    with tempfile.TemporaryDirectory(prefix="sandwich-replay-") as directory:
        recording = Path(directory) / f"{path.stem}.rrd"
        write_recording(log, recording)
        status = subprocess.run([*viewer_command(), str(recording)], check=False).returncode
    if status != 0:
        raise SandwichError(
            f"the Rerun viewer ended with status {status}; without a screen use `replay --save FILE.rrd`"
        )


def viewer_command(port: str = "auto") -> list[str]:
    """The viewer's command line; it listens on loopback only."""
    return [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", port]


def write_recording(log: RunLog, path: Path) -> None:
    """Convert a log to an `.rrd` file. Raises `InputError` when `path` cannot be written."""
    import rerun as rr

    if not path.parent.is_dir():
        raise InputError(f"{path}: its directory does not exist; create it first")
    try:
        path.open("ab").close()
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); give another file") from error
    run_id = log.metadata.get("run", {}).get("run_id", log.path.stem)
    recording = rr.RecordingStream(APPLICATION, recording_id=run_id)
    recording.save(path, default_blueprint=layout())
    log_run(EntityLog(recording), log)
    recording.flush(timeout_sec=30.0)
    recording.disconnect()


def log_run(entities: EntityLog, log: RunLog) -> None:
    """Everything of the log that has a picture."""
    plan = log.plan
    log_styles(entities, plan.vehicle_radius_m if plan else DEFAULT_RADIUS_M)
    if plan is not None:
        log_plan(entities, plan)
    _log_vehicle(entities, log.truth if log.truth.t_s.size else log.estimate, plan)
    _log_control(entities, log)
    _log_detours(entities, log)
    entities.horizon(np.array([t_s for t_s, _ in log.horizon]), [strip for _, strip in log.horizon])
    _log_series(entities, log)
    _log_mission(entities, log)


def _log_vehicle(entities: EntityLog, track: PoseTrack, plan: FlightPlan | None) -> None:
    if track.t_s.size == 0:
        return
    entities.vehicle(track.t_s, track.r_m, track.q_wxyz)
    phi_psi = None if plan is None else PlanningSpace(plan.channel_map).locate(track.r_m[:, :2])
    if phi_psi is not None:
        entities.vehicle_in_planning_space(track.t_s, phi_psi)
    log_flown_path(entities, track.r_m, phi_psi)


def _log_control(entities: EntityLog, log: RunLog) -> None:
    control, plan, corridor = log.control, log.plan, whole_corridor(log)
    if plan is None or corridor is None or control.t_s.size == 0:
        return
    changed = np.flatnonzero(np.diff(control.region, prepend=-1) != 0)
    changed = changed[control.region[changed] >= 0]
    rings = [corridor.polygons_m[region] for region in control.region[changed]]
    z_m = corridor.z_m[control.region[changed]] if len(corridor.z_m) else corridor.z_m
    entities.region(control.t_s[changed], rings, plan.altitude_m, z_m)


def _log_detours(entities: EntityLog, log: RunLog) -> None:
    """Obstacles that the map did not show, from when they were there; routes from when they were flown."""
    if log.plan is None:
        return
    height_m = UNKNOWN_HEIGHT_FACTOR * log.plan.altitude_m
    for obstacle in appeared(log):
        ring = shapely.get_coordinates(obstacle.polygon.exterior)[:-1]
        entities.obstacle(obstacle.t_s, obstacle.name, ring, height_m)
    for seen in log.reported:
        if seen.source == "sensor":
            entities.sighting(seen.t_s, seen.name, seen.ring_m)
    for number, update in enumerate(log.updates, start=1):
        entities.new_route(update.t_s, number, update.reference.xyz_m)


def _log_series(entities: EntityLog, log: RunLog) -> None:
    control, timings = log.control, log.timings
    entities.scalars("/series/error_m", *tracking_error(log))
    entities.scalars("/series/clearance_m", *_clearance(log))
    for axis, name in enumerate("xyz"):
        entities.scalars(f"/series/snap/{name}", control.t_s, control.snap_mps4[:, axis])
    entities.scalars("/series/slack_m", control.t_s, control.slack_m)
    entities.scalars("/series/wall_ms/solve", timings.t_s, timings.solve_s * 1e3)
    entities.scalars("/series/wall_ms/loop", timings.t_s, timings.loop_s * 1e3)


def _clearance(log: RunLog) -> tuple[Array, Array]:
    """Distance of the true position to the obstacles, or the estimate's where there is no truth."""
    if log.plan is None or log.truth.t_s.size == 0:
        known = np.isfinite(log.control.clearance_m)
        return log.control.t_s[known], log.control.clearance_m[known]
    if not log.plan.obstacles_m:
        return np.empty(0), np.empty(0)
    obstacles = Prisms(log.plan.obstacles_m, log.plan.blocking_heights_m)
    return log.truth.t_s, obstacles.distance_m(log.truth.r_m)


def _log_mission(entities: EntityLog, log: RunLog) -> None:
    mission = log.mission
    entities.states("/mission/state", mission.t_s, mission.state)
    entities.states("/mission/autopilot", mission.t_s, mission.autopilot_mode)
    entities.states("/mission/armed", mission.t_s, ["armed" if armed else "disarmed" for armed in mission.armed])
    texts = [f"[{line.name}] {line.message}" for line in log.lines]
    entities.lines_of_text(np.array([line.t_s for line in log.lines]), texts, [line.level for line in log.lines])
