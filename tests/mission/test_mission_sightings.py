"""What a range sensor sees: outlines hold what was seen, convex, and nothing where everything is known."""

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from sandwich_sitl.config import ReplanConfig
from sandwich_sitl.mission.sightings import Explained, unexplained
from sandwich_sitl.mission.vehicle_view import RangeScan

CONFIG = ReplanConfig()
ORIGIN = np.array([10.0, 20.0])


def scan_of(bodies: list[Polygon], sectors: int = 72, reach_m: float = 20.0) -> RangeScan:
    """A perfect sweep from ORIGIN, by shapely: the nearest point of each sector's middle ray."""
    bearings = -np.arange(sectors) * 2 * np.pi / sectors + 0.3
    ranges = np.full(sectors, np.inf)
    for k, bearing in enumerate(bearings):
        ray = shapely.LineString([ORIGIN, ORIGIN + reach_m * np.array([np.cos(bearing), np.sin(bearing)])])
        met = [ray.intersection(body) for body in bodies if ray.intersects(body)]
        ranges[k] = min((shapely.Point(ORIGIN).distance(part) for part in met), default=np.inf)
    return RangeScan(1.0, ORIGIN, bearings, 2 * np.pi / sectors, ranges)


def seen_points(scan: RangeScan) -> list[shapely.Point]:
    hit = np.isfinite(scan.ranges_m)
    rays = np.column_stack([np.cos(scan.bearings_rad), np.sin(scan.bearings_rad)])
    return list(shapely.points((scan.origin_m + scan.ranges_m[:, None] * rays)[hit]))


@pytest.mark.parametrize(
    ("bodies", "pieces"),
    [
        ([], 0),
        ([box(18, 16, 19, 25)], 1),
        ([box(18, 16, 19, 25), box(2, 18, 3, 22)], 2),
        ([shapely.Point(16, 20).buffer(0.3)], 1),
        ([Polygon([(15, 15), (25, 15), (25, 28), (22, 28), (22, 18), (15, 18)])], 4),  # two faces each of two arms
        ([box(12, 15, 14, 25)], 1),
    ],
    ids=["nothing", "wall", "two", "pole", "corner", "near"],
)
def test_outlines_are_convex_and_hold_what_was_seen(bodies: list[Polygon], pieces: int) -> None:
    scan = scan_of(bodies)
    outlines = unexplained(scan, Explained.by([]), CONFIG)
    assert len(outlines) == pieces
    for outline in outlines:
        assert outline.is_valid
        assert outline.convex_hull.area == pytest.approx(outline.area)
    seen, whole = shapely.MultiPoint(seen_points(scan)), shapely.union_all(outlines)
    for point in seen.geoms:
        assert whole.distance(point) < 1e-6
    furthest = max((float(np.hypot(*(np.array(point.coords[0]) - ORIGIN))) for point in seen.geoms), default=0.0)
    for corner in shapely.points(shapely.get_coordinates(whole)):
        # The depth behind, and half a sector to the side.
        assert seen.distance(corner) <= CONFIG.sensor_depth_m + (furthest + 1) * np.tan(scan.width_rad / 2)


def test_a_seam_in_the_middle_of_a_wall_does_not_cut_it() -> None:
    scan = scan_of([box(18, 16, 19, 25)])
    turned = RangeScan(1.0, ORIGIN, np.roll(scan.bearings_rad, 36), scan.width_rad, np.roll(scan.ranges_m, 36))
    first, second = (shapely.union_all(unexplained(s, Explained.by([]), CONFIG)) for s in (scan, turned))
    assert first.symmetric_difference(second).area < 1e-9


def test_known_obstacles_explain_their_returns_and_no_others() -> None:
    known = [box(18, 16, 19, 25), box(2, 18, 3, 22)]
    assert unexplained(scan_of(known), Explained.by(known), CONFIG) == []
    shifted = [shapely.affinity.translate(body, 0.4, 0) for body in known]
    assert unexplained(scan_of(shifted), Explained.by(known), CONFIG) == []
    newcomer = box(9, 26, 11, 27)
    (outline,) = unexplained(scan_of([*known, newcomer]), Explained.by(known), CONFIG)
    assert outline.intersects(newcomer)
    assert not any(outline.intersects(body) for body in known)


def test_an_outline_explains_the_next_scan() -> None:
    body = box(18, 16, 19, 25)
    seen = unexplained(scan_of([body]), Explained.by([]), CONFIG)
    assert unexplained(scan_of([body]), Explained.by(seen), CONFIG) == []


def test_unknown_and_empty_sectors_say_nothing() -> None:
    scan = RangeScan(1.0, ORIGIN, np.zeros(3), 0.1, np.array([np.inf, np.nan, np.inf]))
    assert unexplained(scan, Explained.by([]), CONFIG) == []
    assert unexplained(RangeScan(1.0, ORIGIN, np.empty(0), 0.1, np.empty(0)), Explained.by([]), CONFIG) == []
