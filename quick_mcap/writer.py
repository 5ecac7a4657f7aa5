"""An MCAP writer for many small messages: chunked, zstd, indexed, byte for byte the file of `mcap.writer.Writer`.

The library's writer spends three to four microseconds on a message of which two processes record some thirty a tick.
Here a message is one packed header and its data; all other records, a few in a file, are the library's own
(https://mcap.dev/spec). State: the chunk under way, and what the file's summary will say.
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import IO, Any

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS = _MESSAGE.size - 9  # without opcode and length
_INDEX = struct.Struct("<BQHI")
_FOOTER = struct.Struct("<BQQQ")


class QuickWriter:
    """Writes to `stream`, which stays open. Call `start` first and `finish` last; `OSError` of the stream is passed on."""

    def __init__(self, stream: IO[bytes], chunk_size: int) -> None:
        """A chunk is closed when it holds more than `chunk_size` bytes."""
        self._stream = stream
        self._chunk_size = chunk_size
        self._chunk = bytearray()
        self._places: dict[int, list[int]] = {}  # channel -> log time, offset, log time, offset, ...
        self._counts: dict[int, int] = defaultdict(int)
        self._first_ns = self._last_ns = 0
        self._span_ns: tuple[int, int] | None = None  # of all messages
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._chunks: list[records.ChunkIndex] = []
        self._attachments: list[records.AttachmentIndex] = []
        self._metadata: list[records.MetadataIndex] = []

    def start(self, profile: str = "", library: str = "") -> None:
        """The file's header."""
        self._stream.write(_MAGIC + _bytes_of(records.Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """A new schema's id."""
        schema = records.Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk += _bytes_of(schema)
        return schema.id

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """A new channel's id."""
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=message_encoding,
            schema_id=schema_id,
            metadata=dict(metadata or {}),
        )
        self._channels.append(channel)
        self._chunk += _bytes_of(channel)
        return channel.id

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int) -> None:
        """One message; times in nanoseconds."""
        chunk, places = self._chunk, self._places
        if not places:
            self._first_ns = self._last_ns = log_time
        elif log_time < self._first_ns:
            self._first_ns = log_time
        elif log_time > self._last_ns:
            self._last_ns = log_time
        place = (log_time, len(chunk))
        if channel_id in places:
            places[channel_id] += place
        else:
            places[channel_id] = [*place]
        chunk += _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_FIELDS + len(data), channel_id, 0, log_time, publish_time)
        chunk += data
        if len(chunk) > self._chunk_size:
            self._end_chunk()

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """A named set of strings."""
        record = _bytes_of(records.Metadata(name=name, metadata=dict(data)))
        self._metadata.append(records.MetadataIndex(offset=self._stream.tell(), length=len(record), name=name))
        self._stream.write(record)

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, data: bytes) -> None:
        """A file within the file."""
        record = _bytes_of(
            records.Attachment(create_time=create_time, log_time=log_time, name=name, media_type=media_type, data=data)
        )
        self._attachments.append(
            records.AttachmentIndex(
                offset=self._stream.tell(),
                length=len(record),
                create_time=create_time,
                log_time=log_time,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )
        self._stream.write(record)

    def flush(self) -> None:
        """End the chunk under way and hand everything to the system: a killed process loses nothing of it."""
        self._end_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """The last chunk and the file's summary."""
        self._end_chunk()
        self._stream.write(_bytes_of(records.DataEnd(0)))
        start = self._stream.tell()
        summary = RecordBuilder()
        offsets = [
            _group(summary, start, opcode, group)
            for opcode, group in (
                (Opcode.SCHEMA, self._schemas),
                (Opcode.CHANNEL, self._channels),
                (Opcode.STATISTICS, [self._statistics()]),
                (Opcode.CHUNK_INDEX, self._chunks),
                (Opcode.ATTACHMENT_INDEX, self._attachments),
                (Opcode.METADATA_INDEX, self._metadata),
            )
        ]
        offset_start = start + summary.count
        for offset in offsets:
            offset.write(summary)
        data = summary.end()  # type: ignore[no-untyped-call]
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 8 + 8 + 4, start, offset_start), zlib.crc32(data))
        footer = records.Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc)
        self._stream.write(data + _bytes_of(footer) + _MAGIC)

    def _end_chunk(self) -> None:
        if not self._places:
            return
        plain = bytes(self._chunk)
        chunk = records.Chunk(
            compression="zstd",
            data=zstandard.compress(plain),
            message_start_time=self._first_ns,
            message_end_time=self._last_ns,
            uncompressed_crc=zlib.crc32(plain),
            uncompressed_size=len(plain),
        )
        record = _bytes_of(chunk)
        begin = self._stream.tell()
        indexes, offsets = bytearray(), {}
        for channel_id, places in self._places.items():
            offsets[channel_id] = begin + len(record) + len(indexes)
            size = 8 * len(places)
            indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
            indexes += struct.pack(f"<{len(places)}Q", *places)
        self._stream.write(record + indexes)
        self._chunks.append(
            records.ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=begin,
                chunk_length=len(record),
                message_index_offsets=offsets,
                message_index_length=len(indexes),
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self._note_chunk()

    def _note_chunk(self) -> None:
        """Enter the ended chunk into the statistics and begin the next one."""
        for channel_id, places in self._places.items():
            self._counts[channel_id] += len(places) // 2
        first, last = self._span_ns or (self._first_ns, self._last_ns)
        self._span_ns = (min(first, self._first_ns), max(last, self._last_ns))
        self._chunk.clear()
        self._places.clear()

    def _statistics(self) -> records.Statistics:
        first, last = self._span_ns or (0, 0)
        return records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=first,
            message_end_time=last,
            schema_count=len(self._schemas),
        )


def _bytes_of(record: Any) -> bytes:
    """One of the library's records as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _group(summary: RecordBuilder, start: int, opcode: Opcode, group: Iterable[Any]) -> records.SummaryOffset:
    """Append records of one kind to the summary; where they stand."""
    begin = summary.count
    for record in group:
        record.write(summary)
    return records.SummaryOffset(group_opcode=opcode, group_start=start + begin, group_length=summary.count - begin)
