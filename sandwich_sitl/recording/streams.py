"""`DebugStreams`: the log's payloads over Zenoh, for looking on. They may be lost, never waited for.

State: one Zenoh session in peer mode, without multicast or gossip scouting, listening and connecting only where
`ZenohConfig` says. Congestion control is DROP, so a stalled subscriber costs data and not time. A session that cannot
be opened (no library, occupied port, bad end point) leaves an object whose `put` does nothing and whose `problem`
says why.

One key is listened to: `topics.obstacle_key`, on which anybody may report an obstacle (`mission.reports`).

Keys: `topics.stream_key`; liveliness token `sitl/{vehicle}/alive/{process}`; queryable `sitl/{vehicle}/params` (JSON).
"""

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from sandwich_sitl.config import ZenohConfig
from sandwich_sitl.recording.topics import (
    LATCHED_TOPICS,
    MAVLINK_TOPICS,
    PLAN_TOPIC,
    PROTOBUF_TOPICS,
    obstacle_key,
    stream_encoding,
    stream_key,
)

_REPORTS_KEPT = 256


@dataclass(frozen=True)
class Heard:
    """A payload and when it came, `time.monotonic()`."""

    wall_s: float
    payload: bytes


class DebugStreams:
    """Best-effort publisher of every topic. Use `open`; close it after the recorder."""

    def __init__(
        self,
        session: Any | None,
        publishers: dict[str, Any],
        held: tuple[Any, ...],
        problem: str | None,
        vehicle_name: str = "",
    ) -> None:
        self._session = session
        self._vehicle_name = vehicle_name
        self._publishers = publishers
        self._held = held  # tokens and queryables live as long as they are referenced
        self.problem = problem

    @classmethod
    def open(cls, config: ZenohConfig, *, process: str, params_json: str = "{}") -> Self:
        """Open the session; `params_json`, the run's configuration, answers the `params` queryable. Never raises."""
        if not config.enabled:
            return cls(None, {}, (), None)
        try:
            import zenoh
        except ImportError as error:
            return cls._closed(f"debug streams are off: {error}")
        try:
            session = zenoh.open(session_config(config))
        except zenoh.ZError as error:
            return cls._closed(f"debug streams are off: {_first_words(error)}")
        try:
            presence = _presence(session, config, process, params_json)
            return cls(session, _publishers(session, config), presence, None, config.vehicle_name)
        except zenoh.ZError as error:
            session.close()  # type: ignore[no-untyped-call]
            return cls._closed(f"debug streams are off: {_first_words(error)}")

    @classmethod
    def _closed(cls, problem: str) -> Self:
        return cls(None, {}, (), problem)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def active(self) -> bool:
        """True while payloads are published."""
        return bool(self._publishers)

    def put(self, topic: str, payload: bytes) -> None:
        """Publish one payload, or drop it."""
        publisher = self._publishers.get(topic)
        if publisher is not None:
            publisher.put(payload)

    def obstacle_reports(self) -> Callable[[], list[Heard]]:
        """Listen for reports of obstacles; the function hands out what has come since its last call. Empty when closed."""
        heard: deque[Heard] = deque(maxlen=_REPORTS_KEPT)
        if self._session is not None:
            key = obstacle_key(self._vehicle_name)
            on_sample = lambda sample: heard.append(Heard(time.monotonic(), sample.payload.to_bytes()))  # noqa: E731
            self._held = (*self._held, self._session.declare_subscriber(key, on_sample))

        def taken() -> list[Heard]:
            return [heard.popleft() for _ in range(len(heard))]

        return taken

    def close(self) -> None:
        """Close the session; a second call does nothing."""
        self._publishers, self._held = {}, ()
        if self._session is not None:
            session, self._session = self._session, None
            session.close()


def _first_words(error: Exception) -> str:
    """What went wrong, without the source positions that Zenoh appends."""
    return " ".join(str(error).split()).split(" at /")[0]


def session_config(config: ZenohConfig, *, listen: bool = True) -> Any:
    """Zenoh's configuration: peer, no scouting, explicit end points, no wait before a drop."""
    import zenoh

    settings = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
        "listen/endpoints": list(config.listen) if listen else [],
        "connect/endpoints": list(config.connect),
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": False,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 0,
    }
    session = zenoh.Config()
    for key, value in settings.items():
        session.insert_json5(key, json.dumps(value))
    return session


def _publishers(session: Any, config: ZenohConfig) -> dict[str, Any]:
    import zenoh
    import zenoh.ext

    publishers: dict[str, Any] = {}
    for topic in (*PROTOBUF_TOPICS, *MAVLINK_TOPICS, PLAN_TOPIC):
        key = stream_key(config.vehicle_name, topic)
        options: dict[str, Any] = {
            "encoding": stream_encoding(topic),
            "congestion_control": zenoh.CongestionControl.DROP,
        }
        if topic in LATCHED_TOPICS:
            cache = zenoh.ext.CacheConfig(1)
            publishers[topic] = zenoh.ext.declare_advanced_publisher(
                session, key, cache=cache, publisher_detection=True, **options
            )
        else:
            publishers[topic] = session.declare_publisher(key, **options)
    return publishers


def _presence(session: Any, config: ZenohConfig, process: str, params_json: str) -> tuple[Any, ...]:
    key = f"sitl/{config.vehicle_name}/params"
    token = session.liveliness().declare_token(f"sitl/{config.vehicle_name}/alive/{process}")
    params = session.declare_queryable(key, lambda query: query.reply(key, params_json, encoding="application/json"))
    return token, params
