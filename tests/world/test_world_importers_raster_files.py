"""ROS map_server and MovingAI files: what each pixel means, and one line for every file that cannot be used."""

import math
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers import ImportOptions, read_world
from sandwich_sitl.world.importers.ros_map import read_ros_map
from sandwich_sitl.world.world import World

GREY = np.array([[0, 255, 205], [254, 100, 255]], dtype=np.uint8)


def ros(folder: Path, pixels: NDArray[np.uint8] | None = GREY, name: str = "m.pgm", **keys: object) -> Path:
    if pixels is not None:
        Image.fromarray(pixels).save(folder / name)
    values: dict[str, object] = {"image": name, "resolution": 0.5, "origin": [1.0, 2.0, 0.0]} | keys
    path = folder / "m.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items() if value is not None))
    return path


def drawn(path: Path) -> list[str]:
    """North first: # solid, ? unknown, . free."""
    grid = read_ros_map(path)
    letters = np.where(grid.solid, "#", np.where(grid.unknown, "?", "."))
    return ["".join(row) for row in letters[::-1]]


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, ["#.?", ".?."]),  # p = 1, 0, 0.196078 (not below 0.196); 0.004, 0.608, 0
        ({"free_thresh": 0.25, "occupied_thresh": 0.6}, ["#..", ".#."]),
        ({"negate": 1}, [".##", "#?#"]),
        ({"mode": "scale", "negate": 0}, ["#.?", ".?."]),
    ],
)
def test_thresholds(tmp_path: Path, keys: dict[str, object], expected: list[str]) -> None:
    assert drawn(ros(tmp_path, **keys)) == expected


@pytest.mark.parametrize("name", ["m.png", "m.bmp", "m.pgm"])
def test_image_formats_agree(tmp_path: Path, name: str) -> None:
    assert drawn(ros(tmp_path, name=name)) == ["#.?", ".?."]


def test_colours_are_averaged_and_transparent_pixels_unknown(tmp_path: Path) -> None:
    pixels = np.zeros((1, 3, 4), dtype=np.uint8)
    pixels[0] = [(0, 0, 0, 255), (255, 255, 255, 255), (0, 0, 0, 0)]
    assert drawn(ros(tmp_path, pixels, "m.png")) == ["#.?"]
    pixels[0, :2, :3] = [(0, 0, 255), (200, 230, 255)]  # means 85 and 228: p = 0.667 and 0.105
    assert drawn(ros(tmp_path, pixels, "m.png")) == ["#.?"]


def test_sixteen_bit_and_plain_text_pgm(tmp_path: Path) -> None:
    path = ros(tmp_path, None)
    (tmp_path / "m.pgm").write_bytes(b"P5 3 1 65535\n" + np.array([0, 65535, 40000], dtype=">u2").tobytes())
    assert drawn(path) == ["#.?"]
    (tmp_path / "m.pgm").write_bytes(b"P2\n# made by hand\n3 1\n255\n0 255 205\n")
    assert drawn(path) == ["#.?"]


def test_place_scale_and_unknown_cells(tmp_path: Path) -> None:
    path = ros(tmp_path, np.array([[254, 254, 0], [254, 254, 254], [205, 254, 254]], dtype=np.uint8))
    known = read_world(path, ImportOptions(unknown_is_free=True))
    (obstacle,) = known.world.obstacles
    assert obstacle.polygon.bounds == (2.0, 3.0, 2.5, 3.5)
    assert known.world.bounds_m == (1.0, 2.0, 2.5, 3.5)
    both = read_world(path)
    assert sorted(o.polygon.bounds for o in both.world.obstacles) == [(1.0, 2.0, 1.5, 2.5), (2.0, 3.0, 2.5, 3.5)]
    assert both.report.grid is not None
    assert (both.report.grid.occupied_cells, both.report.grid.unknown_cells) == (1, 1)


def test_numbers_of_yaml_1_2_are_numbers(tmp_path: Path) -> None:
    grid = read_ros_map(ros(tmp_path, resolution="5e-1", origin="[1e0, 2e0, 1e-1]"))
    assert (grid.cell_m, grid.origin_m, grid.yaw_rad) == (0.5, (1.0, 2.0), 0.1)


def raster(world: World, corners: NDArray[np.float64], size_m: float) -> NDArray[np.bool_]:
    """Whether the middles of little squares, of given lower left corners (..., 2), lie in an obstacle."""
    x, y = (corners + size_m / 2).reshape(-1, 2).T
    solid = shapely.union_all([o.polygon for o in world.obstacles])
    shapely.prepare(solid)
    return np.asarray(shapely.contains_xy(solid, x, y)).reshape(corners.shape[:-1])


