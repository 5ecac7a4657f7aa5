"""The picture of a map shows channels, bays and obstacles, and stays small."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from shapely import box, get_coordinates

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import InputError
from sandwich_sitl.viewing.map_picture import draw_map
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.world import Obstacle, World

BOUNDS = (0.0, 0.0, 60.0, 30.0)
YARD = box(20, 8, 40, 22).difference(box(24, 12, 36, 23))
BAR = box(20, 0, 24, 30)


def share_of(picture: np.ndarray, colour: str) -> float:
    return float((np.abs(picture[..., :3] - np.array(to_rgb(colour))).max(axis=-1) < 0.03).mean())


def mapped(shape: object) -> ChannelMap:
    return build_channel_map(grow(World(BOUNDS, (Obstacle("yard", shape),)), 1.0, 0.1), 1.0, 5)


def test_the_picture_shows_what_the_map_has(tmp_path: Path) -> None:
    draw_map(mapped(YARD), [get_coordinates(YARD.exterior)[:-1]], tmp_path / "map.png", "Yard")
    picture = matplotlib.image.imread(tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size < 400_000
    assert picture.shape[1] > 1900
    area = (BOUNDS[2] - BOUNDS[0]) * (BOUNDS[3] - BOUNDS[1])
    assert share_of(picture, "#46525e") == pytest.approx(YARD.area / area, rel=0.25)
    for colour in ("#edf3f8", "#d5e3ef", "#f6e7c8", "#c3c9cf", "#1f5f99"):
        assert share_of(picture, colour) > 0.001, colour


def test_a_map_without_channels_is_all_bays(tmp_path: Path) -> None:
    bar = box(0, 12, 60, 18).union(BAR)
    draw_map(mapped(bar), [get_coordinates(bar.exterior)[:-1]], tmp_path / "map.png", "Walls")
    picture = matplotlib.image.imread(tmp_path / "map.png")
    assert share_of(picture, "#f6e7c8") > 0.2
    assert share_of(picture, "#edf3f8") < 0.01


def test_a_directory_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        draw_map(mapped(YARD), [], tmp_path / "none" / "map.png", "Yard")
