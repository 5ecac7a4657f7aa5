"""The plan's picture shows what the plan holds, and drawing it leaves matplotlib's global state alone."""

from pathlib import Path

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest
import run_samples
from matplotlib import colormaps
from matplotlib.colors import to_hex, to_rgb

from sandwich_sitl.errors import InputError
from sandwich_sitl.viewing.plan_picture import Track, draw_plan


def pixels_of(picture: np.ndarray, colour: str) -> int:
    return int((np.abs(picture[..., :3] - np.array(to_rgb(colour))).max(axis=-1) < 0.02).sum())


@pytest.mark.parametrize("obstacles", [True, False])
def test_the_picture_holds_routes_obstacles_and_barred_nodes(tmp_path: Path, obstacles: bool) -> None:
    figures = plt.get_fignums()
    draw_plan(run_samples.small_plan(obstacles=obstacles), tmp_path / "plan.png")
    picture = matplotlib.image.imread(tmp_path / "plan.png")
    assert picture.shape[1] == 2400
    left, right = picture[:, :1150], picture[:, 1150:]
    for half in (left, right):
        for route in ("#0b6fd6", "#e07b00", "#1d9a52"):
            assert pixels_of(half, route) > 300, route
        assert pixels_of(half, to_hex(colormaps["plasma"](1.0))) > 300
    assert pixels_of(picture, "#f4c400") > 100
    assert (pixels_of(picture, "#8b8f98") > 10_000) is obstacles
    assert plt.get_fignums() == figures


def test_floors_add_the_altitude_along_the_way_and_what_is_flown_over(tmp_path: Path) -> None:
    """An obstacle of 7 m is light under the floor of 10 m, one of 70 m is not; the regions' altitudes are a band."""
    pictures = []
    for height_m in (7.0, 70.0):
        draw_plan(run_samples.plan_with_floors(height_m), tmp_path / "plan.png")
        pictures.append(matplotlib.image.imread(tmp_path / "plan.png"))
    low, tall = pictures
    assert pixels_of(low, "#c9a66b") > 10_000 > pixels_of(tall, "#c9a66b")
    assert pixels_of(tall, "#8b8f98") > 10_000 > pixels_of(low, "#8b8f98")
    assert pixels_of(low, "#c6e6d4") > 5_000  # a quarter of the band's green on white


def test_a_flown_track_takes_the_place_of_the_reference_and_its_speeds(tmp_path: Path) -> None:
    """At rest for half of the time: the slow half is drawn in the colour of no speed, in both spaces."""
    plan = run_samples.small_plan()
    t_s = np.linspace(0.0, 100.0, 400)
    x_m = np.where(t_s < 95.0, 2.0 + 0.1 * t_s, 11.5 + 5.0 * (t_s - 95.0))
    track = Track("vehicle", t_s, np.column_stack([x_m, np.full_like(x_m, 5.0)]))
    draw_plan(plan, tmp_path / "plan.png", track)
    picture = matplotlib.image.imread(tmp_path / "plan.png")
    slow, fast = (to_hex(colormaps["plasma"](share)) for share in (0.1 / 5.0, 1.0))
    for half in (picture[:, :1150], picture[:, 1150:]):
        assert pixels_of(half, slow) > 300
        assert pixels_of(half, fast) > 300


def test_a_directory_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        draw_plan(run_samples.small_plan(), tmp_path / "none" / "plan.png")
