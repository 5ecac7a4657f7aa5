"""Occupancy grids: no obstacle cell is lost, free ground stays free, and no passage a disc takes is closed."""

import math

import numpy as np
import pytest
import scipy.ndimage
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import Point, Polygon, box

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers import ImportOptions
from sandwich_sitl.world.importers import outline as outline_module
from sandwich_sitl.world.importers.grid import Grid, grid_world
from sandwich_sitl.world.importers.notches import fill_notches
from sandwich_sitl.world.importers.outline import outlines, without_holes

Cells = NDArray[np.bool_]


def blobs(seed: int, size: int = 26, smooth: float = 1.2, level: float = 0.1) -> Cells:
    noise = scipy.ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(size, size)), smooth)
    return np.asarray(noise > level * noise.std(), dtype=bool)


def grid(rows: list[str], **kwargs: object) -> Grid:
    """Rows as drawn, north first: # solid, ? unknown, anything else free."""
    cells = np.array([list(row) for row in reversed(rows)])
    return Grid("drawn", cells == "#", cells == "?", kwargs.pop("cell_m", 1.0), **kwargs)  # type: ignore[arg-type]


def squares(cells: Cells) -> list[Polygon]:
    return [box(x, y, x + 1, y + 1) for y, x in np.argwhere(cells)]


def room_for_disc(solid: shapely.Geometry, frame: Polygon, radius: float) -> list[Polygon]:
    """Connected sets of middles of a disc that touches nothing solid."""
    free = frame.difference(solid.buffer(radius, quad_segs=24))
    return [part for part in shapely.get_parts(free) if part.area > 1e-6]


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.8, 1.2, 2.5]))
@settings(max_examples=40, deadline=None)
def test_outlines_cover_the_solid_cells_exactly(seed: int, smooth: float) -> None:
    cells = blobs(seed, 14, smooth)
    faces = outlines("test", cells)
    pieces = [piece for face in faces for piece in without_holes(face)]
    assert all(piece.is_valid and not piece.interiors for piece in pieces)
    assert sum(piece.area for piece in pieces) == cells.sum()
    assert shapely.union_all(pieces).symmetric_difference(shapely.union_all(squares(cells))).area == 0
    assert len(faces) == scipy.ndimage.label(cells)[1]


@given(st.integers(0, 10_000), st.sampled_from([0.6, 0.999, 1.7]), st.sampled_from([0.0, 0.7, 1.5, 2.6, 4.0]))
@settings(max_examples=60, deadline=None)
def test_simplifying_keeps_cells_free_ground_and_passages(seed: int, tolerance: float, gap: float) -> None:
    cells = blobs(seed)
    pieces = [piece for face in outlines("test", cells) for piece in without_holes(face)]
    simple = fill_notches(pieces, tolerance, gap)
    solid, before = shapely.union_all(simple), shapely.union_all(pieces)
    assert all(polygon.is_valid for polygon in simple)
    assert before.difference(solid).area < 1e-9
    # Rounded up: the arcs of the buffer are chords.
    assert solid.difference(before.buffer(1.002 * tolerance, quad_segs=32)).area < 1e-9
    shapely.prepare(solid)
    for y, x in np.argwhere(~cells):
        middle = Point(x + 0.5, y + 0.5)
        if middle.distance(before) > tolerance:
            assert not solid.contains(middle)
    # Rounded down: a disc's outline is made of 96 chords.
    radius = 0.49 * gap
    if radius > 0:
        frame = box(-5, -5, 31, 31)
        rooms = room_for_disc(solid, frame, radius)
        for room in room_for_disc(before, frame, radius):
            inside = [part for part in rooms if part.intersection(room).area > 1e-6]
            deep = room.difference(before.buffer(radius + tolerance + 0.01)).area > 0
            assert len(inside) <= 1
            assert inside or not deep


def test_slanted_walls_lose_their_steps() -> None:
    rows, columns = np.mgrid[0:60, 0:60]
    cells = (np.abs(rows - 0.37 * columns - 20) < 4) | (np.hypot(rows - 45, columns - 15) < 9)
    pieces = outlines("test", cells)
    simple = fill_notches(pieces, 0.999, 2.0)
    corners = [sum(len(p.exterior.coords) - 1 for p in polygons) for polygons in (pieces, simple)]
    assert corners[1] < corners[0] / 2.4


