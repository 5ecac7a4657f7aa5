"""A merged log holds every message of its inputs once, in order of time, and equal inputs give equal bytes."""

from pathlib import Path

import pytest
import run_samples
from mcap.reader import make_reader

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.container import read_raw
from sandwich_sitl.recording.merge import merge_logs
from sandwich_sitl.recording.reader import RunLog, payload_digests


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    directory = tmp_path_factory.mktemp("inputs")
    return [run_samples.write_offboard(directory / "o.mcap"), run_samples.write_vehicle(directory / "v.mcap")]


def test_nothing_is_lost_or_changed(inputs: list[Path], tmp_path: Path) -> None:
    assert merge_logs(inputs, tmp_path / "run.mcap") == ()
    raws = [read_raw(path) for path in inputs]
    merged = read_raw(tmp_path / "run.mcap")
    assert payload_digests(merged) == payload_digests(raws[0]) | payload_digests(raws[1])
    assert [m.log_time for m in merged.messages] == sorted(m.log_time for raw in raws for m in raw.messages)
    assert merged.metadata == raws[0].metadata + raws[1].metadata
    assert merged.attachments == raws[0].attachments
    channels = {c.topic: (c.message_encoding, c.metadata) for raw in raws for c in raw.channels.values()}
    assert {c.topic: (c.message_encoding, c.metadata) for c in merged.channels.values()} == channels
    with (tmp_path / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(merged.messages)


def test_equal_inputs_give_equal_bytes_and_no_file_besides(inputs: list[Path], tmp_path: Path) -> None:
    merge_logs(inputs, tmp_path / "a.mcap")
    merge_logs(inputs, tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "b.mcap"]


def test_a_cut_input_gives_what_it_holds(inputs: list[Path], tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = inputs[0].read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    assert merge_logs([cut, inputs[1]], tmp_path / "run.mcap") == ()
    log = RunLog.read(tmp_path / "run.mcap")
    assert not log.truncated
    assert len(log.truth.t_s) == 301


def test_an_input_without_a_beginning_is_named_and_left_out(inputs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "empty.mcap").touch()
    (problem,) = merge_logs([inputs[0], tmp_path / "empty.mcap"], tmp_path / "run.mcap")
    assert "empty.mcap: is empty" in problem
    assert RunLog.read(tmp_path / "run.mcap").mission.state[-1] == "DONE"


def test_no_readable_input_is_an_error_and_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        merge_logs([tmp_path / "none.mcap"], tmp_path / "run.mcap")
    assert list(tmp_path.iterdir()) == []
