"""`world` and `config` on the command line: a run and its map file are one world, and what is left out is said."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from sandwich_sitl.cli import main
from sandwich_sitl.config import load_config
from sandwich_sitl.world.importers import ImportOptions, read_world
from sandwich_sitl.world.load import import_world, load_world
from sandwich_sitl.yaml_document import is_run_file

PLANNER = {"vehicle_radius_m": 0.4, "margin_m": 0.6}
ARENA = "type octile\nheight 6\nwidth 9\nmap\n" + "\n".join(
    ["@@@@@@@@@", "@.......@", "@...@...@", "@...@...@", "@.......@", "@@@@@@@@@", ""]
)
TOWN = (
    '{"type": "FeatureCollection", "features": ['
    + ", ".join(
        f'{{"type": "Feature", "properties": {{"name": "{name}", "building": "{name}"}}, "geometry": '
        f'{{"type": "Polygon", "coordinates": [[[{x}, 50], [{x + 1e-3}, 50], [{x + 1e-3}, 50.001], [{x}, 50]]]}}}}'
        for name, x in (("hall", 14.0), ("house", 14.003))
    )
    + "]}"
)


def room(folder: Path) -> None:
    pixels = np.full((40, 60), 254, dtype=np.uint8)
    pixels[[0, -1]] = pixels[:, [0, -1]] = pixels[15:20, 25:30] = 0
    Image.fromarray(pixels).save(folder / "room.pgm")
    (folder / "room.yaml").write_text("image: room.pgm\nresolution: 0.5\norigin: [-3, 4, 0.2]\n")


MAPS = {
    "arena.map": lambda folder: (folder / "arena.map").write_text(ARENA),
    "room.yaml": room,
    "town.geojson": lambda folder: (folder / "town.geojson").write_text(TOWN),
    "boxes.wkt": lambda folder: (folder / "boxes.wkt").write_text("POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))\n"),
    "boxes.csv": lambda folder: (folder / "boxes.csv").write_text("name,x,y\na,0,0\na,1,0\na,1,1\n"),
}


def run_file(folder: Path, **world: object) -> Path:
    data = {"world": world, "start_m": [1, 1], "goal_m": [2, 2], "altitude_m": 8, "planner": PLANNER}
    path = folder / "run.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize("name", MAPS)
def test_a_run_and_its_map_file_are_one_world(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "maps").mkdir()
    MAPS[name](tmp_path / "maps")
    path = run_file(tmp_path, file=f"maps/{name}")
    monkeypatch.chdir("/")
    config = load_config(path)
    world = load_world(config.world, path)
    # The vehicle's width, and its radius with what its planner keeps.
    options = ImportOptions(gap_m=2.0, clearance_m=1.15)
    assert (config.world.gap_m, config.world.clearance_m) == (2.0, pytest.approx(1.15))
    assert world == read_world(tmp_path / "maps" / name, options).world
    assert main(["world", str(path), "--out", str(tmp_path)]) == 0
    by_run = capsys.readouterr().out
    arguments = ["--set", "gap_m=2", "--set", "clearance_m=1.15"]
    assert main(["world", str(tmp_path / "maps" / name), "--out", str(tmp_path), *arguments]) == 0
    assert capsys.readouterr().out == by_run
    assert (tmp_path / "world.png").stat().st_size > 10_000


def test_options_are_the_same_keys_in_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    MAPS["town.geojson"](tmp_path)
    path = run_file(tmp_path, file="town.geojson", where={"building": "hall"}, bounds_m=[-300, -300, 300, 300])
    config = load_config(path)
    assert [o.name for o in load_world(config.world, path).obstacles] == ["hall"]
    for text in ("where.building=hall", "where={building: hall}"):
        assert main(["world", str(tmp_path / "town.geojson"), "--out", str(tmp_path), "--set", text]) == 0
        assert "obstacles 1 with 3 corners" in capsys.readouterr().out
    assert main(["world", str(path), "--out", str(tmp_path), "--set", "world.where={building: '*'}"]) == 0
    assert "obstacles 2 with 6 corners" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("gap_m=-1", "--set gap_m: must be greater than or equal to 0, got -1"),
        ("gap=1", "--set gap: is not a known key"),
        ("cell_m=1e3", "write 1000.0"),
        ("where=3", "--set where:"),
        ("where.building=yes", "in quotes"),
        ("origin.latitude_deg=50", "--set origin.longitude_deg: is missing"),
        ("bounds_m=[0, 0, 0, 1]", "has no area"),
        ("clearance_m.x=1", "--set clearance_m"),
        ("when=2001-01-01", "--set when: is not a known key"),
    ],
)
def test_bad_options_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    MAPS["town.geojson"](tmp_path)
    assert main(["world", str(tmp_path / "town.geojson"), "--out", str(tmp_path), "--set", text]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "text", "key"),
    [
        ("boxes.wkt", "cell_m=2", "cell_m"),
        ("town.geojson", "unknown_is_free=true", "unknown_is_free"),
        ("room.yaml", "passable=G", "passable"),
        ("arena.map", "repair=true", "repair"),
        ("arena.map", "storey_m=4", "storey_m"),
        ("boxes.csv", "where.name=a", "where"),
        ("boxes.csv", "window_deg=[1, 2, 3, 4]", "window_deg"),
    ],
)
def test_a_key_of_another_format_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, key: str
) -> None:
    MAPS[name](tmp_path)
    assert main(["world", str(tmp_path / name), "--out", str(tmp_path), "--set", text]) == 2
    message = capsys.readouterr().err
    assert f"{name}: {key}: is for " in message
    assert message.count("\n") == 1


def test_what_lies_outside_the_bounds_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    far = {"name": "far barn", "circle_m": [50, 50, 2]}
    path = run_file(tmp_path, bounds_m=[0, 0, 20, 20], obstacles=[far, {"name": "near", "circle_m": [9, 9, 2]}])
    report = import_world(load_config(path).world, path).report
    assert (report.read, report.outside, report.outside_names) == (2, 1, ("far barn",))
    assert main(["world", str(path), "--out", str(tmp_path)]) == 0
    assert "outside   far barn: lies wholly outside the bounds" in capsys.readouterr().out
    assert main(["config", str(path)]) == 0
    assert "1 shape wholly outside the bounds, left out (far barn)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("start_m", [1, 50], "run.yaml:8: start_m: (1, 50) lies outside the world"),
        ("goal_m", [9, 9], "goal_m: (9, 9) lies inside obstacle 'near'"),
        ("goal_m", [9, 11.5], "goal_m: (9, 11.5) lies inside obstacle 'near' grown by 1 m"),
        ("link", {"uri": "foo"}, "link.uri: is not a connection URI"),
        ("link", {"uri": "udpin://127.0.0.1:99999"}, "link.uri: port 99999 is not within 1..65535"),
    ],
)
def test_config_refuses_what_a_run_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str, value: object, words: str
) -> None:
    path = run_file(tmp_path, bounds_m=[0, 0, 20, 20], obstacles=[{"name": "near", "circle_m": [9, 9, 2]}])
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {key: value}))
    assert main(["config", str(path)]) == 2
    assert words in capsys.readouterr().err


def test_a_run_file_is_told_from_a_map(tmp_path: Path) -> None:
    room(tmp_path)
    assert is_run_file(run_file(tmp_path, file="room.yaml"))
    assert not is_run_file(tmp_path / "room.yaml")
    assert not is_run_file(tmp_path / "room.pgm")
    assert not is_run_file(tmp_path / "none.yaml")


def test_a_grid_that_does_not_fill_the_bounds_is_walled_in(tmp_path: Path) -> None:
    """Ground beside the image is as unknown as an unknown cell."""
    room(tmp_path)
    (tmp_path / "room.yaml").write_text("image: room.pgm\nresolution: 0.5\norigin: [0, 0, 0]\n")
    bounds = (-10.0, -10.0, 40.0, 30.0)
    for free, area in ((False, 50 * 40 - 58 * 38 / 4 + 25 / 4), (True, (60 * 40 - 58 * 38 + 25) / 4)):
        options = ImportOptions(bounds_m=bounds, unknown_is_free=free, simplify_m=0.0)
        world = read_world(tmp_path / "room.yaml", options).world
        assert sum(o.polygon.area for o in world.obstacles) == pytest.approx(area)
