"""MovingAI grid maps (movingai.com/benchmarks/formats.html): `type`, `height`, `width`, `map`, then a row a line.

The first line is the northernmost row, so that column x and line y of a benchmark's query are the point
((x + 0.5) cell_m, (height - y - 0.5) cell_m). Terrain: `.` `G` ground, `S` swamp, `W` water, `T` trees, `@` `O` out of bounds.
"""

from pathlib import Path

import numpy as np

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.grid import Grid, check_size
from sandwich_sitl.world.importers.limits import read_text
from sandwich_sitl.world_config import ImportOptions

_TERRAIN = frozenset(".GSWT@O")


def read_moving_ai(path: Path, options: ImportOptions) -> Grid:
    """The grid, cells of `options.cell_m`. Raises `InputError` naming the line."""
    lines = read_text(path).splitlines()
    header = [line.strip() for line in lines[:4]]
    if len(header) < 4 or header[0].split()[:1] != ["type"] or header[3] != "map":
        raise InputError(f"{path}: is not a MovingAI map; its first lines must be type, height, width, map")
    rows, columns = _size(path, header[1:3])
    check_size(path, columns, rows)
    body = [line.rstrip() for line in lines[4 : 4 + rows]]
    if len(body) < rows:
        raise InputError(f"{path}: line {len(lines) + 1}: ends after {len(body)} of {rows} rows; the file is truncated")
    for number, line in enumerate(body, 5):
        if len(line) != columns:
            raise InputError(f"{path}: line {number}: has {len(line)} cells, not {columns} as the header says")
        if unknown := set(line) - _TERRAIN - set(options.passable):
            raise InputError(
                f"{path}: line {number}: {sorted(unknown)[0]!r} is no terrain; name it in passable, or use @"
            )
    passable = np.array([ord(letter) for letter in options.passable])
    cells = np.array([list(map(ord, line)) for line in reversed(body)], dtype=np.int32)
    return Grid(str(path), ~np.isin(cells, passable), np.zeros(cells.shape, dtype=bool), options.cell_m)


def _size(path: Path, lines: list[str]) -> tuple[int, int]:
    size: dict[str, int] = {}
    for number, line in enumerate(lines, 2):
        words = line.split()
        if len(words) != 2 or words[0] not in ("height", "width") or not (words[1].isdecimal() and len(words[1]) < 10):
            raise InputError(f"{path}: line {number}: must be 'height N' or 'width N', got {line[:40]!r}")
        size[words[0]] = int(words[1])
    if len(size) < 2:
        raise InputError(f"{path}: line 3: repeats line 2; give height and width")
    return size["height"], size["width"]
