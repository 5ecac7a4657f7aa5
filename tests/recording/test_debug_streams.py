"""Debug streams carry the log's own bytes, are never waited for, and may be missing."""

import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import run_samples
import zenoh
import zenoh.ext

from sandwich_sitl.config import ZenohConfig
from sandwich_sitl.recording.container import read_raw
from sandwich_sitl.recording.plan_file import plan_bytes
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import MissionRecord
from sandwich_sitl.recording.streams import DebugStreams, session_config
from sandwich_sitl.recording.topics import PLAN_TOPIC, stream_encoding, stream_key

DEADLINE_S = 10.0


def free_config() -> ZenohConfig:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return ZenohConfig(listen=(f"tcp/127.0.0.1:{probe.getsockname()[1]}",))


def subscriber_to(config: ZenohConfig) -> Any:
    return zenoh.open(session_config(ZenohConfig(listen=(), connect=config.listen)))


def wait_for(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not holds():
        assert time.monotonic() < deadline, "did not happen in time"
        time.sleep(0.01)


@pytest.fixture
def streams() -> Iterator[tuple[ZenohConfig, DebugStreams]]:
    config = free_config()
    with DebugStreams.open(config, process="offboard", params_json='{"seed": 7}') as opened:
        assert opened.problem is None
        yield config, opened


def test_a_subscriber_receives_the_bytes_of_the_log(streams: tuple[ZenohConfig, DebugStreams], tmp_path: Path) -> None:
    config, publisher = streams
    received: dict[str, list[tuple[bytes, str]]] = {}
    lock = threading.Lock()

    def on_sample(sample: zenoh.Sample) -> None:
        with lock:
            received.setdefault(str(sample.key_expr), []).append((sample.payload.to_bytes(), str(sample.encoding)))

    with subscriber_to(config) as session:
        session.declare_subscriber("sitl/uav1/**", on_sample)
        time.sleep(0.3)
        with RunRecorder(tmp_path / "o.mcap", flush_s=0.25, metadata={}, streams=publisher) as recorder:
            recorder.plan(0.0, run_samples.small_plan())
            recorder.mission(0.0, MissionRecord("ACTIVE", "OFFBOARD", armed=True, landed=False))
            for tick in range(20):
                recorder.tf_and_estimate(tick * 0.02, (1.0, 2.0, 3.0), run_samples.IDENTITY)
                recorder.control(run_samples.control_record(tick * 0.02, tick))
                recorder.mavlink(tick * 0.02, "tx", run_samples.mavlink2_frame(tick))
                time.sleep(0.005)
        raw = read_raw(tmp_path / "o.mcap")
        logged: dict[str, list[tuple[bytes, str]]] = {}
        for message in raw.messages:
            topic = raw.channels[message.channel_id].topic
            logged.setdefault(stream_key("uav1", topic), []).append((message.data, stream_encoding(topic)))
        logged[stream_key("uav1", PLAN_TOPIC)] = [(plan_bytes(run_samples.small_plan()), stream_encoding(PLAN_TOPIC))]
        wait_for(lambda: received.keys() == logged.keys())
        time.sleep(0.3)
        for key, samples in received.items():
            rest = iter(logged[key])
            assert all(sample in rest for sample in samples), f"{key}: not the log's bytes in the log's order"
            assert len(samples) >= len(logged[key]) / 2, f"{key}: most samples were dropped"


def test_keys_and_encodings() -> None:
    assert stream_key("uav1", "/control/telemetry") == "sitl/uav1/control/telemetry"
    assert stream_key("uav2", "/mavlink/rx") == "sitl/uav2/mavlink/rx"
    assert stream_key("uav1", "/tf") == "sitl/uav1/offboard/tf"
    assert stream_encoding("/control/telemetry") == "application/protobuf;sandwich_sitl.ControlTelemetry"
    assert stream_encoding("/scene") == "application/protobuf;foxglove.SceneUpdate"


def test_a_late_subscriber_is_given_the_last_map_and_plan(streams: tuple[ZenohConfig, DebugStreams]) -> None:
    config, publisher = streams
    publisher.put("/plan/map", b"old")
    publisher.put("/plan/map", b"new")
    samples: list[bytes] = []
    with subscriber_to(config) as session:
        held = zenoh.ext.declare_advanced_subscriber(
            session,
            stream_key("uav1", "/plan/map"),
            lambda sample: samples.append(sample.payload.to_bytes()),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
        )
        wait_for(lambda: samples == [b"new"])
        held.undeclare()


def test_parameters_answer_and_the_token_tells_of_life_and_death() -> None:
    config = free_config()
    publisher = DebugStreams.open(config, process="offboard", params_json=json.dumps({"seed": 7}))
    changes: list[tuple[str, bool]] = []
    with subscriber_to(config) as session:
        (reply,) = list(session.get("sitl/uav1/params", timeout=DEADLINE_S))
        assert reply.ok is not None
        assert json.loads(reply.ok.payload.to_string()) == {"seed": 7}
        session.liveliness().declare_subscriber(
            "sitl/uav1/alive/*",
            lambda sample: changes.append((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)),
            history=True,
        )
        wait_for(lambda: changes == [("sitl/uav1/alive/offboard", True)])
        publisher.close()
        wait_for(lambda: changes[1:] == [("sitl/uav1/alive/offboard", False)])


def test_an_occupied_port_turns_the_streams_off(streams: tuple[ZenohConfig, DebugStreams]) -> None:
    config, _ = streams
    with DebugStreams.open(config, process="offboard") as second:
        assert not second.active
        assert second.problem is not None
        assert second.problem.startswith("debug streams are off: ")
        assert "/src/" not in second.problem
        second.put("/tf", b"goes nowhere")


@pytest.mark.parametrize("endpoint", ["tcp/no-such-host.invalid:7447", "nonsense", "tcp/127.0.0.1:99999"])
def test_a_bad_end_point_is_a_warning(endpoint: str) -> None:
    with DebugStreams.open(ZenohConfig(listen=(endpoint,)), process="offboard") as streams:
        assert not streams.active
        assert streams.problem is not None


def test_an_absent_peer_is_no_problem() -> None:
    started = time.monotonic()
    with DebugStreams.open(ZenohConfig(listen=(), connect=("tcp/127.0.0.1:9",)), process="offboard") as streams:
        assert streams.active
        streams.put("/tf", b"x")
    assert time.monotonic() - started < 2.0


def test_disabled_streams_do_nothing() -> None:
    streams = DebugStreams.open(ZenohConfig(enabled=False), process="offboard")
    streams.put("/tf", b"x")
    assert not streams.active
    assert streams.problem is None


def test_a_stalled_subscriber_never_blocks(streams: tuple[ZenohConfig, DebugStreams]) -> None:
    """A subscriber that is stopped (SIGSTOP) while 40 MB are published; no single put may take long."""
    config, publisher = streams
    program = f"""
        import sys, time
        sys.path.insert(0, {str(Path(__file__).parents[2])!r})
        import zenoh
        from sandwich_sitl.config import ZenohConfig
        from sandwich_sitl.recording.streams import session_config
        session = zenoh.open(session_config(ZenohConfig(listen=(), connect={config.listen!r})))
        first = []
        held = session.declare_subscriber("sitl/**", lambda sample: first.append(1))
        print("subscribed", flush=True)
        while not first:
            time.sleep(0.01)
        print("receiving", flush=True)
        time.sleep(60)
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"subscribed\n"
        receiving = threading.Thread(target=process.stdout.readline)
        receiving.start()
        while receiving.is_alive():
            publisher.put("/tf", b"x")
            time.sleep(0.01)
        os.kill(process.pid, signal.SIGSTOP)
        slowest_s = 0.0
        for _ in range(4000):
            before = time.thread_time()
            wall = time.monotonic()
            publisher.put("/scene", bytes(10_000))
            slowest_s = max(slowest_s, time.monotonic() - wall)
            assert time.thread_time() - before < 0.5
        assert slowest_s < 3.0  # one that waited for the subscriber would take 5 s
    finally:
        process.kill()
        process.wait(10)
        process.stdout.close()
