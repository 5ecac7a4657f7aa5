"""Meshes of bays: they fill their polygon with convex quads, edge to edge, and put nodes on their lids."""

from collections import Counter

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box
from world_samples import ell, horseshoe, needle, spiral

from sandwich_sitl.channels.bays import Bay, mesh_bay, mesh_ground

NO_LIDS = np.empty((0, 2, 2))
CELL_M = 1.0
SHAPES = {
    "square": box(0, 0, 12, 12),
    "street": box(0, 0, 30, 1.2),
    "ell": ell(0, 0, 14, 30),
    "horseshoe": horseshoe(0, 0, 20, 15),
    "spiral": spiral(0, 0, 3, 2, 9, 0),
    "needle": needle(0, 0, 20, 1.5, 40),
    "with a hole": box(0, 0, 20, 14).difference(box(6, 4, 13, 9)),
    "hole in a corner": box(0, 0, 20, 14).difference(Polygon([(1, 1), (7, 1.5), (2, 6)])),
}


def sides(bay: Bay) -> Counter[frozenset[int]]:
    """How many quads each side belongs to."""
    return Counter(
        frozenset((int(a), int(b))) for quad in bay.quads for a, b in zip(quad, np.roll(quad, -1), strict=True)
    )


def check_mesh(bay: Bay, polygon: Polygon) -> None:
    quads = [Polygon(corners) for corners in bay.corners_m()]
    assert sum(quad.area for quad in quads) == pytest.approx(polygon.area, rel=1e-9)
    assert shapely.union_all(quads, grid_size=1e-7).symmetric_difference(polygon).area < 1e-5 * polygon.area
    corners = bay.corners_m()
    onward, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    assert (onward[..., 0] * back[..., 1] - onward[..., 1] * back[..., 0] > 0).all()
    uses = sides(bay)
    assert set(uses.values()) <= {1, 2}
    outer = [LineString(bay.xy_m[list(side)]) for side, count in uses.items() if count == 1]
    assert sum(line.length for line in outer) == pytest.approx(polygon.length, rel=1e-9)
    assert polygon.boundary.buffer(1e-9).covers(shapely.union_all(outer))
    assert len(np.unique(bay.quads)) == len(bay.xy_m)
    assert len(np.unique(bay.xy_m, axis=0)) == len(bay.xy_m)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("cell_m", [0.4, 3.0])
def test_mesh_fills_its_polygon_edge_to_edge(name: str, cell_m: float) -> None:
    check_mesh(mesh_bay(name, SHAPES[name], NO_LIDS, cell_m), SHAPES[name])


@pytest.mark.parametrize("seed", range(25))
def test_mesh_fills_random_star_shaped_polygons(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(4, 30)))
    angle = angle[np.concatenate([[True], np.diff(angle) > 0.02])]
    radius = rng.uniform(1, 10, len(angle))
    polygon = Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])).buffer(0)
    check_mesh(
        mesh_bay("star", max(shapely.get_parts(polygon), key=shapely.area), NO_LIDS, CELL_M),
        max(shapely.get_parts(polygon), key=shapely.area),
    )


def test_cells_have_about_the_size_asked_for() -> None:
    for cell_m in (0.3, 0.6, 1.2):
        bay = mesh_bay("square", box(0, 0, 15, 15), NO_LIDS, cell_m)
        mean = 225 / len(bay.quads)
        assert 0.5 * cell_m**2 < mean < 1.5 * cell_m**2
        assert max(shapely.area(shapely.polygons(bay.corners_m()))) < 2 * cell_m**2


def test_lid_nodes_are_all_nodes_on_the_lids_and_share_their_coordinate_exactly() -> None:
    polygon = box(0.1, 0.3, 12.7, 9.1)
    lids = np.array([[[0.1, 9.1], [12.7, 9.1]], [[12.7, 0.3], [12.7, 9.1]]])
    bay = mesh_bay("yard", polygon, lids, CELL_M)
    lines = shapely.union_all([LineString(lid) for lid in lids])
    on_lid = shapely.distance(lines, shapely.points(bay.xy_m)) < 1e-9
    np.testing.assert_array_equal(bay.lid_nodes, np.flatnonzero(on_lid))
    top = bay.xy_m[bay.xy_m[:, 1] > 9.1 - 1e-6]
    np.testing.assert_array_equal(top[:, 1], 9.1)
    assert len(top) > 5


def test_stretch_has_its_outline_as_lid_nodes() -> None:
    t = np.linspace(0, 1, 9)
    outline = np.concatenate(
        [
            np.column_stack([8 * t, np.sin(3 * t)])[:-1],
            np.column_stack([8 + 0.3 * np.sin(np.pi * t), np.sin(3) + 4 * t])[:-1],
            np.column_stack([8 - 8 * t, np.sin(3) + 4 + 0 * t])[:-1],
            np.column_stack([0 * t, (np.sin(3) + 4) * (1 - t)])[:-1],
        ]
    )
    bay = mesh_ground("stretch", Polygon(outline), {(x, y) for x, y in outline.tolist()}, CELL_M)
    check_mesh(bay, Polygon(outline))
    assert {tuple(xy) for xy in bay.xy_m[bay.lid_nodes].tolist()} == {tuple(xy) for xy in outline.tolist()}
