"""The scripts of tools/ as a user calls them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pyarrow.csv
import pyarrow.parquet
import pytest
import run_samples

from sandwich_sitl.recording.plan_file import save_plan
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.summary import summarise

ROOT = Path(__file__).parents[2]


def call(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", str(ROOT / "tools" / script), *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)


def test_summary_prints_what_summarise_computes(run_path: Path) -> None:
    result = call("summary.py", run_path, "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == summarise(RunLog.read(run_path))
    assert call("summary.py", run_path).stdout.startswith("outcome  landed")


def test_summary_says_when_a_log_is_cut(run_path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(run_path.read_bytes()[:-100])
    result = call("summary.py", cut)
    assert result.returncode == 0
    assert "is cut off" in result.stderr


@pytest.mark.parametrize(
    ("script", "options"),
    [("compare.py", ["{cut}"]), ("export.py", ["--csv", "{out}"]), ("figures.py", ["--out", "{out}"])],
)
def test_every_tool_says_when_a_log_is_cut(run_path: Path, tmp_path: Path, script: str, options: list[str]) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(run_path.read_bytes()[:-100])
    given = [option.format(cut=cut, out=tmp_path / "out") for option in options]
    result = call(script, cut, *given)
    assert result.returncode == 0, result.stderr
    assert f"{cut}: is cut off" in result.stderr
    assert (
        "cut off"
        not in call(script, run_path, *(option.format(cut=run_path, out=tmp_path) for option in options)).stderr
    )


def test_no_client_program_is_no_success(tmp_path: Path) -> None:
    result = call("client_matrix.py", "--clients", tmp_path)
    assert result.returncode == 2
    assert "no client program was flown" in result.stderr


def test_compare_tells_equal_from_different(run_path: Path, tmp_path: Path) -> None:
    same = run_samples.write_run(tmp_path)
    assert "all topics equal" in call("compare.py", run_path, same).stdout
    alone = run_samples.write_offboard(tmp_path / "alone.mcap")
    result = call("compare.py", run_path, alone)
    assert result.returncode == 1
    assert "payloads: different: /state/truth" in result.stdout


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_tables_hold_the_logged_values(run_path: Path, tmp_path: Path, kind: str) -> None:
    result = call("export.py", run_path, f"--{kind}", tmp_path)
    assert result.returncode == 0, result.stderr
    read = pyarrow.csv.read_csv if kind == "csv" else pyarrow.parquet.read_table
    tables = {path.stem: read(path) for path in tmp_path.iterdir()}
    assert set(tables) == {"control", "truth", "estimate", "mission", "wall_timing", "log"}
    log = RunLog.read(run_path)
    assert tables["control"].column("setpoint_v_y_mps").to_pylist() == log.control.setpoint_v_mps[:, 1].tolist()
    assert tables["truth"].column("r_x_m").to_pylist() == log.truth.r_m[:, 0].tolist()
    assert tables["mission"].column("state").to_pylist() == list(log.mission.state)


def test_tlog_is_written(run_path: Path, tmp_path: Path) -> None:
    result = call("export.py", run_path, "--tlog", tmp_path / "run.tlog")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "run.tlog").stat().st_size == 302 * (8 + 16)


def test_a_plan_is_drawn_from_a_log_and_from_its_file(run_path: Path, tmp_path: Path) -> None:
    save_plan(run_samples.small_plan(), tmp_path / "plan.npz")
    for source in (run_path, tmp_path / "plan.npz"):
        picture = tmp_path / f"{source.stem}.png"
        result = call("plan_picture.py", source, "--out", picture)
        assert result.returncode == 0, result.stderr
        assert picture.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "plan.png").read_bytes() != (tmp_path / f"{run_path.stem}.png").read_bytes()


@pytest.mark.parametrize("script", ["summary.py", "compare.py", "export.py", "plan_picture.py"])
def test_bad_input_is_one_line_and_status_2(script: str, tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_text("no log")
    more = {"summary.py": [], "plan_picture.py": [], "compare.py": [bad], "export.py": ["--csv", tmp_path / "out"]}[
        script
    ]
    result = call(script, bad, *more)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert "is not an MCAP file" in result.stderr


def test_an_unwritable_target_is_one_line_and_status_2(run_path: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = call("export.py", run_path, "--csv", tmp_path / "file" / "out")
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1


def test_figures_are_drawn_from_a_log_and_refused_without_a_plan(run_path: Path, tmp_path: Path) -> None:
    result = call("figures.py", run_path, "--out", tmp_path / "figures")
    assert result.returncode == 0, result.stderr
    names = [Path(line).name for line in result.stdout.split()]
    assert names == ["path.png", "quadrangles.png", "snap.png"]
    for name in names:
        data = (tmp_path / "figures" / name).read_bytes()
        assert data.startswith(b"\x89PNG")
        assert len(data) > 5000
    bad = tmp_path / "empty.mcap"
    bad.write_bytes(b"")
    assert call("figures.py", bad).returncode == 2


def test_the_map_of_a_run_is_drawn(tmp_path: Path) -> None:
    result = call("map_picture.py", ROOT / "configs" / "single.yaml", "--cell", 2, "--out", tmp_path / "map.png")
    assert result.returncode == 0, result.stderr
    assert 10_000 < (tmp_path / "map.png").stat().st_size < 400_000


def test_the_map_of_a_map_file_is_drawn_with_its_options(tmp_path: Path) -> None:
    town = tmp_path / "town.wkt"
    town.write_text("POLYGON ((20 10, 30 10, 30 20, 20 20, 20 10))", encoding="utf-8")
    options = ["--flow", "y", "--title", "Town", "--set", "bounds_m=[0, 0, 50, 30]", "--out", tmp_path / "map.png"]
    result = call("map_picture.py", town, *options)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "map.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "gap=1"], "--set gap: is not a known key"),
        (["--set", "gap_m"], "must be KEY=VALUE"),
        (["--cell", "-1"], "-1 must be greater than 0"),
    ],
)
def test_a_bad_option_of_the_map_picture_is_one_line(tmp_path: Path, arguments: list[str], words: str) -> None:
    town = tmp_path / "town.wkt"
    town.write_text("POLYGON ((20 10, 30 10, 30 20, 20 20, 20 10))", encoding="utf-8")
    result = call("map_picture.py", town, "--out", tmp_path / "map.png", *arguments)
    assert result.returncode == 2
    assert words in result.stderr


@pytest.mark.parametrize("item", ["gap_m=[1", "gap_m"])
def test_a_picture_of_a_map_wants_key_and_value(tmp_path: Path, item: str) -> None:
    result = call("map_picture.py", ROOT / "configs" / "open.yaml", "--out", tmp_path / "map.png", "--set", item)
    assert result.returncode == 2
    assert result.stderr.startswith(f"--set {item}: ")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("option", ["--rotorpy=/none/python", "--seconds=-1", "--seconds=nan"])
def test_the_vehicles_bench_refuses_what_it_cannot_do(option: str) -> None:
    result = call("bench_vehicle.py", option)
    assert result.returncode == 2
    assert option.partition("=")[2] in result.stderr.splitlines()[-1]
