"""Stretches that will not unfold give way to bays: same ground, same nodes on the outline, no fold left."""

import numpy as np
import pytest
import shapely
from shapely import Polygon

from sandwich_sitl.channels.stretches import without_folds
from sandwich_sitl.channels.untangle import corner_sines

M, N = 31, 9


def channel() -> np.ndarray:
    """Unit cells, 30 by 8."""
    return np.stack(np.meshgrid(np.arange(M), np.arange(N), indexing="ij"), axis=-1).astype(float)


def folded(*columns: int) -> np.ndarray:
    xy = channel()
    for i in columns:
        xy[i, 4] = xy[i, 4] + (1.5, 0.0)
    return xy


def outline(xy: np.ndarray) -> Polygon:
    return Polygon(np.concatenate([xy[:, 0], xy[-1, 1:], xy[-2::-1, -1], xy[0, -2:0:-1]]))


@pytest.mark.parametrize(
    ("columns", "runs"),
    [((10,), 1), ((10, 20), 2), ((10, 12), 1), ((1,), 1), ((M - 3,), 1), (tuple(range(1, M - 2, 2)), 1)],
)
def test_ground_is_kept_and_no_fold_is_left(columns: tuple[int, ...], runs: int) -> None:
    xy = folded(*columns)
    assert (corner_sines(xy) <= 0).any()
    sound = without_folds(xy, "channel 1", 1.0)
    assert len(sound.bays) == runs
    sines = corner_sines(sound.xy_m)
    assert (sines[sound.gridded] > 0).all()
    corners = np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2)[sound.gridded].reshape(-1, 4, 2)
    parts = [shapely.polygons(corners), *(shapely.polygons(bay.corners_m()) for bay in sound.bays)]
    cells = np.concatenate(parts)
    assert shapely.area(cells).sum() == pytest.approx(outline(channel()).area)
    assert shapely.union_all(cells, grid_size=1e-9).symmetric_difference(outline(channel())).area < 1e-6


def test_bay_shares_the_nodes_of_its_outline() -> None:
    xy = folded(10, 20)
    sound = without_folds(xy, "channel 7", 1.0)
    for bay in sound.bays:
        assert "channel 7" in bay.name
        x = bay.xy_m[:, 0]
        start, end = int(x.min()), int(x.max())
        assert not sound.gridded[start:end].any()
        assert sound.gridded[[start - 1, end]].all()
        ring = {(x, y) for i in range(start, end + 1) for x, y in xy[i, [0, -1]].tolist()}
        ring |= {(x, y) for i in (start, end) for x, y in xy[i].tolist()}
        assert {(x, y) for x, y in bay.xy_m[bay.lid_nodes].tolist()} == ring


def test_nodes_without_cells_are_nan_and_no_others() -> None:
    sound = without_folds(folded(10), "channel 1", 1.0)
    gridded = sound.gridded
    has_cell = np.concatenate([gridded, [False]]) | np.concatenate([[False], gridded])
    np.testing.assert_array_equal(np.isnan(sound.xy_m[:, 1:-1]).any(axis=(1, 2)), ~has_cell)
    assert not np.isnan(sound.xy_m[:, [0, -1]]).any()


def test_sound_channel_is_left_alone() -> None:
    xy = channel()
    sound = without_folds(xy, "channel 1", 1.0)
    np.testing.assert_array_equal(sound.xy_m, xy)
    assert sound.gridded.all()
    assert sound.bays == ()
