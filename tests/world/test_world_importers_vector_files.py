"""GeoJSON, OpenStreetMap, WKT and CSV: what becomes an obstacle, what is mended, and one line for what cannot be used."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import osmium
import pytest
import shapely
from pydantic import ValidationError

from sandwich_sitl.config import GeoOriginConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.viewing.world_picture import draw_world
from sandwich_sitl.world.importers import ImportOptions, limits, osm, read_world, shapes, text_shapes
from sandwich_sitl.world.importers.tags import height_m
from sandwich_sitl.world.world import GeoOrigin
from sandwich_sitl.world_report import cover, world_report

STEP = 1e-4  # degrees; 11.13 m north
ROMB = [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]
HOLE = [[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5], [0.5, 0.5]]
BOW = [[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]
PINCHED = [[0, 0], [2, 0], [1, 1], [2, 2], [0, 2], [1, 1], [0, 0]]
FLAT = [[0, 0], [1, 0], [2, 0], [0, 0]]


def degrees(ring: list[list[float]], east: float = 0.0, north: float = 0.0) -> list[list[float]]:
    return [[14.4 + STEP * (x + east), 50.1 + STEP * (y + north)] for x, y in ring]


def feature(coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def geojson(folder: Path, *features: Any, **members: Any) -> Path:
    path = folder / "town.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)} | members), encoding="utf-8")
    return path


def test_parts_holes_heights_and_filter(tmp_path: Path) -> None:
    path = geojson(
        tmp_path,
        feature([degrees(ROMB), degrees(HOLE)], name="court", building="yes", height="12 m"),
        feature(
            [[degrees(ROMB, 4)], [degrees(ROMB, 7)]],
            "MultiPolygon",
            name="twin",
            building="yes",
            **{"building:levels": 4},
        ),
        feature(degrees(ROMB, 10)[0], "Point", name="tree", building="yes"),
        feature([degrees(ROMB, 13)], name="pond", natural="water"),
        feature([degrees(ROMB, 16)], name="odd", building="yes", height="tall"),
        {"type": "Feature", "properties": {"building": "yes"}, "geometry": None},
    )
    imported = read_world(path, ImportOptions(where={"building": "yes"}, storey_m=3.0))
    world, report = imported.world, imported.report
    assert [(o.name, o.height_m) for o in world.obstacles] == [
        ("court", 12),
        ("twin.1", 12),
        ("twin.2", 12),
        ("odd", None),
    ]
    assert [(note.name, note.reason) for note in report.dropped] == [
        ("tree", "is a Point, not an area"),
        ("feature6", "has no geometry"),
    ]
    assert (report.read, report.filtered) == (7, 1)
    court = world.obstacles[0].polygon
    assert not court.interiors
    assert court.area == pytest.approx(world.obstacles[1].polygon.area, rel=1e-3)
    assert f"{court.area / 4:.1f} m2" in report.courtyards[0].reason
    assert "height 'tall'" in report.remarks[0].reason


def test_window_bounds_and_origin(tmp_path: Path) -> None:
    path = geojson(tmp_path, feature([degrees(ROMB)], name="in"), feature([degrees(ROMB, 900)], name="out"))
    window = (14.4 - STEP, 50.1 - STEP, 14.4 + 3 * STEP, 50.1 + 3 * STEP)
    imported = read_world(path, ImportOptions(window_deg=window))
    x_min, y_min, x_max, y_max = imported.world.bounds_m
    assert [o.name for o in imported.world.obstacles] == ["in"]
    assert imported.report.outside == 1
    assert y_max - y_min == pytest.approx(4 * STEP * 111_229, rel=1e-3)  # a degree of latitude at 50 degrees north
    assert x_max - x_min == pytest.approx(4 * STEP * 71_550, rel=1e-3)
    assert imported.world.origin == GeoOrigin(pytest.approx(50.1 + STEP), pytest.approx(14.4 + STEP))
    fixed = read_world(path, ImportOptions(origin=GeoOriginConfig(50.1, 14.4), bounds_m=(-5, -5, 50, 50)))
    assert fixed.world.bounds_m == (-5, -5, 50, 50)
    assert fixed.report.outside == 1
    with pytest.raises(InputError, match="1 lie outside the window"):
        read_world(geojson(tmp_path, feature([degrees(ROMB)])), ImportOptions(window_deg=(0, 0, 1, 1), bounds_m=None))


def test_a_map_without_shapes_is_open_ground_where_bounds_say_so(tmp_path: Path) -> None:
    world = read_world(geojson(tmp_path), ImportOptions(origin=GeoOriginConfig(50, 14), bounds_m=(0, 0, 5, 5))).world
    assert (world.obstacles, world.bounds_m, world.origin) == ((), (0, 0, 5, 5), GeoOrigin(50, 14))


def test_self_touching_is_mended_self_crossing_only_when_asked(tmp_path: Path) -> None:
    touching = read_world(geojson(tmp_path, feature([degrees(PINCHED)], name="pinched")))
    assert [o.name for o in touching.world.obstacles] == ["pinched.1", "pinched.2"]
    assert "touches itself" in touching.report.repaired[0].reason
    path = geojson(tmp_path, feature([degrees(BOW)], name="bow"), feature([degrees(FLAT)], name="flat"))
    mended = read_world(path, ImportOptions(repair=True))
    assert [o.name for o in mended.world.obstacles] == ["bow.1", "bow.2"]
    assert "crosses itself" in mended.report.repaired[0].reason
    assert [note.name for note in mended.report.dropped] == ["flat"]
    circle = shapely.Point(1, 1).buffer(1, quad_segs=200).exterior.coords[:]
    tangled = [degrees([*map(list, circle[:-1]), [3, 3], [1, 1], list(circle[0])])]
    hull = read_world(geojson(tmp_path, feature(tangled, name="long")), ImportOptions(repair=True)).world.obstacles[0]
    assert hull.polygon.equals(hull.polygon.convex_hull)


METRES = [[1614000.0 + x, 6460000.0 + y] for x, y in ROMB]


@pytest.mark.parametrize(
    ("features", "members", "words"),
    [
        ([feature([METRES])], {}, r"features\[0\]: .*EPSG:4326"),
        ([feature([[[100 * x, 40 * y] for x, y in ROMB[:2]] + [[1, 40], [0, 0]]])], {}, r"longitude, latitude"),
        ([feature([[[50 * x, 40 * y] for x, y in ROMB]])], {}, "spans .* km"),
        ([feature([degrees(ROMB)])], {"crs": {"properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}}, "crs: is"),
        ([feature([degrees(ROMB)])], {"crs": 3857}, "crs: is"),
        ([feature([degrees([[0, 0], [1, float("nan")], [1, 1], [0, 0]])])], {}, "finite|cannot be read"),
        ([feature([degrees(BOW)], name="bow")], {}, "'bow' is not a simple polygon .*repair"),
        ([feature([degrees(FLAT)], name="flat")], {}, "'flat' is not a simple polygon: it has no area"),
        ([feature([[[14, 50], [15, 51]]])], {}, "cannot be read"),
        ([feature(degrees(ROMB)[0], "Point")], {}, "no usable polygon .*is a Point"),
        ([], {}, "no usable polygon"),
        ([3], {}, "no geometry"),
        ([feature([degrees(ROMB)]) | {"properties": [1]}], {}, "must be a mapping"),
    ],
)
def test_bad_geojson(tmp_path: Path, features: list[Any], members: dict[str, Any], words: str) -> None:
    path = geojson(tmp_path, *features, **members)
    with pytest.raises(InputError, match=words) as caught:
        read_world(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.geojson", b'{"type": "FeatureCollection", "features": [', "is not JSON"),
        ("a.geojson", b'{"features": ' + b"[" * 200_000, "is not JSON"),
        ("a.geojson", b"\xff{}", "UTF-8"),
        ("a.json", b"[]", "FeatureCollection"),
        ("a.geojson", b"", "is empty"),
        ("a.geojson", b"PK\x03\x04rest", "packed with zip"),
        ("a.osm", b"\x1f\x8brest", "packed with gzip"),
        ("a.unknown", b"hello", "is no known map"),
        ("a.osm", b"<?xml version='1.0'?><osm version='0.6'><node id='1'", "is no complete OpenStreetMap"),
        ("a.osm", b"<!DOCTYPE o [<!ENTITY a 'aa'>]><osm version='0.6'>&a;</osm>", "is no complete OpenStreetMap"),
        ("a.osm", b"<osm version='0.6'><node id='1e400' lat='1' lon='1'/></osm>", "illegal id: '1e400'"),
        ("a.osm.pbf", b"\x00\x00\x00\x0dgarbage", "is no complete OpenStreetMap"),
        ("a.wkt", b"POLYGON ((0 0, 1 0", "line 1: is not WKT"),
        ("a.wkt", b"POLYGON ((0 0, 1 0, 1 1, 0 0))\nPOLYGON ((0 0))", "line 2: is not WKT"),
        ("a.wkt", b"SRID=3857;POLYGON ((0 0, 1 0, 1 1, 0 0))", "SRID=3857"),
        ("a.wkt", b"GEOMETRYCOLLECTION (" * 9999, "nests parentheses"),
        ("a.wkt", b"POLYGON ((0 0, 1 nan, 1 1, 0 0))", "finite number"),
        ("a.wkt", b"POLYGON ((0 0, 1e9 0, 1 1, 0 0))", "more than 1e.07 m"),
        ("a.wkt", b"POINT (1 1)", "no usable polygon"),
        ("a.wkt", b"POLYGON EMPTY", "no corners"),
        ("a.csv", b"id,lon,lat\n", "line 1: has columns"),
        ("a.csv", b"name,x,y\na,0,0\na,1,zero\n", "line 3: x, y must be"),
        ("a.csv", b"name,x,y\na,0,0\na,1,inf\n", "line 3: x, y must be finite"),
        ("a.csv", b"name,x,y\na,0,0\na,1\n", "line 3: has not as many"),
        ("a.csv", b"name,x,y\na,0,0\na,1,1\n", "line 2: 'a' has 2 corners"),
        ("a.csv", b'name,wkt\na,"POLYGON ((0 0', "is not CSV"),
        ("a.csv", b"name,wkt\na,POLYGON\n", "line 2: is not WKT"),
    ],
)
def test_bad_files(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(InputError, match=words) as caught:
        read_world(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_missing_files_limits_and_options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_world(tmp_path / "none.wkt")
    with pytest.raises(InputError, match="not a regular file"):
        read_world(tmp_path)
    path = tmp_path / "a.wkt"
    path.write_text("POLYGON ((0 0, 1 0, 1 1, 0 0))\n" * 3)
    with pytest.raises(InputError, match="give bounds_m instead"):
        read_world(path, ImportOptions(window_deg=(0, 0, 1, 1)))
    with pytest.raises(InputError, match="where: is for"):
        read_world(path, ImportOptions(where={"a": "b"}))
    for name, value in (("MAX_SHAPES", 2), ("MAX_VERTICES", 10)):
        with monkeypatch.context() as patch:
            patch.setattr(shapes, name, value)
            with pytest.raises(InputError, match="more than"):
                read_world(path)
    monkeypatch.setattr(limits, "MAX_OSM_BYTES", 9)
    with pytest.raises(InputError, match="more than 9"):
        read_world(path)
    for bad in (
        {"bounds_m": (0, 0, 0, 1)},
        {"cell_m": 0.0},
        {"gap_m": -1.0},
        {"simplify_m": float("nan")},
        {"passable": ""},
    ):
        with pytest.raises(ValidationError):
            ImportOptions(**bad)  # type: ignore[arg-type]


def test_wkt_by_line_and_as_a_collection(tmp_path: Path) -> None:
    lines = tmp_path / "lines.wkt"
    lines.write_text(
        "POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))\n\nMULTIPOLYGON (((4 0, 5 0, 5 1, 4 0)), ((6 0, 7 0, 7 1, 6 0)))\n"
    )
    assert [o.name for o in read_world(lines).world.obstacles] == ["line1", "line3.1", "line3.2"]
    whole = tmp_path / "whole"
    whole.write_text("GEOMETRYCOLLECTION (\n POLYGON Z ((0 0 5, 2 0 5, 2 2 5, 0 2 5, 0 0 5)),\n POINT (1 1)\n)\n")
    imported = read_world(whole)
    assert [o.name for o in imported.world.obstacles] == ["line1.1"]
    assert not imported.world.obstacles[0].polygon.has_z
    np.testing.assert_allclose(imported.world.bounds_m, (-0.1, -0.1, 2.1, 2.1))


def test_csv_of_corners_and_of_wkt(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Name, x, y, height\na,0,0,7\nb,5,0,\na,1,0,7\na,1,1,7\nb,6,0,\nb,6,1,\n", encoding="utf-8-sig")
    world = read_world(path).world
    assert [(o.name, o.height_m, o.polygon.area) for o in world.obstacles] == [("a", 7, 0.5), ("b", None, 0.5)]
    path.write_text('name,wkt\nhall,"POLYGON ((0 0, 1 0, 1 1, 0 0))"\n')
    assert [o.name for o in read_world(path).world.obstacles] == ["hall"]


def test_vectors_are_simplified_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.wkt"
    path.write_text("POLYGON ((0 0, 9 0, 9 5, 5 5, 4.5 4.9, 4 5, 0 5, 0 0))")
    (obstacle,) = read_world(path, ImportOptions(simplify_m=0.2)).world.obstacles
    assert obstacle.polygon.area == pytest.approx(45)
    assert read_world(path).report.vertices == 7
    monkeypatch.setattr(shapes, "MAX_SIMPLIFIED_VERTICES", 7)
    with pytest.raises(InputError, match="more than 7 corners to simplify"):
        read_world(path, ImportOptions(simplify_m=0.2))


def node(number: int, x: float, y: float) -> osmium.osm.mutable.Node:
    return osmium.osm.mutable.Node(id=number, location=(14.4 + STEP * x, 50.1 + STEP * y))


def extract(path: Path) -> Path:
    """Way 1 a hall, ways 2 and 3 the rings of relation 9, 4 open, 5 with a missing corner, 6 crossing itself, 7 no building."""
    with osmium.SimpleWriter(str(path)) as writer:
        corners = [ROMB[:4], [[4, 0], [8, 0], [8, 4], [4, 4]], [[5, 1], [7, 1], [7, 3], [5, 3]], BOW[:4]]
        for k, ring in enumerate(corners):
            for i, (x, y) in enumerate(ring):
                writer.add_node(node(10 * k + i + 1, x + (20 if k == 3 else 0), y))
        ways = {
            1: ([1, 2, 3, 4, 1], {"building": "hall", "building:levels": "2", "name": "x"}),
            2: ([11, 12, 13, 14, 11], {}),
            3: ([21, 22, 23, 24, 21], {}),
            4: ([1, 2, 3], {"building": "yes"}),
            5: ([1, 2, 99, 1], {"building": "yes"}),
            6: ([31, 32, 33, 34, 31], {"building": "yes"}),
            7: ([1, 2, 3, 4, 1], {"building": "no"}),
        }
        for number, (nodes, tags) in ways.items():
            writer.add_way(osmium.osm.mutable.Way(id=number, nodes=nodes, tags=tags))
        members = [("w", 2, "outer"), ("w", 3, "inner")]
        tags = {"type": "multipolygon", "building": "yes", "height": "10"}
        writer.add_relation(osmium.osm.mutable.Relation(id=8, members=[("w", 77, "outer")], tags=tags))
        writer.add_relation(osmium.osm.mutable.Relation(id=9, members=members, tags=tags))
    return path


@pytest.mark.parametrize("name", ["a.osm", "a.osm.pbf"])
def test_osm_buildings(tmp_path: Path, name: str) -> None:
    imported = read_world(extract(tmp_path / name))
    found = {o.name: o for o in imported.world.obstacles}
    assert sorted(found) == ["relation 9", "way 1", "way 6.1", "way 6.2"]
    assert (found["way 1"].height_m, found["relation 9"].height_m) == (6.0, 10.0)
    assert found["relation 9"].polygon.area == pytest.approx(4 * found["way 1"].polygon.area, rel=1e-3)
    report = imported.report
    assert {note.name: note.reason for note in report.dropped} == {
        "way 4": "is not closed",
        "way 5": "has corners outside the extract",
        "relation 8": "is incomplete in the extract, or its ways do not close",
    }
    assert [note.name for note in report.courtyards] == ["relation 9"]
    assert [note.name for note in report.repaired] == ["way 6"]
    assert report.filtered == 1
    halls = read_world(tmp_path / name, ImportOptions(where={"building": "hall"}))
    assert [o.name for o in halls.world.obstacles] == ["way 1"]


def test_osm_truncated_or_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = extract(tmp_path / "a.osm.pbf")
    cut = tmp_path / "cut.osm.pbf"
    cut.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="is no complete OpenStreetMap"):
        read_world(cut)
    monkeypatch.setattr(osm, "MAX_OSM_OBJECTS", 10)
    with pytest.raises(InputError, match="more than 10 objects"):
        read_world(path)


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"height": "12"}, 12.0),
        ({"height": "7,5 m"}, 7.5),
        ({"height": "10'6\""}, 3.2004),
        ({"building:levels": "3"}, 10.5),
        ({"height": 4, "building:levels": 9}, 4.0),
        ({"height": "3;4"}, None),
        ({"height": True}, None),
        ({"height": -2}, None),
        ({"height": float("nan")}, None),
        ({}, None),
    ],
)
def test_heights(tags: dict[str, object], expected: float | None) -> None:
    height, remark = height_m(tags, 3.5)
    assert height == (expected if expected is None else pytest.approx(expected))
    assert (remark is not None) == (expected is None and bool(tags))


def test_report_and_picture(tmp_path: Path) -> None:
    imported = read_world(extract(tmp_path / "a.osm"))
    text = world_report(imported)
    assert "(OpenStreetMap)" in text
    assert "obstacles 4 with" in text
    assert "heights   2 known, 6.0 to 10.0 m" in text
    assert "dropped   way 4: is not closed" in text
    draw_world(imported.world, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="cannot be written"):
        draw_world(imported.world, tmp_path / "none" / "a.png")


def test_cover_counts_overlaps_once(tmp_path: Path) -> None:
    path = tmp_path / "a.wkt"
    path.write_text("POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))\nPOLYGON ((1 0, 3 0, 3 2, 1 2, 1 0))\n")
    assert cover(read_world(path, ImportOptions(bounds_m=(0, 0, 2, 4))).world) == pytest.approx(0.5)


def test_a_zero_byte_in_a_tag_ends_in_one_error(tmp_path: Path) -> None:
    """libosmium keeps strings up to their zero byte: it reads past its memory and may end its process."""
    path = tmp_path / "a.osm.pbf"
    extract(tmp_path / "whole.osm.pbf")
    with osmium.SimpleWriter(osmium.io.File(str(path), "pbf,pbf_compression=none")) as writer:
        for item in osmium.FileProcessor(str(tmp_path / "whole.osm.pbf")):
            writer.add(item)
    data = path.read_bytes()
    assert b"building:levels" in data
    path.write_bytes(data.replace(b"building:levels", b"building\0levels"))
    with pytest.raises(InputError, match=r"a\.osm\.pbf: is no .*OpenStreetMap extract"):
        read_world(path)


def test_rows_are_counted_while_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    path.write_text("name,x,y\n" + "".join(f"{k},0,0\n" for k in range(9)))
    for name, value, line in (("MAX_SHAPES", 4, 6), ("MAX_VERTICES", 6, 8)):
        with monkeypatch.context() as patch:
            patch.setattr(text_shapes, name, value)
            with pytest.raises(InputError, match=f"line {line}: has more than"):
                read_world(path)


def test_a_reader_that_takes_too_long_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = extract(tmp_path / "a.osm")
    monkeypatch.setattr(osm, "MAX_OSM_S", 0.01)
    with pytest.raises(InputError, match=r"a\.osm: takes more than 0\.01 s"):
        read_world(path)


def test_control_characters_of_a_file_are_written_out(tmp_path: Path) -> None:
    path = tmp_path / "a.wkt"
    path.write_bytes(b"POLYGON ((0 0, 1 0, 1\x1b[2J 1, 0 0))")
    with pytest.raises(InputError, match=r"\\x1b\[2J") as caught:
        read_world(path)
    assert str(caught.value).isprintable()
    imported = read_world(geojson(tmp_path, feature([degrees(ROMB)], name="a\x1b[2J\nb", height="\x07")))
    assert [o.name for o in imported.world.obstacles] == ["a\\x1b[2J\\nb"]
    assert all(line.isprintable() for line in world_report(imported).split("\n"))


def test_numbers_beyond_the_floats_are_no_map(tmp_path: Path) -> None:
    path = tmp_path / "a.wkt"
    path.write_text("POLYGON ((0 0, 1e400 0, 1 1, 0 0))")
    with pytest.raises(InputError, match="finite number"):
        read_world(path)
