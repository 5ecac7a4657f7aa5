"""The whole map: one-to-one, clear of every obstacle, covering the free ground; or refused with a reason."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import Polygon, box
from world_samples import BOUNDS, ell, grown_world, horseshoe, random_shapes

from sandwich_sitl.channels.build import build_channel_map, corner_angles
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.map_file import load_map, save_map
from sandwich_sitl.config import load_config
from sandwich_sitl.errors import InputError, MapError, NoRouteError
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.load import load_world

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
CELL_M = 1.5


def cell_corners(xy: np.ndarray) -> np.ndarray:
    return np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2).reshape(-1, 4, 2)


def check(channel_map: ChannelMap, grown: GrownWorld) -> None:
    """The laws every map keeps, measured with shapely and cross products written out here."""
    cells = np.concatenate([cell_corners(xy) for xy in channel_map.xy_m])
    onward, back = np.roll(cells, -1, axis=1) - cells, np.roll(cells, 1, axis=1) - cells
    jacobian = onward[..., 0] * back[..., 1] - onward[..., 1] * back[..., 0]
    assert (jacobian > 0).all()
    assert channel_map.quality.folded_cells == 0
    assert channel_map.quality.cells == len(cells)

    hair = 1e-6 * max(BOUNDS)
    solid = [polygon.buffer(-hair, join_style="mitre") for polygon in grown.polygons]
    ends = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)]
    lines = shapely.linestrings(np.concatenate([cells[:, pair] for pair in ends]))
    assert shapely.STRtree(solid).query(lines, predicate="intersects").size == 0

    frame = box(*grown.bounds_m).buffer(hair)
    assert shapely.covers(frame, shapely.points(cells.reshape(-1, 2))).all()
    # Convex cells of one orientation whose areas add up to the area of their union overlap nowhere.
    quads = shapely.polygons(cells)
    union = shapely.union_all(quads, grid_size=1e-9)
    assert shapely.area(quads).sum() == pytest.approx(union.area, rel=1e-6)
    free = box(*grown.bounds_m).area - sum(polygon.area for polygon in grown.polygons)
    assert channel_map.quality.coverage == pytest.approx(union.area / free, rel=1e-6)

    for d, (below, above) in enumerate(itertools.pairwise(channel_map.xy_m)):
        free_columns = ~channel_map.barred[d]
        np.testing.assert_array_equal(below[free_columns, -1], above[free_columns, 0])
        apart = (below[:, -1] != above[:, 0]).any(axis=1)
        np.testing.assert_array_equal(apart, channel_map.barred[d])
        np.testing.assert_array_equal(channel_map.barrier[d] >= 0, channel_map.barred[d])
    x_min, y_min, x_max, y_max = grown.bounds_m
    np.testing.assert_array_equal(channel_map.Psi[[0, -1]], [y_min, y_max])
    assert (np.diff(channel_map.Psi) >= 0).all()
    for xy in channel_map.xy_m:
        np.testing.assert_allclose(xy[0, :, 0], x_min, atol=1e-9)
        np.testing.assert_allclose(xy[-1, :, 0], x_max, atol=1e-9)


def check_or_refused(seed: int) -> bool:
    """Whether the seed's world was mapped; what is mapped must hold every law, and nothing else may be handed on."""
    grown = grown_world(*random_shapes(seed))
    try:
        channel_map = build_channel_map(grown, CELL_M, 5)
    except MapError:
        return False
    check(channel_map, grown)
    assert channel_map.quality.coverage > 0.98
    return True


@pytest.mark.parametrize("seed", [*range(11), *range(12, 19)])
def test_random_worlds_map_one_to_one(seed: int) -> None:
    assert check_or_refused(seed)


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_most_dense_worlds_map_and_the_others_are_refused() -> None:
    """19 to 25 obstacles, a third of them concave, on 80 m x 50 m with cells of 1.5 m: as dense as it gets."""
    mapped = [seed for seed in (11, *range(19, 26)) if check_or_refused(seed)]
    assert len(mapped) >= 5


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_worlds_map_one_to_one(path: Path) -> None:
    config = load_config(path)
    planner = config.planner
    world = load_world(config.world, path)
    grown = grow(world, planner.vehicle_radius_m + planner.margin_m, 0.1 * planner.cell_m)
    channel_map = build_channel_map(grown, planner.cell_m, planner.min_rows)
    check(channel_map, grown)
    assert channel_map.quality.coverage > 0.999
    if path.stem == "paper":
        assert channel_map.channels == 5


