"""Several logs of one run merged into one, ordered by log time.

Channels keep their topics, encodings, schemas and metadata; metadata records and attachments follow in the order of
the inputs. Equal inputs give equal bytes. An input that a killed process left without its end gives what it holds.
"""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from mcap.records import Schema
from mcap.writer import Writer

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.container import RawLog, read_raw

NO_SCHEMA = 0


def merge_logs(paths: Sequence[Path], out: Path) -> tuple[str, ...]:
    """Write `out` from `paths`; it appears whole or not at all.

    Returns one line for each input that could not be read at all (its process died before it wrote anything). Raises
    `InputError` when that is so of every input, or when `out` cannot be created.
    """
    logs, problems = [], []
    for path in paths:
        try:
            logs.append(read_raw(path))
        except InputError as error:
            problems.append(str(error))
    if not logs:
        raise InputError("; ".join(problems) or f"{out}: there is no log to merge; give at least one")
    try:
        handle, name = tempfile.mkstemp(dir=out.parent, prefix=f".{out.name}.")
    except OSError as error:
        raise InputError(
            f"{out}: cannot be created ({error.strerror}); give a directory that can be written"
        ) from error
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            writer = Writer(file)
            writer.start(library="sandwich-sitl")
            _write(writer, logs)
            writer.finish()  # type: ignore[no-untyped-call]
        temporary.chmod(0o644)
        temporary.replace(out)
    finally:
        temporary.unlink(missing_ok=True)
    return tuple(problems)


def _write(writer: Writer, logs: Sequence[RawLog]) -> None:
    channels = _register(writer, logs)
    for log in logs:
        for record in log.metadata:
            writer.add_metadata(record.name, record.metadata)
        for attachment in log.attachments:
            writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
            )
    tagged = ((message.log_time, index, message) for index, log in enumerate(logs) for message in log.messages)
    for _, index, message in sorted(tagged, key=lambda item: item[:2]):
        writer.add_message(
            channels[index, message.channel_id], message.log_time, message.data, message.publish_time, message.sequence
        )


def _register(writer: Writer, logs: Sequence[RawLog]) -> dict[tuple[int, int], int]:
    """Channel ids of the merged file by (input, id in that input); equal schemas are stored once."""
    schemas: dict[tuple[str, str, bytes], int] = {}
    channels: dict[tuple[int, int], int] = {}
    for index, log in enumerate(logs):
        for channel in log.channels.values():
            schema = log.schemas.get(channel.schema_id)
            schema_id = NO_SCHEMA if schema is None else _schema_id(writer, schemas, schema)
            channels[index, channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
    return channels


def _schema_id(writer: Writer, known: dict[tuple[str, str, bytes], int], schema: Schema) -> int:
    key = (schema.name, schema.encoding, schema.data)
    if key not in known:
        known[key] = writer.register_schema(*key)
    return known[key]
