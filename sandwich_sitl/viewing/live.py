"""The live view: a process of its own that shows a running flight from its debug streams.

`live_command` gives the command line that the launcher starts; `main` is that process. It subscribes to the run's
Zenoh streams, never writes to them, and ends when the flight's process ends. Callbacks only queue; when drawing falls
behind, the oldest samples go.
"""

import argparse
import json
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import ZenohConfig
from sandwich_sitl.errors import InputError, LinkError, SandwichError
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.messages import plan_update_of, reported_obstacle_of
from sandwich_sitl.recording.plan_file import plan_from_bytes
from sandwich_sitl.recording.records import PlanUpdate, ReportedObstacle
from sandwich_sitl.recording.scene import UNKNOWN_HEIGHT_FACTOR
from sandwich_sitl.recording.streams import session_config
from sandwich_sitl.recording.topics import MESSAGE_KINDS, PLAN_TOPIC, stream_key
from sandwich_sitl.viewing.entities import APPLICATION, EntityLog, log_plan, log_styles
from sandwich_sitl.viewing.layout import layout
from sandwich_sitl.viewing.planning_space import PlanningSpace
from sandwich_sitl.viewing.replay import DEFAULT_RADIUS_M, viewer_command

Array = NDArray[np.float64]

QUEUE_SAMPLES = 4000
POLL_S = 0.05
START_TIMEOUT_S = 60.0
_NO_VIEWER = "the Rerun viewer did not start; without a screen fly without --live and use `replay --save`"
VIEWER_TIMEOUT_S = 20.0
SHOWN_TOPICS = (
    PLAN_TOPIC,
    "/state/estimate",
    "/control/telemetry",
    "/plan/horizon",
    "/plan/update",
    "/obstacles",
    "/mission/state",
    "/log",
)


def live_command(config: ZenohConfig, save: Path | None = None) -> list[str]:
    """Command line of a live view of the run whose streams `config` describes; with `save`, into an .rrd file instead."""
    endpoints = [*config.listen, *config.connect]
    if not config.enabled or not endpoints:
        raise InputError("zenoh: the live view needs the debug streams; set zenoh.enabled and one of listen, connect")
    command = [sys.executable, "-m", __name__, "--vehicle", config.vehicle_name, "--endpoints", json.dumps(endpoints)]
    return command if save is None else [*command, "--save", str(save)]


class LiveEntities:
    """Turns stream samples into entities, one message at a time."""

    def __init__(self, entities: EntityLog) -> None:
        self._entities = entities
        self._plan: FlightPlan | None = None
        self._planning_space: PlanningSpace | None = None
        self._region = -1
        self._rings_m: list[Array] = []  # regions by number
        self._routes = 0
        log_styles(entities, DEFAULT_RADIUS_M)

    def show(self, topic: str, encoding: str, payload: bytes) -> None:
        """Log one sample under its own time stamp."""
        if topic == PLAN_TOPIC:
            self._plan = plan_from_bytes(payload, "the plan on the debug streams")
            self._planning_space = PlanningSpace(self._plan.channel_map)
            self._rings_m = list(self._plan.corridor.polygons_m)
            log_plan(self._entities, self._plan)
            return
        message = MESSAGE_KINDS[encoding.rpartition(";")[2]].FromString(payload)
        t_ns = message.timestamp.ToNanoseconds()
        t_s = np.array([t_ns / 1e9])
        match topic:
            case "/state/estimate":
                self._pose(t_s, message.pose)
            case "/control/telemetry":
                self._control(t_s, message)
            case "/plan/horizon":
                points = [(pose.position.x, pose.position.y, pose.position.z) for pose in message.poses]
                self._entities.horizon(t_s, [np.array(points)])
            case "/plan/update":
                self._new_plan(plan_update_of(t_ns, message))
            case "/obstacles":
                self._obstacle(reported_obstacle_of(t_ns, message))
            case "/mission/state":
                self._entities.states("/mission/state", t_s, [message.state])
                self._entities.states("/mission/autopilot", t_s, [message.autopilot_mode])
                self._entities.states("/mission/armed", t_s, ["armed" if message.armed else "disarmed"])
            case "/log":
                level = message.Level.Name(message.level).lower()
                self._entities.lines_of_text(t_s, [f"[{message.name}] {message.message}"], [level])

    def _new_plan(self, update: PlanUpdate) -> None:
        self._rings_m[update.first_region :] = update.corridor.polygons_m
        self._routes += 1
        self._entities.new_route(update.t_s, self._routes, update.reference.xyz_m)

    def _obstacle(self, seen: ReportedObstacle) -> None:
        if seen.source == "sensor":
            self._entities.sighting(seen.t_s, seen.name, seen.ring_m)
        elif self._plan is not None:
            height_m = seen.height_m or UNKNOWN_HEIGHT_FACTOR * self._plan.altitude_m
            self._entities.obstacle(seen.t_s, seen.name, seen.ring_m, height_m)

    def _pose(self, t_s: Any, pose: Any) -> None:
        position, q = pose.position, pose.orientation
        r_m = np.array([[position.x, position.y, position.z]])
        self._entities.vehicle(t_s, r_m, np.array([[q.w, q.x, q.y, q.z]]))
        if self._planning_space is not None:
            self._entities.vehicle_in_planning_space(t_s, self._planning_space.locate(r_m[:, :2]))

    def _control(self, t_s: Any, message: Any) -> None:
        error = np.hypot(message.estimate_r_x_m - message.reference_x_m, message.estimate_r_y_m - message.reference_y_m)
        self._entities.scalars("/series/error_m", t_s, np.array([error]))
        if np.isfinite(message.clearance_m):
            self._entities.scalars("/series/clearance_m", t_s, np.array([message.clearance_m]))
        for name in "xyz":
            self._entities.scalars(f"/series/snap/{name}", t_s, np.array([getattr(message, f"snap_{name}_mps4")]))
        if self._plan is not None and message.region != self._region and 0 <= message.region < len(self._rings_m):
            self._region = message.region
            ring = self._rings_m[self._region]
            z_m = self._plan.corridor.z_m[self._region : self._region + 1]
            self._entities.region(t_s, [ring], self._plan.altitude_m, z_m)


