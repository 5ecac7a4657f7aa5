"""The live view follows a run through its debug streams and ends with it."""

import os
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import rerun.chunk
import run_samples

from sandwich_sitl.config import ZenohConfig
from sandwich_sitl.errors import InputError, LinkError
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import MissionRecord
from sandwich_sitl.recording.streams import DebugStreams
from sandwich_sitl.viewing.entities import EntityLog
from sandwich_sitl.viewing.live import live_command, watch

TICKS = 40


def free_config() -> ZenohConfig:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return ZenohConfig(listen=(f"tcp/127.0.0.1:{probe.getsockname()[1]}",))


def test_a_live_view_that_joins_late_shows_plan_and_flight(tmp_path: Path) -> None:
    config = free_config()
    target = tmp_path / "live.rrd"
    with DebugStreams.open(config, process="offboard") as streams:
        with RunRecorder(tmp_path / "o.mcap", flush_s=0.25, metadata={}, streams=streams) as recorder:
            recorder.plan(0.0, run_samples.small_plan())
            recorder.mission(0.0, MissionRecord("ACTIVE", "OFFBOARD", armed=True, landed=False))
            environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
            view = subprocess.Popen(live_command(config, target), env=environment)
            deadline = time.monotonic() + 20.0
            while not target.exists() and time.monotonic() < deadline:
                time.sleep(0.05)
            time.sleep(1.0)
            for tick in range(TICKS):
                recorder.tf_and_estimate(tick * 0.1, run_samples.truth_m(tick * 0.1), run_samples.IDENTITY)
                recorder.control(run_samples.control_record(tick * 0.1, tick))
                time.sleep(0.01)
        time.sleep(0.5)
    assert view.wait(20) == 0
    chunks: dict[str, int] = {}
    positions = []
    for chunk in rerun.chunk.RrdReader(target).stream():
        batch = chunk.to_record_batch()
        chunks[str(chunk.entity_path)] = chunks.get(str(chunk.entity_path), 0) + batch.num_rows
        if str(chunk.entity_path) == "/world/vehicle":
            names = [name for name in batch.schema.names if name.endswith(":translation")]
            positions += [row[0] for name in names for row in batch.column(name).to_pylist()]
    for entity in (
        "/world/obstacles/diamond",
        "/planning/barred",
        "/planning/vehicle",
        "/mission/state",
        "/world/region",
    ):
        assert chunks.get(entity, 0) >= 1, entity
    expected = [run_samples.truth_m(tick * 0.1) for tick in range(TICKS)]
    np.testing.assert_allclose(sorted(positions), sorted(expected), atol=1e-5)


def test_no_flight_is_an_error_with_a_deadline() -> None:
    config = free_config()
    with pytest.raises(LinkError, match="no flight of 'uav1'"):
        watch(config.listen, "uav1", EntityLog(rerun.RecordingStream("none")), start_timeout_s=0.2)


def test_without_streams_there_is_no_live_view() -> None:
    with pytest.raises(InputError, match=r"zenoh\.enabled"):
        live_command(ZenohConfig(enabled=False))
