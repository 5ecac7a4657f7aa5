"""The quick writer against the library's own: the same calls, the same file."""

import io
import time
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from quick_mcap.writer import QuickWriter

CHUNK = 600
TIMES = st.integers(0, 2**62)
TEXT = st.text(max_size=12)
CALLS = st.lists(
    st.one_of(
        st.tuples(st.just("message"), st.integers(0, 2), TIMES, st.binary(max_size=300)),
        st.tuples(st.just("metadata"), TEXT, st.dictionaries(TEXT, TEXT, max_size=3)),
        st.tuples(st.just("attachment"), TIMES, TEXT, st.binary(max_size=50)),
        st.tuples(st.just("channel"), TEXT),
        st.tuples(st.just("flush")),
    ),
    max_size=40,
)


def written(writer: Any, stream: io.BytesIO, calls: list[tuple[Any, ...]]) -> bytes:
    writer.start(profile="", library="law")
    schema = writer.register_schema("a", "protobuf", b"xyz")
    channels = [writer.register_channel(topic, "raw", schema, {"k": topic}) for topic in ("/p", "/q", "/r")]
    for kind, *values in calls:
        if kind == "message":
            place, t_ns, data = values
            writer.add_message(channels[place], t_ns, data, t_ns)
        elif kind == "metadata":
            writer.add_metadata(*values)
        elif kind == "attachment":
            t_ns, name, data = values
            writer.add_attachment(t_ns, t_ns, name, "text/plain", data)
        elif kind == "channel":
            writer.register_channel(values[0], "raw", 0)
        else:
            writer.flush()
    writer.finish()
    return stream.getvalue()


def both(calls: list[tuple[Any, ...]], chunk: int = CHUNK) -> tuple[bytes, bytes]:
    ours, theirs = io.BytesIO(), io.BytesIO()
    return written(QuickWriter(ours, chunk), ours, calls), written(Writer(theirs, chunk_size=chunk), theirs, calls)


@given(CALLS)
def test_the_file_is_the_librarys_byte_for_byte(calls: list[tuple[Any, ...]]) -> None:
    ours, theirs = both(calls)
    assert ours == theirs


def test_the_library_reads_back_what_was_written() -> None:
    calls = [("message", k % 3, 1000 * k, bytes((k,)) * k) for k in range(200)]
    ours, _ = both(calls)
    read = [(m.log_time, m.data) for _, _, m in make_reader(io.BytesIO(ours)).iter_messages()]
    assert read == [(t_ns, data) for _, _, t_ns, data in calls]


def test_a_message_costs_less_than_half_of_the_librarys() -> None:
    """Processor time in one process, best of five: far apart, so that a busy machine does not turn it round."""
    spent: dict[str, list[float]] = {"quick": [], "library": []}
    calls = [("message", k % 3, 1000 * k, b"telemetry" * 8) for k in range(10_000)]
    for _ in range(5):
        for name in spent:
            stream = io.BytesIO()
            writer: Any = QuickWriter(stream, 1 << 18) if name == "quick" else Writer(stream, chunk_size=1 << 18)
            begin = time.thread_time()
            written(writer, stream, calls)
            spent[name].append(time.thread_time() - begin)
    assert min(spent["quick"]) < 0.5 * min(spent["library"]), spent
