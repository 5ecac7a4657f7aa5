"""The exported `.tlog` is read by pymavlink, message by message and time by time."""

from pathlib import Path

import pytest
import run_samples
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.tlog import write_tlog


def test_mavlogfile_reads_what_was_logged(tmp_path: Path) -> None:
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    with RunRecorder(tmp_path / "o.mcap", flush_s=1.0, metadata={"name": "t"}) as recorder:
        for tick in range(100):
            position = sender.local_position_ned_encode(tick * 20, 1.0 * tick, 2.0, -3.0, 0.1, 0.2, 0.3)
            recorder.mavlink(tick * 0.02, "rx", position.pack(sender))
            recorder.mavlink(tick * 0.02, "tx", sender.heartbeat_encode(6, 8, 0, 0, 4).pack(sender))
    write_tlog(RunLog.read(tmp_path / "o.mcap"), tmp_path / "o.tlog")
    replay = mavutil.mavlogfile(str(tmp_path / "o.tlog"), notimestamps=False)
    kinds, north_m, times_s = [], [], []
    while (message := replay.recv_match()) is not None:
        kinds.append(message.get_type())
        if message.get_type() == "LOCAL_POSITION_NED":
            north_m.append(message.x)
            times_s.append(message._timestamp)
    replay.f.close()
    assert kinds == ["LOCAL_POSITION_NED", "HEARTBEAT"] * 100
    assert north_m == [float(tick) for tick in range(100)]
    assert times_s == pytest.approx([tick * 0.02 for tick in range(100)], abs=1e-6)


def test_a_log_without_frames_is_refused(tmp_path: Path) -> None:
    log = RunLog.read(run_samples.write_vehicle(tmp_path / "v.mcap"))
    with pytest.raises(InputError, match="holds no MAVLink frame"):
        write_tlog(log, tmp_path / "v.tlog")
