"""The records of an MCAP file as they lie there, complete or cut off.

A killed process leaves a file without its end. Records are framed (opcode, length), so everything up to the last
whole frame is kept and the rest is left out; `RawLog.truncated` says so.
"""

import io
import struct
from dataclasses import dataclass
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from sandwich_sitl.errors import InputError

_FRAME = struct.Struct("<BQ")
_DAMAGE = (McapError, ValueError, struct.error, zstandard.ZstdError)


@dataclass(frozen=True)
class RawLog:
    """Records of one file in file order."""

    path: Path
    truncated: bool
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    messages: list[Message]
    metadata: list[Metadata]
    attachments: list[Attachment]


def read_raw(path: Path) -> RawLog:
    """Read every whole record. Raises `InputError` when the file is missing, empty or not MCAP."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of a run.mcap") from error
    if not data:
        raise InputError(f"{path}: is empty; give a run.mcap that a run has written")
    if not data.startswith(MCAP0_MAGIC):
        raise InputError(f"{path}: is not an MCAP file; give a run.mcap that a run has written")
    log = RawLog(path, not data.endswith(MCAP0_MAGIC), {}, {}, [], [], [])
    reader = StreamReader(io.BytesIO(data[: intact_bytes(data)]), validate_crcs=True)
    try:
        for record in reader.records:
            if isinstance(record, Message):
                log.messages.append(record)
            elif isinstance(record, Channel):
                log.channels[record.id] = record
            elif isinstance(record, Schema):
                log.schemas[record.id] = record
            elif isinstance(record, Metadata):
                log.metadata.append(record)
            elif isinstance(record, Attachment):
                log.attachments.append(record)
    except _DAMAGE:
        if not log.truncated:
            return RawLog(**{**vars(log), "truncated": True})
    return log


def intact_bytes(data: bytes) -> int:
    """Length of the longest beginning of `data` that ends with a whole record (or is the whole of a complete file)."""
    position = len(MCAP0_MAGIC)
    while position + _FRAME.size <= len(data):
        _, length = _FRAME.unpack_from(data, position)
        if position + _FRAME.size + length > len(data):
            return position
        position += _FRAME.size + length
    return len(data) if data[position:] == MCAP0_MAGIC else position
