"""Map files: what is saved loads as the same map; what is no map says so; the key knows what a map depends on."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from shapely import box
from world_samples import grown_world, horseshoe, random_shapes, sample_world

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.check import examine
from sandwich_sitl.channels.map_file import load_map, map_key, save_map
from sandwich_sitl.errors import InputError


def same(a: object, b: object) -> None:
    """Equal in every field, to the last bit and with the same kind of number."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            same(one, other)
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            same(getattr(a, field.name), getattr(b, field.name))
    elif hasattr(a, "wkb"):
        assert a.wkb == b.wkb
    else:
        assert a == b


def sample_map(seed: int) -> ChannelMap:
    sample = sample_world(seed)
    return build_channel_map(sample.grown, 1.5 + sample.cell_m, 5, sample.flow)


MAPS = {
    "channels and bays": lambda: build_channel_map(grown_world(*random_shapes(12)), 1.7, 5),
    "along y": lambda: build_channel_map(grown_world(horseshoe(40, 25, 14, 90)), 1.7, 5, "y"),
    "no channels": lambda: build_channel_map(grown_world(box(35, -5, 45, 60)), 1.7, 5),
    "no obstacles": lambda: build_channel_map(grown_world(), 5.0, 5),
    "nothing free": lambda: build_channel_map(grown_world(box(-5, -5, 90, 60)), 5.0, 5),
    "lost slivers": lambda: sample_map(271),
}


@pytest.mark.parametrize("name", MAPS)
def test_saved_map_loads_identically(name: str, tmp_path: Path) -> None:
    channel_map = MAPS[name]()
    path = tmp_path / "map.npz"
    save_map(channel_map, path)
    loaded = load_map(path)
    same(loaded, channel_map)
    assert examine(loaded).failures == ()
    save_map(loaded, tmp_path / "again.npz")
    same(load_map(tmp_path / "again.npz"), channel_map)


def test_samples_hold_what_they_are_for() -> None:
    assert MAPS["channels and bays"]().bays
    assert MAPS["no channels"]().channels == 0
    assert MAPS["lost slivers"]().lost


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


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_map_cut_short_is_no_map(share: float, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    save_map(build_channel_map(grown_world(box(30, 20, 40, 30)), 4.0, 5), path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="is not a channel map"):
        load_map(path)


@pytest.mark.parametrize("name", ["nodes", "rows", "phi", "barred", "bay_quads", "bay_quads_lengths", "grown_rings"])
def test_map_without_one_of_its_arrays_is_no_map(name: str, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    save_map(build_channel_map(grown_world(horseshoe(40, 25, 14, 90)), 4.0, 5), path)
    with np.load(path) as data:
        rest = {key: data[key] for key in data.files if key != name}
    np.savez(path, **rest)
    with pytest.raises(InputError, match="is not a channel map"):
        load_map(path)


def test_key_changes_with_all_that_a_map_depends_on_and_nothing_else() -> None:
    grown = grown_world(box(30, 20, 40, 30), box(50, 5, 60, 12))
    key = map_key(grown, 1.0, 5, "x")
    assert key == map_key(grown_world(box(30, 20, 40, 30), box(50, 5, 60, 12)), 1.0, 5, "x")
    others = [
        map_key(grown, 1.1, 5, "x"),
        map_key(grown, 1.0, 6, "x"),
        map_key(grown, 1.0, 5, "y"),
        map_key(grown_world(box(30, 20, 40, 30), box(50, 5, 60.001, 12)), 1.0, 5, "x"),
        map_key(grown_world(box(30, 20, 40, 30)), 1.0, 5, "x"),
        map_key(dataclasses.replace(grown, bounds_m=(0.0, 0.0, 80.0, 51.0)), 1.0, 5, "x"),
        map_key(dataclasses.replace(grown, names=("a", "b")), 1.0, 5, "x"),
    ]
    assert len({key, *others}) == len(others) + 1