DEGENERATE: dict[str, tuple[Polygon, ...]] = {
    "none": (),
    "one": (box(35, 20, 45, 30),),
    "thin_upright": (box(40, 10, 40.01, 40),),
    "thin_flat": (box(20, 25, 60, 25.01),),
    "bottom": (box(30, -5, 45, 15),),
    "top": (box(30, 35, 45, 60),),
    "left": (box(-5, 20, 12, 30),),
    "right": (box(68, 20, 90, 30),),
    "corner_bottom_left": (box(-5, -5, 15, 12),),
    "corner_top_right": (box(66, 38, 90, 60),),
    "all_borders": (box(-5, 20, 8, 30), box(72, 18, 90, 28), box(30, -5, 45, 10), box(28, 42, 50, 60)),
    "all_corners": (box(-5, -5, 8, 8), box(72, -5, 90, 8), box(-5, 42, 8, 60), box(72, 42, 90, 60)),
    "corner_touching": (box(20, 15, 30, 25), box(32, 27, 42, 37)),
    "overlapping": (box(20, 15, 35, 25), box(30, 20, 45, 30)),
    "chain": tuple(box(6 + 12 * k, 22 + (k % 2) * 3, 13 + 12 * k, 27 + (k % 2) * 3) for k in range(6)),
    "stack": tuple(box(35, 4 + 9 * k, 45, 8 + 9 * k) for k in range(5)),
    "same_left_ends": (box(30, 8, 40, 14), box(30, 30, 45, 38)),
    "pocket_up": (horseshoe(40, 25, 14, 0),),
    "pocket_down": (horseshoe(40, 25, 14, 180),),
    "pocket_left": (horseshoe(40, 25, 14, 90),),
    "pocket_right": (horseshoe(40, 25, 14, -90),),
    "ell": (ell(40, 25, 16, 0),),
    "diamond": (Polygon([(40, 15), (50, 25), (40, 35), (30, 25)]),),
    "in_pocket": (horseshoe(40, 25, 24, 90), box(38, 23, 42, 27)),
    "interlocked": (horseshoe(35, 25, 20, -90), box(33, 23, 60, 26)),
    "left_to_right": (box(-5, 22, 90, 26),),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_worlds_map_one_to_one(name: str) -> None:
    grown = grown_world(*DEGENERATE[name])
    channel_map = build_channel_map(grown, CELL_M, 5)
    check(channel_map, grown)
    assert channel_map.quality.coverage > 0.9


def test_open_world_is_the_identity() -> None:
    channel_map = build_channel_map(grown_world(), 1.0, 5)
    assert channel_map.channels == 1
    (xy,) = channel_map.xy_m
    x, y = np.meshgrid(np.linspace(0, 80, xy.shape[0]), np.linspace(0, 50, xy.shape[1]), indexing="ij")
    np.testing.assert_allclose(xy, np.stack([x, y], axis=-1), atol=1e-9)
    assert channel_map.quality.mean_angle_error_deg < 1e-6
    np.testing.assert_allclose(channel_map.psi_rows(0), y[0])


def test_reported_quality_is_what_the_grid_has() -> None:
    channel_map = build_channel_map(grown_world(*random_shapes(12)), CELL_M, 5)
    angles = np.concatenate([corner_angles(xy).ravel() for xy in channel_map.xy_m])
    assert channel_map.quality.min_jacobian_ratio == pytest.approx(np.sin(angles).min())
    assert channel_map.quality.min_angle_deg == pytest.approx(np.degrees(angles.min()))
    np.testing.assert_allclose(corner_angles(channel_map.xy_m[0]).sum(axis=-1), 2 * np.pi, atol=1e-9)


def test_mirrored_world_keeps_the_laws_and_the_number_of_channels() -> None:
    shapes = random_shapes(13)
    mirrored = [shapely.transform(shape, lambda xy: xy * (1, -1) + (0, BOUNDS[3])) for shape in shapes]
    here, there = grown_world(*shapes), grown_world(*mirrored)
    a, b = build_channel_map(here, CELL_M, 5), build_channel_map(there, CELL_M, 5)
    check(b, there)
    assert a.channels == b.channels


def test_barrier_indices_name_the_obstacle_at_the_wall() -> None:
    grown = grown_world(box(20, 10, 30, 16), box(50, 30, 60, 36), horseshoe(60, 13, 12, 180))
    channel_map = build_channel_map(grown, CELL_M, 5)
    walls = 0
    for d in range(channel_map.channels - 1):
        for i in np.flatnonzero(channel_map.barred[d]):
            middle = (channel_map.xy_m[d][i, -1] + channel_map.xy_m[d + 1][i, 0]) / 2
            polygon = grown.polygons[channel_map.barrier[d, i]]
            assert polygon.distance(shapely.Point(middle)) < CELL_M
            walls += 1
    assert walls > 10


def test_barrier_indices_survive_closed_pockets() -> None:
    """A yard too deep to map is closed; its walls still carry the index of the obstacle in the world that was given."""
    yard = box(30, 12, 56, 38).difference(box(32, 14, 54, 36)).difference(box(50, 23.7, 57, 26.3))
    grown = grown_world(box(8, 8, 14, 14), yard, box(66, 30, 72, 36))
    channel_map = build_channel_map(grown, CELL_M, 5, ((4.0, 40.0), (76.0, 10.0)))
    assert channel_map.quality.coverage < 0.95
    for d in range(channel_map.channels - 1):
        for i in np.flatnonzero(channel_map.barred[d]):
            polygon = grown.polygons[channel_map.barrier[d, i]]
            for wall in (channel_map.xy_m[d][i, -1], channel_map.xy_m[d + 1][i, 0]):
                assert polygon.distance(shapely.Point(wall)) < 2.0


@pytest.mark.parametrize("shape", [box(35, -5, 45, 60), Polygon([(30, -5), (50, -5), (45, 60), (40, 60)])])
def test_world_split_in_two_names_the_obstacle(shape: Polygon) -> None:
    with pytest.raises(NoRouteError, match="'o1' reaches from the bottom to the top border"):
        build_channel_map(grown_world(box(10, 10, 14, 14), shape), CELL_M, 5)


def test_world_split_by_two_united_obstacles_names_both() -> None:
    with pytest.raises(NoRouteError, match=r"'o0\+o1' reaches"):
        build_channel_map(grown_world(box(35, -5, 45, 25), box(35, 26, 45, 60)), CELL_M, 5)


def test_map_that_stays_folded_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the mend a world whose central differences fold has no map, and none is handed on."""
    from sandwich_sitl.channels import build
    from sandwich_sitl.channels.untangle import Untangled

    def unmended(xy: np.ndarray, least_sine: float) -> Untangled:
        return Untangled(xy, np.full((xy.shape[0] - 1, xy.shape[1] - 1), least_sine < 0))

    monkeypatch.setattr(build, "untangle", unmended)
    with pytest.raises(MapError, match=r"channel \d+: \d+ of \d+ cells stay folded.*planner\.cell_m"):
        build_channel_map(grown_world(Polygon([(40, 5), (41, 44), (38, 44)])), CELL_M, 5)


def test_saved_map_loads_identically(tmp_path: Path) -> None:
    channel_map = build_channel_map(grown_world(*random_shapes(8)), CELL_M, 5)
    path = tmp_path / "map.npz"
    save_map(channel_map, path)
    loaded = load_map(path)
    assert (loaded.bounds_m, loaded.quality) == (channel_map.bounds_m, channel_map.quality)
    assert (loaded.channels, loaded.nodes) == (channel_map.channels, channel_map.nodes)
    for a, b in zip(
        (*loaded.xy_m, loaded.barred, loaded.barrier, loaded.Psi, loaded.phi),
        (*channel_map.xy_m, channel_map.barred, channel_map.barrier, channel_map.Psi, channel_map.phi),
        strict=True,
    ):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_files_that_are_no_map(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    with pytest.raises(InputError, match="cannot be read"):
        load_map(path)
    for data in (b"", b"no map", b"PK\x03\x04 broken"):
        path.write_bytes(data)
        with pytest.raises(InputError, match="is not a channel map"):
            load_map(path)
    np.savez(path, header=np.array("{}"))
    with pytest.raises(InputError, match="is not a channel map"):
        load_map(path)
    np.savez(path, header=np.array('{"format": 99}'))
    with pytest.raises(InputError, match="format 99"):
        load_map(path)
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(InputError, match="is not a channel map"):
        load_map(tmp_path / "one.npy")
    with pytest.raises(InputError, match="cannot be written"):
        save_map(build_channel_map(grown_world(), 5.0, 5), tmp_path / "none" / "map.npz")