def blobs(rng: np.random.Generator, count: int, smooth: float) -> NDArray[np.bool_]:
    noise = scipy.ndimage.gaussian_filter(rng.normal(size=(count, count)), smooth)
    solid = noise > 0.15 * noise.std()
    solid[count // 2, count // 2] = False
    return np.asarray(solid, dtype=bool)


def rooms_with_a_slanted_passage(rng: np.random.Generator, count: int) -> NDArray[np.bool_]:
    """Steps on both of its sides, where chords over them could meet."""
    row, column = np.mgrid[0:count, 0:count] - (count - 1) / 2
    passage = np.abs(row - rng.uniform(-1, 1) * column - rng.uniform(-1, 1)) < rng.uniform(0.5, 3.5)
    return ~(passage | (np.abs(column) > count / 4))


@given(
    seed=st.integers(0, 10_000),
    smooth=st.sampled_from([None, None, 0.0, 0.8, 1.5, 2.5]),
    gap=st.sampled_from([1.0, 1.7, 2.5, 4.0]),
    yaw=st.sampled_from([0.0, 0.4, -2.0, math.pi]),
    negate=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_against_a_raster(
    tmp_path_factory: pytest.TempPathFactory, seed: int, smooth: float | None, gap: float, yaw: float, negate: bool
) -> None:
    """Brute force on squares of a sixteenth of a pixel, each placed by hand: no obstacle pixel is lost, no free one far from
    obstacles is taken, and a disc as wide as the gap still gets from room to room, and nowhere new."""
    fine, cell_m, count = 16, 0.25, 24
    rng = np.random.default_rng(seed)
    solid = rooms_with_a_slanted_passage(rng, count) if smooth is None else blobs(rng, count, smooth)
    pixels = np.where(solid[::-1] != negate, 0, 255).astype(np.uint8)
    origin = rng.uniform(-50, 50, 2)
    path = ros(
        tmp_path_factory.mktemp("raster"), pixels, resolution=cell_m, origin=[*origin.tolist(), yaw], negate=int(negate)
    )
    world = read_world(path, ImportOptions(unknown_is_free=True, gap_m=gap * cell_m)).world
    row, column = np.mgrid[0 : fine * count, 0 : fine * count] / fine
    middle = np.stack([column, row], axis=-1) + 0.5 / fine
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    after = raster(world, origin + cell_m * (middle @ turn) - 0.5 * cell_m / fine, cell_m / fine)
    label, _ = scipy.ndimage.label(~solid)
    meant = np.bincount(label[label > 0]).argmax()
    inside = np.kron(label == meant, np.ones((fine, fine), dtype=bool))
    before = np.kron(solid, np.ones((fine, fine), dtype=bool))
    seen = shapely.contains_xy(
        shapely.box(*world.bounds_m), *(origin + cell_m * (middle @ turn)).reshape(-1, 2).T
    ).reshape(before.shape)
    assert not (before & ~after & seen).any()
    far = scipy.ndimage.distance_transform_edt(~before) > fine + 1
    assert not (inside & far & after).any()
    # What the raster cannot tell: half a diagonal of a square, for the disc's middle and for the obstacle.
    blur = 1.5
    radius = gap * fine / 2
    rooms_before, found = scipy.ndimage.label(inside & (scipy.ndimage.distance_transform_edt(~before) > radius + blur))
    open_after = inside & (scipy.ndimage.distance_transform_edt(~after) > radius - blur)
    rooms_after, _ = scipy.ndimage.label(open_after, np.ones((3, 3)))
    for room in range(1, found + 1):
        deep = (rooms_before == room) & (scipy.ndimage.distance_transform_edt(~before) > radius + fine + blur)
        homes = np.unique(rooms_after[deep])
        assert 0 not in homes
        assert len(homes) <= 1, "a passage was closed"


def test_renamed_image_is_found_and_said(tmp_path: Path) -> None:
    remarks = read_world(ros(tmp_path) and ros(tmp_path, None, name="lost.pgm")).report.remarks
    assert "lost.pgm is missing; took m.pgm" in remarks[0].reason


def png_declaring(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    header = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    bomb = chunk(b"IDAT", zlib.compress(bytes(20_000_000), 9))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + bomb + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (png_declaring(60000, 60000), "exceeds limit"),
        (png_declaring(0, 5), "image"),
        (b"P5 999999 999999 255\n", "exceeds limit"),
        (b"P5 9999 9999 255\n", "exceeds limit"),
        (b"P5 8999 8999 255\n", "declares 8999 x 8999"),
        (b"P5 3000 3000 255\n\0\0", "cannot be read as an image"),
        (b"P5 3 nonsense", "image"),
        (png_declaring(3000, 3000)[:1000], "cannot be read as an image"),
        (b"GIF89a", "is not an image"),
        (b"", "is not an image"),
    ],
)
def test_bad_images(tmp_path: Path, image: bytes, words: str) -> None:
    path = ros(tmp_path, None)
    (tmp_path / "m.pgm").write_bytes(image)
    with pytest.raises(InputError, match=words) as caught:
        read_world(path)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_more_data_than_declared_is_never_unpacked(tmp_path: Path) -> None:
    path = ros(tmp_path, None)
    (tmp_path / "m.pgm").write_bytes(png_declaring(4, 4))
    with pytest.raises(InputError, match="no free cell"):
        read_world(path)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"resolution": 0}, "resolution: must be"),
        ({"resolution": ".nan"}, "resolution: must be"),
        ({"resolution": "1e-320"}, "resolution: must be"),
        ({"resolution": "wide"}, "resolution: must be"),
        ({"resolution": "1e400"}, "resolution: must be"),
        ({"resolution": "9" * 400}, "resolution: must be"),
        ({"origin": [0, 0, "north"]}, "origin: must be"),
        ({"resolution": None}, "resolution: must be"),
        ({"origin": [0, 0]}, "origin: must be"),
        ({"origin": "[0, 0, .inf]"}, "origin: must be"),
        ({"negate": 2}, "negate: must be"),
        ({"mode": "raw"}, "mode: must be one of trinary, scale"),
        ({"free_thresh": 0.9}, "must be ordered"),
        ({"image": "gone.pgm"}, "gone.pgm: cannot be read"),
        ({"image": 3}, "image: must name"),
        ({"image": None}, "needs image"),
        ({"image": "."}, "not a regular file"),
    ],
)
def test_bad_keys(tmp_path: Path, keys: dict[str, object], words: str) -> None:
    path = ros(tmp_path, None, **keys)
    with pytest.raises(InputError, match=words):
        read_world(path)