def test_a_slanted_corridor_one_cell_wide_is_left_alone() -> None:
    """Chords on both its sides would leave a tenth of a cell."""
    for width, changed in ((1, False), (4, True)):
        cells = np.ones((14, 60), dtype=bool)
        for column in range(60):
            cells[1 + column // 10 : 1 + column // 10 + width, max(0, column - 1) : column + 1] = False
        pieces = [piece for face in outlines("test", cells) for piece in without_holes(face)]
        simple = fill_notches(pieces, 0.999, 0.9)
        assert (shapely.union_all(simple).area > cells.sum()) == changed


def test_cells_that_meet_at_a_corner_are_two_obstacles_without_a_gap() -> None:
    imported = grid_world(grid([".....", ".#...", "..#..", "....."]), "test", ImportOptions(simplify_m=0))
    first, second = (o.polygon for o in imported.world.obstacles)
    assert first.distance(second) == 0
    assert first.intersection(second).area == 0


def test_free_cells_that_meet_at_a_corner_are_not_connected() -> None:
    imported = grid_world(grid(["....", ".##.", "#.#.", "###."]), "test", ImportOptions())
    assert imported.report.grid is not None
    assert imported.report.grid.enclosed_cells == 1
    assert any(o.polygon.covers(Point(1.5, 1.5)) for o in imported.world.obstacles)


def test_a_walled_room_keeps_its_inside_and_gives_up_other_rooms() -> None:
    rows = [
        "????????????",
        "?##########?",
        "?#......#.#?",
        "?#.##...#.#?",
        "?#......#.#?",
        "?##########?",
        "????????????",
    ]
    imported = grid_world(grid(rows, cell_m=0.5), "test", ImportOptions())
    world, facts = imported.world, imported.report.grid
    assert world.bounds_m == (1.0, 1.0, 4.0, 2.5)
    assert facts is not None
    assert (facts.enclosed_cells, facts.unknown_cells) == (3, 34)
    solid = shapely.union_all([o.polygon for o in world.obstacles])
    assert solid.intersection(box(*world.bounds_m)).area == pytest.approx(2 * 0.25)
    assert all(not o.polygon.interiors for o in world.obstacles)
    other = grid_world(grid(rows, cell_m=0.5), "test", ImportOptions(inside_m=(4.75, 2.0))).world
    assert other.bounds_m == (4.5, 1.0, 5.0, 2.5)


def test_bounds_enclose_where_a_vehicle_fits() -> None:
    rows = ["#" * 12, *["#" + "." * 10 + "#"] * 6, "#####.######", "#####.######", "############"]
    wide = grid_world(grid(rows), "test", ImportOptions()).world.bounds_m
    fits = grid_world(grid(rows), "test", ImportOptions(clearance_m=1.0)).world.bounds_m
    assert wide == (1, 1, 11, 9)
    np.testing.assert_allclose(fits, (2, 4, 10, 8), atol=0.02)
    with pytest.raises(InputError, match=r"clearance_m"):
        grid_world(grid(rows), "test", ImportOptions(clearance_m=4.0))


def test_a_quarter_turn_puts_columns_north() -> None:
    """Hand-computed: column 2, row 0 from (10, 20), turned by +90 degrees, spans x 9..10 and y 22..23."""
    turned = grid(["....", "..#."], origin_m=(10.0, 20.0), yaw_rad=math.pi / 2)
    (obstacle,) = grid_world(turned, "test", ImportOptions(unknown_is_free=True)).world.obstacles
    np.testing.assert_allclose(obstacle.polygon.bounds, (9, 22, 10, 23), atol=1e-12)


def test_ground_beside_a_turned_image_is_unknown() -> None:
    turned = grid(["...", "...", "..."], yaw_rad=math.pi / 4)
    world = grid_world(turned, "test", ImportOptions()).world
    assert sum(o.polygon.area for o in world.obstacles) == pytest.approx(9.0)
    assert not grid_world(turned, "test", ImportOptions(unknown_is_free=True)).world.obstacles


def test_grids_that_cannot_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no free cell"):
        grid_world(grid(["##", "#?"]), "test", ImportOptions())
    with pytest.raises(InputError, match="inside_m"):
        grid_world(grid(["#.", ".."]), "test", ImportOptions(inside_m=(0.5, 1.5)))
    with pytest.raises(InputError, match="inside_m"):
        grid_world(grid(["#.", ".."]), "test", ImportOptions(inside_m=(50, 1.5)))
    with pytest.raises(InputError, match="metres"):
        grid_world(grid(["#."], origin_m=(1e9, 0.0)), "test", ImportOptions())
    monkeypatch.setattr(outline_module, "MAX_GRID_CORNERS", 50)
    with pytest.raises(InputError, match="filter the noise"):
        outlines("test", blobs(1))


def test_a_grid_without_obstacles_is_an_open_world() -> None:
    world = grid_world(grid(["...", "..."]), "test", ImportOptions()).world
    assert (world.bounds_m, world.obstacles) == ((0, 0, 3, 2), ())
