"""The world of a run: a map in degrees against an independent formula, and one line for what cannot be used."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import pytest
import shapely

from sandwich_sitl.config import GeoOriginConfig, ObstacleConfig, WorldConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.world.load import import_world, load_world
from sandwich_sitl.world.world import GeoOrigin, World

PRAGUE = GeoOrigin(50.1, 14.4)
SEMI_MAJOR_M, ECCENTRICITY_2 = 6378137.0, 6.69437999014e-3  # WGS84


def square(lon: float, lat: float, half: float = 1e-4) -> list[list[list[float]]]:
    return [[[lon + half * a, lat + half * b] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]]


def feature(coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def written(folder: Path, *features: Any) -> Path:
    path = folder / "town.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}), encoding="utf-8")
    return path


def world_of(
    path: Path, origin: GeoOrigin | None = None, bounds_m: tuple[float, float, float, float] | None = None
) -> World:
    """The world of a run whose configuration lies beside the map file."""
    place = origin and GeoOriginConfig(origin.latitude_deg, origin.longitude_deg)
    return load_world(WorldConfig(file=path.name, origin=place, bounds_m=bounds_m), path.parent / "run.yaml")


def radii_m(latitude_deg: float) -> tuple[float, float]:
    """Radii of curvature of the ellipsoid: along the meridian and along the parallel."""
    sine = np.sin(np.radians(latitude_deg))
    root = np.sqrt(1 - ECCENTRICITY_2 * sine**2)
    normal = SEMI_MAJOR_M / root
    return SEMI_MAJOR_M * (1 - ECCENTRICITY_2) / root**3, normal * np.cos(np.radians(latitude_deg))


@pytest.mark.parametrize("latitude", [-60.0, -10.0, 0.5, 50.1, 78.0])
def test_projection_agrees_with_the_radii_of_the_ellipsoid(tmp_path: Path, latitude: float) -> None:
    origin = GeoOrigin(latitude, 14.4)
    path = written(tmp_path, feature(square(14.4 + 5e-4, latitude + 7e-4)))
    (obstacle,) = world_of(path, origin, (-500, -500, 500, 500)).obstacles
    lon_lat = np.array(square(14.4 + 5e-4, latitude + 7e-4)[0])
    along_meridian, along_parallel = radii_m(latitude)
    expected = np.radians(lon_lat - (14.4, latitude)) * (along_parallel, along_meridian)
    np.testing.assert_allclose(shapely.get_coordinates(obstacle.polygon), expected, atol=0.02)


def test_projection_inverts_exactly(tmp_path: Path) -> None:
    path = written(tmp_path, feature(square(14.41, 50.105)))
    (obstacle,) = world_of(path, PRAGUE, (-2000, -2000, 2000, 2000)).obstacles
    east, north = shapely.get_coordinates(obstacle.polygon).T
    up = -(east**2 + north**2) / (2 * SEMI_MAJOR_M)  # the ground falls away under the tangent plane
    lat, lon, _ = pymap3d.enu2geodetic(east, north, up, PRAGUE.latitude_deg, PRAGUE.longitude_deg, 0.0)
    np.testing.assert_allclose(np.column_stack([lon, lat]), square(14.41, 50.105)[0], atol=1e-8)


def test_east_is_x_and_north_is_y(tmp_path: Path) -> None:
    path = written(tmp_path, feature(square(14.401, 50.1), name="east"), feature(square(14.4, 50.101), name="north"))
    by_name = {o.name: o.polygon.centroid for o in world_of(path, PRAGUE, (-500, -500, 500, 500)).obstacles}
    assert by_name["east"].x > 50
    assert abs(by_name["east"].y) < 1
    assert by_name["north"].y > 50
    assert abs(by_name["north"].x) < 1


def test_origin_and_bounds_are_derived(tmp_path: Path) -> None:
    path = written(tmp_path, feature(square(14.40, 50.10)), feature(square(14.41, 50.11)))
    world = world_of(path)
    assert world.origin is not None
    assert world.origin.latitude_deg == pytest.approx(50.105)
    assert world.origin.longitude_deg == pytest.approx(14.405)
    x_min, y_min, x_max, y_max = world.bounds_m
    west, south, east, north = shapely.total_bounds([o.polygon for o in world.obstacles])
    assert (x_max - x_min, y_max - y_min) == pytest.approx((1.1 * (east - west), 1.1 * (north - south)))
    assert x_min < west < east < x_max


def test_names_heights_and_parts(tmp_path: Path) -> None:
    parts = [square(14.4, 50.1), square(14.402, 50.1)]
    path = written(
        tmp_path,
        feature(parts, "MultiPolygon", name="twin", height=12),
        feature(square(14.404, 50.1)) | {"id": "w7"},
        feature(square(14.406, 50.1)) | {"properties": None},
    )
    world = world_of(path)
    assert [(o.name, o.height_m) for o in world.obstacles] == [
        ("twin.1", 12),
        ("twin.2", 12),
        ("w7", None),
        ("feature3", None),
    ]


def test_obstacles_outside_the_bounds_are_left_out(tmp_path: Path) -> None:
    path = written(tmp_path, feature(square(14.4, 50.1), name="in"), feature(square(14.5, 50.1), name="out"))
    assert [o.name for o in world_of(path, PRAGUE, (-100, -100, 100, 100)).obstacles] == ["in"]


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (feature([14.4, 50.1], "Point"), ("no usable polygon", "feature1", "is a Point, not an area")),
        (feature([[[14.4, 50.1], [14.5, 50.2]]]), ("features[0].geometry", "cannot be read")),
        (feature("nonsense"), ("features[0].geometry", "cannot be read")),
        (feature([[["a", "b"], ["c", "d"], ["e", "f"], ["a", "b"]]]), ("features[0].geometry", "cannot be read")),
        (feature(square(14.4, 50.1), "Blob"), ("features[0].geometry", "cannot be read")),
        (feature(square(1614000.0, 6460000.0)), ("features[0]", "longitude, latitude")),
        (feature(square(14.4, 95.0)), ("features[0]", "longitude, latitude")),
        (feature(square(14.4, float("nan"))), ("features[0].geometry", "cannot be read")),
        (feature([[[0, 0], [1e-3, 1e-3], [1e-3, 0], [0, 1e-3], [0, 0]]], name="bow"), ("'bow'", "simple polygon")),
        (feature([[[0, 0], [1e-3, 0], [2e-3, 0], [0, 0]]], name="line"), ("'line'", "simple polygon")),
        (feature([]), ("no usable polygon", "feature1", "has no corners")),
        (feature(square(14.4, 50.1)) | {"properties": [1]}, ("features[0].properties", "mapping")),
        ({"type": "Feature", "geometry": None}, ("no usable polygon", "feature1", "has no geometry")),
        (3, ("features[0]", "no geometry")),
    ],
)
def test_bad_feature_is_named(tmp_path: Path, item: Any, words: tuple[str, ...]) -> None:
    path = written(tmp_path, item)
    with pytest.raises(InputError) as caught:
        world_of(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("height", ["tall", -3, True])
def test_a_height_that_is_none_is_said_and_the_shape_kept(tmp_path: Path, height: object) -> None:
    written(tmp_path, feature(square(14.4, 50.1), name="hall", height=height))
    imported = import_world(WorldConfig(file="town.geojson"), tmp_path / "run.yaml")
    assert [(o.name, o.height_m) for o in imported.world.obstacles] == [("hall", None)]
    assert [note.name for note in imported.report.remarks] == ["hall"]
    assert "is not a positive number of metres" in imported.report.remarks[0].reason


def test_what_is_no_area_is_said_and_the_rest_kept(tmp_path: Path) -> None:
    written(
        tmp_path,
        feature([14.4, 50.1], "Point", name="tree"),
        feature(square(14.4, 50.1), name="hall"),
        {"type": "Feature", "geometry": None},
    )
    imported = import_world(WorldConfig(file="town.geojson"), tmp_path / "run.yaml")
    assert [o.name for o in imported.world.obstacles] == ["hall"]
    assert [note.name for note in imported.report.dropped] == ["tree", "feature3"]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"{", "is not JSON"),
        (b"\xff\xfe", "is not UTF-8"),
        (b"[]", "is not a GeoJSON FeatureCollection"),
        (b'{"type": "Feature"}', "has no usable polygon"),
        (b'{"type": "Topology"}', "is not a GeoJSON FeatureCollection"),
        (b'{"type": "FeatureCollection", "features": {}}', "is not a GeoJSON FeatureCollection"),
        (b'{"type": "FeatureCollection", "features": []}', "has no usable polygon"),
    ],
)
def test_bad_file_is_named(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "bad.geojson"
    path.write_bytes(data)
    with pytest.raises(InputError, match=words) as caught:
        world_of(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_missing_file_and_relative_path(tmp_path: Path) -> None:
    config_path = tmp_path / "deep" / "run.yaml"
    config_path.parent.mkdir()
    config_path.write_text("seed: 1\nworld:\n  file: town.geojson\n")
    with pytest.raises(InputError, match=r"run\.yaml:3: world\.file: there is no .*relative to the configuration"):
        load_world(WorldConfig(file="town.geojson"), config_path)
    written(config_path.parent, feature(square(14.4, 50.1), name="home"))
    origin = GeoOriginConfig(latitude_deg=50.1, longitude_deg=14.4)
    world = load_world(WorldConfig(file="town.geojson", origin=origin, bounds_m=(-50, -50, 50, 50)), config_path)
    assert world.bounds_m == (-50, -50, 50, 50)
    assert world.origin == PRAGUE


def test_circle_polygon_covers_the_circle(tmp_path: Path) -> None:
    config = WorldConfig(bounds_m=(0, 0, 40, 40), obstacles=(ObstacleConfig(circle_m=(20, 20, 5)),))
    (obstacle,) = load_world(config, tmp_path / "run.yaml").obstacles
    assert shapely.Point(20, 20).distance(obstacle.polygon.exterior) >= 5 - 1e-9
    assert obstacle.polygon.area < 1.02 * np.pi * 25
    assert obstacle.name == "obstacle1"