BOMB = "a: &a {x: 1}\n" + "".join(
    f"{chr(98 + k)}: &{chr(98 + k)} {{<<: [{', '.join(['*' + chr(97 + k)] * 9)}]}}\n" for k in range(9)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "alias"),
        ("image: " + "[" * 30_000, "nests deeper"),
        ("image: m.pgm\nresolution: [", "is not YAML"),
        ("image: !!python/object/apply:os.getcwd []", "is not YAML"),
        ("- image", "is not a map_server file"),
        ("image: a\n" + "#" * 70_000, "more than 65536"),
        ("image: 2001-99-99\nimage2: 2001-99-99", "is not YAML"),
    ],
)
def test_bad_yaml(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_world(path)
    assert "\n" not in str(caught.value)


MAP = "type octile\nheight 3\nwidth 4\nmap\n.@T.\n....\nSW.G\n"


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_moving_ai(tmp_path: Path, ends: str) -> None:
    path = tmp_path / "arena.map"
    path.write_bytes(MAP.replace("\n", ends).encode())
    imported = read_world(path, ImportOptions(cell_m=2.0, simplify_m=0))
    assert sorted(o.polygon.bounds for o in imported.world.obstacles) == [(2, 0, 4, 2), (2, 4, 6, 6)]
    assert imported.world.bounds_m == (0, 0, 8, 6)
    dry = read_world(path, ImportOptions(passable=".GW"))
    assert sorted(o.polygon.bounds for o in dry.world.obstacles) == [(0, 0, 1, 1), (1, 2, 3, 3)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nothing", "is not a MovingAI map"),
        (MAP[:-6], "line 7: ends after 2 of 3 rows"),
        (MAP[:-3], "line 7: has 2 cells, not 4"),
        (MAP.replace("T", "x"), "line 5: 'x' is no terrain"),
        (MAP.replace("3", "three"), "line 2"),
        (MAP.replace("height 3", "width 3"), "line 3: repeats"),
        (MAP.replace("3", "100000").replace("4", "100000"), "declares 100000 x 100000"),
        (MAP.replace("height 3", "height 0"), "declares"),
    ],
)
def test_bad_moving_ai(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "arena.map"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_world(path)