def watch(
    endpoints: Sequence[str],
    vehicle_name: str,
    entities: EntityLog,
    *,
    start_timeout_s: float,
    shown: Callable[[], bool] = lambda: True,
) -> None:
    """Show the flight until its process ends, or until nothing is `shown` any more.

    Raises `LinkError` when no flight has appeared after `start_timeout_s`.
    """
    import zenoh
    import zenoh.ext

    alive: dict[str, bool] = {}
    samples: deque[tuple[str, str, bytes]] = deque(maxlen=QUEUE_SAMPLES)

    def on_token(sample: Any) -> None:
        alive[str(sample.key_expr)] = sample.kind == zenoh.SampleKind.PUT

    config = ZenohConfig(listen=(), connect=tuple(endpoints), vehicle_name=vehicle_name)
    live = LiveEntities(entities)
    with zenoh.open(session_config(config)) as session:
        held = [_subscribe(session, vehicle_name, topic, samples) for topic in SHOWN_TOPICS]
        held.append(session.liveliness().declare_subscriber(f"sitl/{vehicle_name}/alive/*", on_token, history=True))
        deadline_s = time.monotonic() + start_timeout_s
        while shown() and (any(alive.values()) or (not alive and time.monotonic() < deadline_s) or samples):
            while samples:
                live.show(*samples.popleft())
            time.sleep(POLL_S)
    if not alive and shown():
        raise LinkError(f"no flight of '{vehicle_name}' on {', '.join(endpoints)} within {start_timeout_s:g} s")


def _subscribe(session: Any, vehicle_name: str, topic: str, samples: deque[tuple[str, str, bytes]]) -> Any:
    """Queue a topic's samples, beginning with the last one where the publisher keeps it."""
    import zenoh.ext

    def on_sample(sample: Any) -> None:
        samples.append((topic, str(sample.encoding), sample.payload.to_bytes()))

    history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
    return zenoh.ext.declare_advanced_subscriber(session, stream_key(vehicle_name, topic), on_sample, history=history)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry of the live view's process; returns the exit status."""
    import rerun as rr

    parser = argparse.ArgumentParser(description="Live view of a running flight, from its Zenoh debug streams.")
    parser.add_argument("--vehicle", required=True)
    parser.add_argument("--endpoints", required=True, type=json.loads)
    parser.add_argument("--save", type=Path)
    options = parser.parse_args(arguments)
    recording = rr.RecordingStream(APPLICATION)
    viewer = None
    try:
        if options.save is None:
            viewer = _start_viewer(recording)
        else:
            recording.save(options.save, default_blueprint=layout())
        watch(
            options.endpoints,
            options.vehicle,
            EntityLog(recording),
            start_timeout_s=START_TIMEOUT_S,
            shown=lambda: viewer is None or viewer.poll() is None,
        )
        if viewer is not None and viewer.poll():
            raise SandwichError(_NO_VIEWER)
        recording.flush(timeout_sec=5.0)
    except SandwichError as error:
        print(f"live view: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        return 0
    finally:
        recording.disconnect()
    return 0 if viewer is None else viewer.wait()


def _start_viewer(recording: Any) -> subprocess.Popen[bytes]:
    """A viewer on a free loopback port, and `recording` streaming to it; it stays open after the flight."""
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    viewer = subprocess.Popen([*viewer_command(str(port)), "--expect-data-soon"])
    deadline_s = time.monotonic() + VIEWER_TIMEOUT_S
    while viewer.poll() is None and time.monotonic() < deadline_s:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                recording.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy", default_blueprint=layout())
                return viewer
        time.sleep(POLL_S)
    viewer.kill()
    raise SandwichError(_NO_VIEWER)


if __name__ == "__main__":
    raise SystemExit(main())
