"""What is recorded is what is read back; other MCAP and protobuf readers agree; a cut or killed file loses only its tail."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import run_samples
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording import reader as reading
from sandwich_sitl.recording.container import RawLog, intact_bytes, read_raw
from sandwich_sitl.recording.messages import VECTOR_FIELDS
from sandwich_sitl.recording.plan_file import plan_bytes
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import MissionRecord

ROOT = Path(__file__).parents[2]


def test_control_values_come_back_exactly(run_log: RunLog) -> None:
    for row, tick in enumerate(range(20, 120)):
        record = run_samples.control_record(tick * 0.1, tick)
        for field in VECTOR_FIELDS:
            assert tuple(getattr(run_log.control, field)[row]) == getattr(record, field), field
        for field in ("slack_m", "clearance_m", "solver_status", "solver_iterations", "region"):
            assert getattr(run_log.control, field)[row] == getattr(record, field), field
    np.testing.assert_allclose(run_log.control.t_s, np.arange(20, 120) * 0.1, atol=1e-9)
    assert set(run_log.control.phase) == {"ACTIVE"}


def test_other_topics_come_back(run_log: RunLog) -> None:
    assert run_log.mission.state == ("CONNECT", "REQUEST", "ACTIVE", "LAND", "DONE")
    assert run_log.mission.armed.tolist() == [False, True, True, True, False]
    assert run_log.mission.reason[3] == "goal reached"
    expected = np.array([run_samples.truth_m(tick * 0.1) for tick in range(151)])
    np.testing.assert_array_equal(run_log.estimate.r_m, expected)
    np.testing.assert_array_equal(run_log.estimate.q_wxyz, np.tile(run_samples.IDENTITY, (151, 1)))
    assert [line.message for line in run_log.lines] == ["planned", "short battery"]
    assert [line.level for line in run_log.lines] == ["info", "warning"]
    assert run_log.frames_of("/mavlink/tx")[7].data == run_samples.mavlink2_frame(7, 245)
    assert len(run_log.horizon) == 100
    np.testing.assert_array_equal(run_log.horizon[0][1][0], run_samples.truth_m(2.0))


def test_metadata_plan_and_timings_come_back(run_log: RunLog) -> None:
    assert run_log.metadata["run"] == {
        "started": "yes", "run_id": "r1", "name": "small", "seed": "7", "clock": "lockstep", "config": '{"a": 1}',
    }  # fmt: skip
    assert run_log.metadata["vehicle"] == {"seed": "7"}
    assert run_log.plan is not None
    assert plan_bytes(run_log.plan) == plan_bytes(run_samples.small_plan())
    assert run_log.plan.seconds == {"channel map": 0.5, "route": 0.25}
    np.testing.assert_array_equal(run_log.timings.tick, np.arange(151))
    np.testing.assert_allclose(run_log.timings.solve_s, 1e-3 * np.arange(1, 152), atol=1e-7)
    np.testing.assert_allclose(run_log.timings.sent_s, 70.0 + 0.1 * np.arange(151), atol=1e-6)
    np.testing.assert_allclose(run_log.timings.t_s, np.arange(151) * 0.1, atol=1e-9)


def test_a_log_from_before_a_column_of_timings_was_written_is_read(
    run_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def older(path: Path) -> RawLog:
        raw = read_raw(path)
        for record in raw.metadata:
            if record.name == "wall_timing":
                del record.metadata["sent_s"]
        return raw

    monkeypatch.setattr(reading, "read_raw", older)
    timings = RunLog.read(run_path).timings
    assert np.isnan(timings.sent_s).all()
    np.testing.assert_allclose(timings.solve_s, 1e-3 * np.arange(1, 152), atol=1e-7)


def test_an_independent_reader_finds_topics_schemas_and_complete_messages(run_path: Path) -> None:
    schemas = {}
    with run_path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            schemas[channel.topic] = schema.name
            assert message.log_time == message.publish_time
        roots = [m for _, _, _, m in reader.iter_decoded_messages(topics=["/tf"])][:2]
        (_, _, _, scene), *_ = reader.iter_decoded_messages(topics=["/scene"])
    foxglove = {
        "/tf": "FrameTransform", "/state/truth": "PoseInFrame", "/state/estimate": "PoseInFrame", "/log": "Log",
        "/plan/path": "PosesInFrame", "/plan/horizon": "PosesInFrame", "/plan/map": "SceneUpdate", "/scene": "SceneUpdate",
    }  # fmt: skip
    own = {"/control/telemetry": "ControlTelemetry", "/mission/state": "MissionState"}
    assert schemas == (
        {topic: f"foxglove.{name}" for topic, name in foxglove.items()}
        | {topic: f"sandwich_sitl.{name}" for topic, name in own.items()}
        | {"/mavlink/tx": "mavlink", "/mavlink/rx": "mavlink"}
    )
    frames = [(transform.parent_frame_id, transform.child_frame_id) for transform in roots]
    assert frames == [("tf#/", "map"), ("map", "base_link")]
    entity = scene.entities[0]
    assert entity.frame_id == "map"
    assert entity.HasField("lifetime")
    assert entity.triangles[0].pose.HasField("position")
    assert len(entity.triangles[0].indices) == 3 * (2 * 4 + 2 * 2)


def test_truncation_at_any_byte_loses_only_the_tail(tmp_path: Path) -> None:
    whole = run_samples.write_offboard(tmp_path / "whole.mcap").read_bytes()
    messages = read_raw(tmp_path / "whole.mcap").messages
    cut = tmp_path / "cut.mcap"
    seen, refused = 0, 0
    for length in [*range(0, 3000, 37), *range(3000, len(whole), 997), *range(len(whole) - 40, len(whole))]:
        cut.write_bytes(whole[:length])
        try:
            raw = read_raw(cut)
        except InputError:
            refused += 1
            assert length < 8
            continue
        assert raw.truncated
        assert raw.messages == messages[: len(raw.messages)]
        assert len(raw.messages) >= seen
        seen = len(raw.messages)
    assert seen == len(messages)
    assert refused == 1


def test_records_reach_to_the_end_of_a_whole_file(run_path: Path) -> None:
    data = run_path.read_bytes()
    assert intact_bytes(data) == len(data)
    assert intact_bytes(data[:-1]) == len(data) - 8


def test_a_damaged_chunk_ends_the_log_there(tmp_path: Path, run_path: Path) -> None:
    data = bytearray(run_path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    raw = read_raw(damaged)
    assert raw.truncated or len(raw.messages) == len(read_raw(run_path).messages)


def test_a_killed_writer_leaves_a_readable_log(tmp_path: Path) -> None:
    program = f"""
        import sys, time
        sys.path[:0] = [{str(ROOT)!r}, {str(ROOT / "tests" / "recording")!r}]
        from pathlib import Path
        import run_samples
        from sandwich_sitl.recording.recorder import RunRecorder
        recorder = RunRecorder(Path({str(tmp_path / "killed.mcap")!r}), flush_s=0.05, metadata={{"name": "killed"}})
        recorder.plan(0.0, run_samples.small_plan())
        for tick in range(100000):
            recorder.control(run_samples.control_record(tick * 0.02, tick))
            if tick == 200:
                print("flying", flush=True)
            time.sleep(0.001)
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"flying\n"
    process.send_signal(signal.SIGKILL)
    process.wait(10)
    process.stdout.close()
    log = RunLog.read(tmp_path / "killed.mcap")
    assert log.truncated
    assert log.metadata["run"] == {"name": "killed"}
    assert log.plan is not None
    assert len(log.control.t_s) > 100
    np.testing.assert_allclose(np.diff(log.control.t_s), 0.02, atol=1e-9)


