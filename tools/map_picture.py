"""Draw the channel map of any map that is read: `python tools/map_picture.py FILE --cell 1 --out map.png`.

FILE is a run's YAML, or a map file of any format that `sandwich-sitl world` reads; `--set` takes the same keys. Flags
left out are a run's own values, or the defaults below for a map file. The exit status is 4 when the map fails its check.
"""

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import shapely
from pydantic import TypeAdapter, ValidationError

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.check import examine
from sandwich_sitl.channels.flow import flow_along
from sandwich_sitl.config import PlannerConfig, load_config
from sandwich_sitl.errors import InputError, SandwichError
from sandwich_sitl.options import check_writable, overrides_of, positive
from sandwich_sitl.viewing.map_picture import draw_map
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.importers import read_world
from sandwich_sitl.world.load import load_world
from sandwich_sitl.world.world import World
from sandwich_sitl.world_config import WorldConfig, for_vehicle
from sandwich_sitl.yaml_document import dotted, first_problem, is_run_file, put

_DETAIL = 0.15  # of the cell and of the margin, as in a run
_CELLS = 150  # along the longer side, where nothing says otherwise


def main(argv: Sequence[str] | None = None) -> int:
    """Returns the exit status: 0 drawn, 2 bad input, 4 drawn but the check failed, with the failures on stderr."""
    options = _parser().parse_args(argv)
    try:
        check_writable("--out", options.out)
        world, planner = _world(options)
        x_min, y_min, x_max, y_max = world.bounds_m
        reach = planner.vehicle_radius_m + planner.margin_m
        grown = grow(world, reach, _DETAIL * min(planner.cell_m, planner.margin_m))
        along = flow_along((x_min, y_min), (x_max, y_max)) if planner.flow == "auto" else planner.flow
        channel_map = build_channel_map(grown, planner.cell_m, planner.min_rows, along)
        rings = [shapely.get_coordinates(o.polygon.exterior)[:-1] for o in world.obstacles]
        draw_map(channel_map, rings, options.out, options.title or options.file.stem)
    except SandwichError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    failures = examine(channel_map).failures
    for failure in failures:
        print(f"{options.file}: {failure}", file=sys.stderr)
    return 4 if failures else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Draw the channel map of a map file or a run.")
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.png")
    parser.add_argument("--cell", type=positive, metavar="M", help="cell size")
    parser.add_argument("--radius", type=positive, metavar="M", help="of the vehicle (default 0.4)")
    parser.add_argument("--margin", type=positive, metavar="M", help="kept beyond the radius (default 0.6)")
    parser.add_argument("--flow", choices=("x", "y"), help="axis of the channels (default: the longer side)")
    parser.add_argument("--title", help="over the picture (default: the file's name)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="an import option, as gap_m=1.5"
    )
    return parser


def _world(options: argparse.Namespace) -> tuple[World, PlannerConfig]:
    """The world, and the planner section with the flags that were given."""
    given = {
        "cell_m": options.cell,
        "vehicle_radius_m": options.radius,
        "margin_m": options.margin,
        "flow": options.flow,
    }
    changes = {key: value for key, value in given.items() if value is not None}
    overrides = overrides_of(options.set)
    if is_run_file(options.file):
        config = load_config(options.file, overrides | {f"planner.{key}": value for key, value in changes.items()})
        return load_world(config.world, options.file), config.planner
    planner = PlannerConfig(**({"vehicle_radius_m": 0.4, "margin_m": 0.6} | changes))
    data: dict[str, Any] = {"file": str(options.file)}
    try:
        for key, value in overrides.items():
            put(data, key, value)
        section = TypeAdapter(WorldConfig).validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        loc, text = first_problem(error)
        raise InputError(f"--set {dotted(loc)}: {text}") from error
    world = read_world(options.file, for_vehicle(section, planner.vehicle_radius_m, planner.margin_m)).world
    if options.cell is None:
        x_min, y_min, x_max, y_max = world.bounds_m
        planner = dataclasses.replace(planner, cell_m=max(x_max - x_min, y_max - y_min) / _CELLS)
    return world, planner


if __name__ == "__main__":
    sys.exit(main())
