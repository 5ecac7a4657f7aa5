"""Bad options end in one clear line and exit status 2, before any work is done."""

import argparse
import socket
from pathlib import Path

import pytest

from sandwich_sitl.cli import main
from sandwich_sitl.errors import InputError
from sandwich_sitl.options import check_program, check_writable, overrides_of, positive, whole

CONFIG = str(Path(__file__).parents[1] / "configs" / "open.yaml")
WITH_SET = (
    ["run", CONFIG],
    ["world", CONFIG],
    ["bench", "tracking", CONFIG],
    ["bench", "tick", CONFIG],
    ["bench", "loop", CONFIG],
)
WITH_JSON = (
    ["bench", "map"],
    ["bench", "plan"],
    ["bench", "replan"],
    ["bench", "mpc"],
    ["bench", "tracking", CONFIG],
)


def test_values_are_yaml_and_the_last_one_wins() -> None:
    items = ["planner.cell_m=0.5", "start_m=[1, 2]", "name=a=b", "planner.cell_m=1.0"]
    assert overrides_of(items) == {"planner.cell_m": 1.0, "start_m": [1, 2], "name": "a=b"}


@pytest.mark.parametrize("command", WITH_SET, ids=" ".join)
@pytest.mark.parametrize(
    ("item", "words"),
    [
        ("planner.cell_m=[1", "is not valid YAML"),
        ("when=2001-13-41", "is not valid YAML"),
        ("foo", "must be KEY=VALUE"),
    ],
)
def test_a_set_that_is_none(command: list[str], item: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command, "--set", item]) == 2
    message = capsys.readouterr().err
    assert f"--set {item}" in message
    assert words in message
    assert message.count("\n") == 1


@pytest.mark.parametrize("command", WITH_JSON, ids=lambda command: command[1])
def test_a_file_that_cannot_be_written(command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (tmp_path / "none" / "figures.json", tmp_path):
        assert main([*command, "--json", str(path)]) == 2
        message = capsys.readouterr().err
        assert f"--json {path}: cannot be written" in message
        assert message.count("\n") == 1


def test_a_file_that_is_there_keeps_what_it_holds(tmp_path: Path) -> None:
    kept, new = tmp_path / "kept.json", tmp_path / "new.json"
    kept.write_text("{}")
    check_writable("--json", kept)
    check_writable("--json", new)
    assert kept.read_text() == "{}"
    assert not new.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mpc", "--save", "ticks.npz"], "--log RUN.mcap"),
        (["mpc", "--log", "run.mcap", "--save", "none/ticks.npz"], "--save none/ticks.npz: cannot be written"),
        (["plan", "--random", "0"], "give a FILE"),
        (["loop", CONFIG, "--rotorpy", "/none/python"], "--rotorpy /none/python: is not a program"),
    ],
)
def test_what_a_bench_cannot_do(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *arguments]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mpc", "--first", "0"], "argument --first: 0 is less than 1"),  # the state is the command before the tick
        (["plan", "--queries", "0"], "argument --queries: 0 is less than 1"),
        (["plan", "--queries", "-1"], "argument --queries: -1 is less than 1"),
        (["plan", "--nodes", "0"], "argument --nodes: 0 is less than 1"),
        (["plan", "--random", "-1"], "argument --random: -1 is less than 0"),
        (["plan", "--radius", "nan"], "argument --radius: nan must be greater than 0"),
        (["replan", "--cases", "0"], "argument --cases: 0 is less than 1"),
        (["replan", "--worlds", "0"], "argument --worlds: 0 is less than 1"),
        (["mpc", "--count", "many"], "argument --count: many is not a whole number"),
        (["loop", CONFIG, "--repeat", "0"], "argument --repeat: 0 is less than 1"),
    ],
)
def test_numbers_that_make_no_sense(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["bench", *arguments])
    assert stopped.value.code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("foo", "link.uri: is not a connection URI"),
        ("udpin://127.0.0.1:99999", "link.uri: port 99999"),
        ("udpin://127.0.0.1:0", "give its number"),
        ("udpin://192.0.2.1:14540", "give an address of this machine"),
        ("serial:///dev/none:9600", "/dev/none cannot be opened"),
    ],
)
def test_a_link_that_cannot_be_opened(uri: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--clock", "realtime", "--out", str(tmp_path / "out"), "--connect", uri]
    assert main(["offboard", CONFIG, *options]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_lockstep_wants_datagrams(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["offboard", CONFIG, "--out", str(tmp_path), "--connect", "tcp://127.0.0.1:5760"]) == 2
    assert "set clock.mode to realtime" in capsys.readouterr().err


@pytest.mark.parametrize("above", [0, 40])
def test_a_port_that_is_taken_is_named_with_what_can_be_changed(
    above: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        taken = holder.getsockname()[1]
        options = ["--out", str(tmp_path), "--set", f"link.uri=udpin://127.0.0.1:{taken - above}"]
        assert main(["run", CONFIG, *options]) == 2
    message = capsys.readouterr().err
    assert f"UDP port {taken} on 127.0.0.1 is occupied" in message
    assert "--set link.uri=udpin://127.0.0.1:PORT" in message
    assert message.count("\n") == 1


def test_the_bounds_themselves_are_taken() -> None:
    assert whole(3)("3") == 3
    assert positive("1e-3") == 1e-3
    for text in ("0", "inf", "-1", "much"):
        with pytest.raises(argparse.ArgumentTypeError):
            positive(text)
    check_program("--rotorpy", None)
    check_program("--rotorpy", "sh")
    with pytest.raises(InputError, match="is not a program"):
        check_program("--rotorpy", "no-such-interpreter")
