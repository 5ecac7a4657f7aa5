"""The whole map: one-to-one, clear of every obstacle, covering the free ground, in every kind of world."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from map_laws import check_laws, check_lookup, check_residual, free_points, map_quads
from shapely import Polygon, box
from world_samples import BOUNDS, QUICK, ell, grown_world, horseshoe, random_shapes, sample_world, yard

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import Flow
from sandwich_sitl.channels.check import examine
from sandwich_sitl.config import load_config
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.load import load_world

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
CELL_M = 1.7
FLOWS: tuple[Flow, ...] = ("x", "y")

HAND_MADE = {
    "touching": (box(20, 10, 30, 20), box(30, 15, 40, 25)),
    "touching at a corner": (box(20, 10, 30, 20), box(32, 22, 42, 32)),
    "chain": tuple(box(6 + 12 * k, 22 + (k % 2) * 3, 13 + 12 * k, 27 + (k % 2) * 3) for k in range(6)),
    "stack": tuple(box(35, 4 + 9 * k, 45, 8 + 9 * k) for k in range(5)),
    "same left ends": (box(30, 8, 40, 14), box(30, 30, 45, 38)),
    "pocket up": (horseshoe(40, 25, 14, 0),),
    "pocket down": (horseshoe(40, 25, 14, 180),),
    "pocket left": (horseshoe(40, 25, 14, 90),),
    "pocket right": (horseshoe(40, 25, 14, -90),),
    "ell": (ell(40, 25, 16, 0),),
    "diamond": (Polygon([(40, 15), (50, 25), (40, 35), (30, 25)]),),
    "in a pocket": (horseshoe(40, 25, 24, 90), box(38, 23, 42, 27)),
    "interlocked": (horseshoe(35, 25, 20, -90), box(38, 23.5, 60, 26.5)),
    "left to right": (box(-5, 22, 90, 26),),
    "wedge on the left border": (Polygon([(-3, 10), (3, 40), (-3, 44)]), box(30, 6, 40, 10)),
    "wedge on the right border": (Polygon([(83, 10), (77, 40), (83, 44)]), box(30, 6, 40, 10)),
    "bottom to top": (box(38, -5, 42, 60),),
    "frame with a door": (yard(40, 25, 60, 2, 6, 0),),
    "three sides of the border": (box(-5, -5, 90, 3), box(-5, -5, 3, 60), box(77, -5, 90, 60)),
    "almost nothing free": (box(-5, -5, 90, 23), box(-5, 27, 90, 60)),
    "nothing free": (box(-5, -5, 90, 60),),
}


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("name", HAND_MADE)
def test_hand_made_worlds_keep_the_laws(name: str, flow: Flow) -> None:
    channel_map = build_channel_map(grown_world(*HAND_MADE[name]), CELL_M, 5, flow)
    check_laws(channel_map)
    assert examine(channel_map).failures == ()


@pytest.mark.parametrize("seed", QUICK.values(), ids=list(QUICK))
def test_world_of_every_family_keeps_the_laws(seed: int) -> None:
    sample = sample_world(seed)
    cell_m = max(1.3, sample.cell_m)
    channel_map = build_channel_map(sample.grown, cell_m, 5, sample.flow)
    check_laws(channel_map)
    check_residual(channel_map, cell_m)
    check_lookup(channel_map, free_points(channel_map, 40, seed))
    assert examine(channel_map).failures == ()


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_worlds_keep_the_laws(path: Path) -> None:
    config = load_config(path)
    planner = config.planner
    grown = grow(load_world(config.world, path), planner.vehicle_radius_m + planner.margin_m, 0.1)
    check_laws(build_channel_map(grown, max(1.0, planner.cell_m), planner.min_rows))


@pytest.mark.parametrize("seed", [6, 12, 25])
def test_channels_keep_the_frame_of_the_paper(seed: int) -> None:
    """Columns end at the two flow borders, rows at the others; stream values rise from border to border."""
    channel_map = build_channel_map(grown_world(*random_shapes(seed)), CELL_M, 5)
    x_min, y_min, x_max, y_max = BOUNDS
    for xy, gridded in zip(channel_map.xy_m, channel_map.gridded, strict=True):
        assert xy.shape[0] == len(channel_map.phi)
        assert xy.shape[1] >= 5
        for column, x in ((0, x_min), (-1, x_max)):
            if gridded[column]:
                np.testing.assert_allclose(xy[column, :, 0], x, atol=1e-9)
    np.testing.assert_array_equal(channel_map.Psi[[0, -1]], [y_min, y_max])
    assert (np.diff(channel_map.Psi) >= 0).all()
    np.testing.assert_array_equal(channel_map.phi[[0, -1]], [x_min, x_max])
    walls = [polygon.exterior for polygon in channel_map.grown.polygons]
    border = shapely.union_all([shapely.LineString([(x_min, y), (x_max, y)]) for y in (y_min, y_max)] + walls)
    bays = shapely.union_all([shapely.union_all(shapely.polygons(bay.corners_m())) for bay in channel_map.bays])
    for side in (channel_map.xy_m[0][:, 0], channel_map.xy_m[-1][:, -1]):
        points = shapely.points(side)
        assert (np.fmin(shapely.distance(border, points), shapely.distance(bays, points)) < 1e-6).all()


def test_open_world_is_the_identity() -> None:
    channel_map = build_channel_map(grown_world(), 1.0, 5)
    assert channel_map.channels == 1
    (xy,) = channel_map.xy_m
    x, y = np.meshgrid(np.linspace(0, 80, xy.shape[0]), np.linspace(0, 50, xy.shape[1]), indexing="ij")
    np.testing.assert_allclose(xy, np.stack([x, y], axis=-1), atol=1e-9)
    quality = channel_map.quality
    assert quality.mean_angle_error_deg < 1e-6
    assert quality.coverage == pytest.approx(1.0)
    assert quality.median_edge_m == pytest.approx(1.0, rel=0.1)
    np.testing.assert_allclose(channel_map.psi_rows(0), y[0])


@pytest.mark.parametrize("cell_m", [0.7, 1.5, 3.0])
def test_cells_have_about_the_size_asked_for(cell_m: float) -> None:
    channel_map = build_channel_map(grown_world(*random_shapes(8)), cell_m, 5)
    assert 0.6 * cell_m < channel_map.quality.median_edge_m < 1.4 * cell_m


def test_reported_quality_is_what_the_cells_have() -> None:
    channel_map = build_channel_map(grown_world(*random_shapes(12)), CELL_M, 5)
    quads = map_quads(channel_map)
    a, b, c = np.roll(quads, 1, axis=1), quads, np.roll(quads, -1, axis=1)
    to_a, to_c = a - b, c - b
    cosine = (to_a * to_c).sum(axis=-1) / np.hypot(*np.moveaxis(to_a, -1, 0)) / np.hypot(*np.moveaxis(to_c, -1, 0))
    angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    np.testing.assert_allclose(angles.sum(axis=1), 360, atol=1e-4)
    assert channel_map.quality.min_angle_deg == pytest.approx(angles.min(), abs=1e-4)
    assert channel_map.quality.min_jacobian_ratio == pytest.approx(np.sin(np.radians(angles)).min(), abs=1e-6)
    assert channel_map.quality.mean_angle_error_deg == pytest.approx(np.abs(angles - 90).mean(), abs=1e-6)


def test_mirrored_world_keeps_the_laws_and_the_number_of_channels() -> None:
    shapes = random_shapes(13)
    mirrored = [shapely.transform(shape, lambda xy: xy * (1, -1) + (0, BOUNDS[3])) for shape in shapes]
    here = build_channel_map(grown_world(*shapes), CELL_M, 5)
    there = build_channel_map(grown_world(*mirrored), CELL_M, 5)
    check_laws(there)
    assert here.channels == there.channels


def test_building_twice_gives_the_same_bytes() -> None:
    grown = grown_world(*random_shapes(17))
    one, other = (build_channel_map(grown, CELL_M, 5) for _ in range(2))
    assert [xy.tobytes() for xy in one.xy_m] == [xy.tobytes() for xy in other.xy_m]
    assert [bay.xy_m.tobytes() for bay in one.bays] == [bay.xy_m.tobytes() for bay in other.bays]
    assert one.quality == other.quality


def test_barrier_indices_name_the_obstacle_at_the_wall() -> None:
    grown = grown_world(box(20, 10, 30, 16), box(50, 30, 60, 36), Polygon([(60, 8), (70, 14), (58, 18)]))
    channel_map = build_channel_map(grown, CELL_M, 5)
    walls = 0
    for d in range(channel_map.channels - 1):
        for i in np.flatnonzero(channel_map.barred[d]):
            polygon = grown.polygons[channel_map.barrier[d, i]]
            for wall in (channel_map.xy_m[d][i, -1], channel_map.xy_m[d + 1][i, 0]):
                assert polygon.exterior.distance(shapely.Point(wall)) < 1e-9 * 80
                walls += 1
    assert walls > 20


def test_world_split_across_the_flow_has_no_channels_and_is_mapped_as_bays() -> None:
    channel_map = build_channel_map(grown_world(box(10, 10, 14, 14), box(35, -5, 45, 60)), CELL_M, 5)
    assert channel_map.channels == 0
    assert len(channel_map.bays) == 2
    check_laws(channel_map)


def test_least_number_of_rows_is_kept_in_narrow_channels() -> None:
    grown = grown_world(box(20, 10, 60, 24.9), box(20, 28.1, 60, 40))
    for min_rows in (5, 9):
        channel_map = build_channel_map(grown, 2.0, min_rows)
        assert min(xy.shape[1] for xy in channel_map.xy_m) >= min_rows
        check_laws(channel_map)