def test_the_first_message_is_on_disk_at_once(tmp_path: Path) -> None:
    with RunRecorder(tmp_path / "a.mcap", flush_s=60.0, metadata={}) as recorder:
        recorder.mission(0.0, MissionRecord("CONNECT", "", armed=False, landed=True))
        assert RunLog.read(tmp_path / "a.mcap").mission.state == ("CONNECT",)


def test_equal_runs_give_equal_digests(tmp_path: Path) -> None:
    digests = []
    for name, flush in (("a", 0.25), ("b", 1e-9)):
        (tmp_path / name).mkdir()
        with RunRecorder(tmp_path / name / "x.mcap", flush_s=flush, metadata={"run_id": name}) as recorder:
            for tick in range(50):
                recorder.control(run_samples.control_record(tick * 0.02, tick))
        digests.append(RunLog.read(tmp_path / name / "x.mcap").digests)
    assert digests[0] == digests[1]


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "is empty"), (b"#!/bin/sh\n", "is not an MCAP file"), (None, "cannot be read")],
    ids=["empty", "text", "missing"],
)
def test_files_that_are_no_log_are_refused(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        RunLog.read(path)


def test_an_mcap_file_of_something_else_is_refused(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "x.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/imu", "json", writer.register_schema("imu", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(InputError, match="not the log of a run"):
        RunLog.read(tmp_path / "x.mcap")


def test_a_full_disk_stops_recording_and_not_the_flight(caplog: pytest.LogCaptureFixture) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    with RunRecorder(full, flush_s=1e-9, metadata={"name": "x"}) as recorder:
        for tick in range(3):
            recorder.control(run_samples.control_record(tick * 0.02, tick))
    assert recorder.problem is not None
    assert [record.message for record in caplog.records] == [recorder.problem]


def test_a_directory_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be created"):
        RunRecorder(tmp_path / "none" / "x.mcap", flush_s=0.25, metadata={})
