"""MAVLink frames as a `.tlog`: big-endian microseconds (64 bit), then the frame, over and over.

MAVExplorer, QGroundControl and pymavlink's `mavlogfile` read it. Times are the vehicle's boot time, as in the log.
"""

import struct
from pathlib import Path

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.topics import MAVLINK_TOPICS

_STAMP = struct.Struct(">Q")


def tlog_bytes(log: RunLog) -> bytes:
    """Frames that the offboard process sent and received, in order of time (the vehicle's own record where it has none)."""
    frames = [frame for frame in log.frames if frame.topic in MAVLINK_TOPICS] or list(log.frames)
    return b"".join(_STAMP.pack(frame.t_ns // 1000) + frame.data for frame in frames)


def write_tlog(log: RunLog, path: Path) -> int:
    """Write the `.tlog`, return its number of bytes. Raises `InputError` when the log holds no frame."""
    data = tlog_bytes(log)
    if not data:
        raise InputError(f"{log.path}: holds no MAVLink frame; give the log of a run that connected")
    path.write_bytes(data)
    return len(data)
