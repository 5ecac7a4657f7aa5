"""Configuration: every bad file gives one line with file, line, key path and fix; good ones survive a round trip."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from sandwich_sitl.config import RunConfig, config_as_dict, config_schema, load_config
from sandwich_sitl.errors import InputError
from sandwich_sitl.launcher import check_vehicle_section, make_plan
from sandwich_sitl.margin_notice import margin_notice
from sandwich_sitl.progress import Progress
from sandwich_sitl.world.load import load_world
from vehicle_sim.config import load_run
from vehicle_sim.errors import ConfigError

CONFIGS = sorted((Path(__file__).parent.parent / "configs").glob("*.yaml"))

GOOD = """\
world:
  bounds_m: [0, 0, 40, 30]
  obstacles:
    - {name: box, polygon_m: [[15, 10], [25, 10], [25, 20], [15, 20]]}
start_m: [4, 15]
goal_m: [36, 15]
altitude_m: 8
planner:
  vehicle_radius_m: 0.4
  margin_m: 0.6
  cell_m: 2.0
"""


BOMB = "a: &a {x: 1}\n" + "".join(
    f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join(['*' + chr(97 + k)] * 9)}]\n" for k in range(9)
)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "flight.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def planned(path: Path) -> None:
    """Read the file, build its world, plan its flight."""
    make_plan(load_config(path), path, Progress())


def complaint(path: Path) -> str:
    """The error of `planned`."""
    with pytest.raises(InputError) as caught:
        planned(path)
    return str(caught.value)


def test_the_good_file_is_good(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    planned(path)
    config = load_config(path)
    assert config.start_m == (4.0, 15.0)
    assert config.planner.cell_m == 2.0
    assert config.world.obstacles[0].name == "box"


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("altitude_m: 8", "altitude_m: 8\naltitude: 3", 8, ("altitude:", "not a known key", "--schema")),
        ("  margin_m: 0.6", "  margins_m: 0.6\n  margin_m: 0.6", 10, ("planner.margins_m", "not a known key")),
        ("altitude_m: 8", "altitude_m: high", 7, ("altitude_m", "number", '"high"')),
        ("altitude_m: 8", "altitude_m: -8", 7, ("altitude_m", "greater than or equal to 1", "-8")),
        ("altitude_m: 8", "altitude_m: .nan", 7, ("altitude_m", "finite")),
        ("altitude_m: 8", "altitude_m: .inf", 7, ("altitude_m", "finite")),
        ("altitude_m: 8\n", "", 1, ("altitude_m", "missing", "add it")),
        ("  margin_m: 0.6\n", "", 8, ("planner.margin_m", "missing", "add it")),
        ("start_m: [4, 15]", "start_m: [4, .nan]", 5, ("start_m[1]", "finite")),
        ("start_m: [4, 15]", "start_m: [4, 15, 2]", 5, ("start_m",)),
        ("start_m: [4, 15]", "start_m: {x: 4}", 5, ("start_m",)),
        ("[25, 20], ", "[25], ", 4, ("world.obstacles[0].polygon_m[2]", "missing")),
        ("altitude_m: 8", "altitude_m: 8\nclock: {mode: fast}", 8, ("clock.mode", "realtime", '"fast"')),
        (
            "altitude_m: 8",
            "altitude_m: 8\nassurance: {position_std_m: 0}",
            8,
            ("assurance.position_std_m", "greater than 0"),
        ),
        ("altitude_m: 8", "altitude_m: 8\nseed: 1.5", 8, ("seed", "whole number")),
        ("altitude_m: 8", "altitude_m: 8\nzenoh: {enabled: 1}", 8, ("zenoh.enabled", "boolean")),
        ("altitude_m: 8", "altitude_m: 8\nplanner: 3", 9, ("'planner' stands twice",)),
        ("altitude_m: 8", "altitude_m: 8\naltitude_m: 9", 8, ("'altitude_m' stands twice",)),
        ("altitude_m: 8", "altitude_m: [8", 8, ("not valid YAML",)),
        ("altitude_m: 8", "altitude_m: !!python/name:os.system 8", 7, ("not valid YAML",)),
        ("  cell_m: 2.0", "  floors_m: [8, 20, 14]", 11, ("planner.floors_m", "must rise", "give [8.0, 14.0, 20.0]")),
        ("  cell_m: 2.0", "  floors_m: [8, 8, 14]", 11, ("planner.floors_m", "must rise", "give [8.0, 14.0]")),
        ("  cell_m: 2.0", "  floors_m: [0, 8]", 11, ("planner.floors_m[0]", "greater than or equal to 1")),
        ("  cell_m: 2.0", "  floors_m: [8, high]", 11, ("planner.floors_m[1]", "number", '"high"')),
        ("  cell_m: 2.0", "  floors_m: [4, 8]", 11, ("planner.floors_m", "4 lies below", "start and goal (8)")),
        ("  cell_m: 2.0", "  floors_m: [6, 14]", 7, ("altitude_m", "8 is none of planner.floors_m [6.0, 14.0]")),
        (
            "  cell_m: 2.0",
            "  floors_m: [8, 14]\n  vertical_margin_m: 0.2\n  climb_mps: 4",
            12,
            ("planner.vertical_margin_m", "use at least 0.36"),
        ),
        ("altitude_m: 8", "altitude_m: 8\ngoal_altitude_m: 14", 8, ("goal_altitude_m", "planner.floors_m: [8, 14]")),
        ("altitude_m: 8", "altitude_m: 8\n[a, b]: 3", 8, ("a key must be text",)),
        ("altitude_m: 8", "altitude_m: 8\n2020-01-01: 3", 8, ("a key must be text",)),
        ("altitude_m: 8", "altitude_m: 8\n7: 3", 8, ("a key must be text",)),
    ],
)
def test_bad_value_is_named_with_file_line_key_and_fix(
    tmp_path: Path, old: str, new: str, line: int, words: tuple[str, ...]
) -> None:
    assert GOOD.count(old) == 1
    path = written(tmp_path, GOOD.replace(old, new))
    message = complaint(path)
    assert message.startswith(f"{path}:{line}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[25, 10], [25, 20]", "[25, 20], [25, 10]", 4, ("world.obstacles[0].polygon_m", "'box'", "in order")),
        (
            "[[15, 10], [25, 10], [25, 20], [15, 20]]",
            "[[15, 10], [20, 10], [25, 10]]",
            4,
            ("world.obstacles[0].polygon_m", "'box'", "not a simple polygon"),
        ),
        ("name: box,", "name: box, circle_m: [3, 3, 1],", 4, ("world.obstacles[0]:", "exactly one of")),
        (
            "polygon_m: [[15, 10], [25, 10], [25, 20], [15, 20]]",
            "height_m: 3",
            4,
            ("world.obstacles[0]:", "exactly one"),
        ),
        ("[25, 10], [25, 20]", "[1e200, 10], [25, 20]", 4, ("polygon_m[1][0]", "must be a number", "write 1.0e+200")),
        ("[25, 10], [25, 20]", "[1.0e+200, 10], [25, 20]", 4, ("polygon_m[1][0]", "less than or equal to 10000000")),
        ("[0, 0, 40, 30]", "[40, 0, 0, 30]", 2, ("world.bounds_m", "has no area", "x_min")),
        (
            "{name: box,",
            "{name: box, height_m: tall,",
            4,
            ("world.obstacles[0].height_m", "must be a number", '"tall"'),
        ),
        ("{name: box,", "{name: box, height_m: -3,", 4, ("world.obstacles[0].height_m", "greater than 0", "-3")),
        ("  bounds_m: [0, 0, 40, 30]\n", "", 1, ("world:", "neither bounds_m nor file")),
        ("start_m: [4, 15]", "start_m: [20, 15]", 5, ("start_m: (20, 15)", "inside obstacle 'box'", "move it")),
        ("start_m: [4, 15]", "start_m: [14.5, 15]", 5, ("start_m: (14.5, 15)", "'box' grown by 1 m", "margin_m")),
        ("goal_m: [36, 15]", "goal_m: [41, 15]", 6, ("goal_m: (41, 15)", "outside the world", "move it inside")),
        ("  cell_m: 2.0", "  cell_m: 0.001", 11, ("planner.cell_m: 0.001", "use at least")),
        ("world:\n", "world:\n  file: city.geojson\n", 1, ("world:", "both file and obstacles", "keep one")),
        (
            "world:\n",
            "world:\n  origin: {latitude_deg: 50, longitude_deg: 14}\n",
            2,
            ("world.origin", "belongs to the map of a file", "remove it"),
        ),
        ("world:\n", "world:\n  where: {building: yes}\n", 2, ("world.where.building", "in quotes", "true")),
        ("world:\n", "world:\n  clearance_m: -1\n", 2, ("world.clearance_m", "greater than or equal to 0")),
        ("world:\n", "world:\n  geojson: town.geojson\n", 2, ("world.geojson", "not a known key")),
        ("  cell_m: 2.0", "  cell_m: 2e0", 11, ("planner.cell_m", "YAML 1.1 reads as text", "write 2.0")),
    ],
)
def test_bad_world_is_named_with_line_key_and_fix(
    tmp_path: Path, old: str, new: str, line: int, words: tuple[str, ...]
) -> None:
    assert GOOD.count(old) == 1
    path = written(tmp_path, GOOD.replace(old, new))
    message = complaint(path)
    assert message.startswith(f"{path}:{line}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("section", "place", "words"),
    [
        ("vehicle:\n  wind:\n    mean_enu_mps: [1, 2]", ":14", "mean_enu_mps[2]: is missing; the list is too short"),
        ("vehicle:\n\n  parameters: {FOO: 3}", ":14", "`vehicle-sim --parameters` lists them"),
        ("vehicle:\n  failures:\n    - {part: motor}", ":14", "vehicle.failures[0].at_s: is missing; add it"),
        ("vehicle: {battery: {cells: four}}", ":12", 'vehicle.battery.cells: must be a whole number, got "four"'),
    ],
)
def test_the_vehicles_section_has_lines_too(tmp_path: Path, section: str, place: str, words: str) -> None:
    """From either program."""
    assert GOOD.count("\n") == 11
    path = written(tmp_path, f"{GOOD}{section}\n")
    with pytest.raises(InputError) as caught:
        check_vehicle_section(load_config(path), path)
    assert str(caught.value).startswith(f"{path}{place}: vehicle.")
    assert words in str(caught.value)
    with pytest.raises(ConfigError) as by_itself:
        load_run(path)
    assert str(by_itself.value) == str(caught.value)


@pytest.mark.parametrize(
    ("estimator", "margin_m", "said"),
    [("filter", 0.6, True), ("filter", 1.0, False), ("error_model", 0.6, False), ("error_model", 0.05, True)],
)
def test_a_margin_that_the_estimate_s_errors_exceed_is_mentioned(
    tmp_path: Path, estimator: str, margin_m: float, said: bool
) -> None:
    changes = {"vehicle.sensors.estimator": estimator, "planner.margin_m": margin_m}
    config = load_config(written(tmp_path, GOOD), changes)
    notice = margin_notice(config, check_vehicle_section(config, tmp_path / "run.yaml"))
    assert (notice is not None) == said
    if notice is not None:
        assert f"planner.margin_m {margin_m:g}" in notice
        assert estimator in notice


def test_how_uncertain_of_its_place_a_vehicle_may_be_goes_by_the_margin_unless_it_is_given(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    assert load_config(path).position_std_limit_m == pytest.approx(0.45)
    assert load_config(path, {"planner.margin_m": 1.0}).position_std_limit_m == pytest.approx(0.75)
    assert load_config(path, {"assurance.position_std_m": 0.7}).position_std_limit_m == 0.7


def test_an_overridden_value_of_the_vehicle_has_no_line(tmp_path: Path) -> None:
    path = written(tmp_path, f"{GOOD}vehicle: {{battery: {{cells: 4}}}}\n")
    with pytest.raises(ConfigError) as caught:
        load_run(path, {"vehicle.battery.cells": 0})
    assert str(caught.value).startswith(f"{path}, overridden on the command line: vehicle.battery.cells: must be")
    with pytest.raises(InputError) as of_run:
        check_vehicle_section(load_config(path, {"vehicle.battery.cells": 0}), path)
    assert str(of_run.value).startswith(f"{path}: vehicle.battery.cells: must be")


def test_an_overridden_value_has_no_line(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    with pytest.raises(InputError) as caught:
        make_plan(load_config(path, {"start_m": [20, 15]}), path, Progress())
    assert str(caught.value).startswith(f"{path}: start_m: (20, 15)")


@pytest.mark.parametrize("number", ["1e9", "1.0e9", "-3e-7", "1e22", "6.02e23"])
def test_the_number_that_is_advised_is_one(tmp_path: Path, number: str) -> None:
    message = complaint(written(tmp_path, GOOD.replace("altitude_m: 8", f"altitude_m: {number}")))
    advised = message.rpartition("write ")[2]
    assert yaml.safe_load(advised) == float(number)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "must be a mapping"),
        ("- 1\n- 2\n", "must be a mapping"),
        ("just words", "must be a mapping"),
        ("a: b: c", "not valid YAML"),
        ("a: 1\n---\nb: 2\n", "not valid YAML"),
        ("a: \x01", "not valid YAML"),
        ("a: *nowhere", "not valid YAML"),
        ("a: &a [*a]", "refers to itself"),
        ("a: " + "[" * 20_000, "nests too deep"),
        ("a: 2001-99-99", "not valid YAML"),
        (BOMB.replace("[", "{<<: [").replace("]", "]}"), "stand for more than"),
        (BOMB, "stand for more than"),
        ("a: '" + "x" * 5_000_000 + "'", "put its world into a map file"),
    ],
)
def test_file_that_is_no_configuration(tmp_path: Path, text: str, words: str) -> None:
    path = written(tmp_path, text)
    message = complaint(path)
    assert message.startswith(str(path))
    assert words in message
    assert "\n" not in message


def test_missing_and_undecodable_files(tmp_path: Path) -> None:
    assert "cannot be read" in complaint(tmp_path / "none.yaml")
    assert "cannot be read" in complaint(tmp_path)
    path = tmp_path / "latin.yaml"
    path.write_bytes("name: Köln".encode("latin-1"))
    assert "save it as UTF-8" in complaint(path)


def test_several_problems_are_counted(tmp_path: Path) -> None:
    message = complaint(written(tmp_path, GOOD.replace("altitude_m: 8", "altitude_m: x\nseed: y\nmode: z")))
    assert message.endswith("(and 2 more)")


def test_override_beats_the_file_and_is_checked_like_it(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    config = load_config(path, {"clock.mode": "realtime", "clock.speed": 3.0, "seed": 7})
    assert (config.clock.mode, config.clock.speed, config.seed) == ("realtime", 3.0, 7)
    with pytest.raises(InputError, match=r"clock\.speed.*greater than 0"):
        load_config(path, {"clock.speed": -1.0})
    with pytest.raises(InputError, match="'altitude_m' is not a section"):
        load_config(path, {"altitude_m.x": 1.0})


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_file_loads_and_survives_a_round_trip(path: Path, tmp_path: Path) -> None:
    config = load_config(path)
    world = load_world(config.world, path)
    if config.world.file is None:
        assert len(world.obstacles) == len(config.world.obstacles)
    again = written(tmp_path, yaml.safe_dump(config_as_dict(config)))
    assert load_config(again) == config


def test_shipped_worlds_are_the_promised_ones() -> None:
    worlds = {path.stem: load_config(path).world for path in CONFIGS}
    assert set(worlds) >= {"paper", "city", "open", "single"}
    assert worlds["paper"].bounds_m == (0, 0, 120, 80)
    assert len(worlds["city"].obstacles) >= 40
    assert not worlds["open"].obstacles
    assert len(worlds["single"].obstacles) == 1


def test_anchors_and_merge_keys_work(tmp_path: Path) -> None:
    text = GOOD.replace("planner:\n", "planner:\n  <<: {speed_mps: 2.5}\n").replace("[36, 15]", "&there [36, 15]")
    config = load_config(written(tmp_path, text))
    assert (config.planner.speed_mps, config.goal_m) == (2.5, (36, 15))


def test_configuration_is_frozen() -> None:
    config = load_config(CONFIGS[0])
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.seed = 3  # type: ignore[misc]


def _resolved(schema: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    while "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rsplit("/", 1)[1]]
    return schema


def _accepts(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    """Enough of JSON Schema for this schema: anyOf, types, objects, arrays, enum and number bounds."""
    schema = _resolved(schema, root)
    if "anyOf" in schema:
        return any(_accepts(value, option, root) for option in schema["anyOf"])
    kinds: dict[str, tuple[type, ...]] = {
        "object": (dict,),
        "array": (list,),
        "string": (str,),
        "number": (int, float),
        "integer": (int,),
        "boolean": (bool,),
        "null": (type(None),),
    }
    kind = schema.get("type")
    if kind and (not isinstance(value, kinds[kind]) or (isinstance(value, bool) and kind != "boolean")):
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, dict):
        known = schema.get("properties", {})
        extra = schema.get("additionalProperties", True)
        return all(key in value for key in schema.get("required", [])) and all(
            _accepts(item, known[key], root) if key in known else extra is not False for key, item in value.items()
        )
    if isinstance(value, list):
        prefix = schema.get("prefixItems", [])
        in_size = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
        items = [*prefix, *[schema.get("items", {})] * (len(value) - len(prefix))]
        return in_size and all(_accepts(item, part, root) for item, part in zip(value, items, strict=True))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (
            value > schema.get("exclusiveMinimum", -float("inf"))
            and value >= schema.get("minimum", -float("inf"))
            and value < schema.get("exclusiveMaximum", float("inf"))
            and value <= schema.get("maximum", float("inf"))
        )
    return True


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_schema_accepts_shipped_files(path: Path) -> None:
    schema = json.loads(json.dumps(config_schema()))
    assert _accepts(yaml.safe_load(path.read_text(encoding="utf-8")), schema, schema)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("altitude_m: 8", "altitude_m: -8"),
        ("altitude_m: 8", "altitude_m: high"),
        ("altitude_m: 8", "altitude_m: 8\nunknown: 1"),
        ("  margin_m: 0.6\n", ""),
        ("start_m: [4, 15]", "start_m: [4, 15, 2]"),
        ("altitude_m: 8", "altitude_m: 8\nclock: {mode: fast}"),
    ],
)
def test_schema_and_loader_refuse_the_same_files(tmp_path: Path, old: str, new: str) -> None:
    schema = config_schema()
    assert _accepts(yaml.safe_load(GOOD), schema, schema)
    text = GOOD.replace(old, new)
    assert not _accepts(yaml.safe_load(text), schema, schema)
    with pytest.raises(InputError):
        load_config(written(tmp_path, text))


def test_schema_describes_every_field() -> None:
    assert set(config_schema()["properties"]) == {item.name for item in dataclasses.fields(RunConfig)}
