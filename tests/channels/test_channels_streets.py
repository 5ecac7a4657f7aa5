"""Which slots get lids: those deep for their width, by hand and by measuring every lid that is laid."""

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box
from world_samples import sample_world

from sandwich_sitl.channels.outline import Outline, outline_of
from sandwich_sitl.channels.streets import find_lids

BOUNDS = (0.0, 0.0, 100.0, 60.0)


def outline(shape: Polygon) -> Outline:
    return outline_of(
        [shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1]], np.empty((0, 2, 2)), BOUNDS
    )


def notched(width: float, depth: float, *, below: bool) -> Outline:
    slot = box(50 - width / 2, 20, 50 + width / 2, 20 + depth)
    slot = slot if below else box(50 - width / 2, 40 - depth, 50 + width / 2, 40)
    return outline(box(30, 20, 70, 40).difference(slot))


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize(("width", "depth", "shut"), [(4, 10, True), (4, 3.3, True), (4, 3.1, False), (12, 4, False)])
def test_notch_is_shut_from_a_depth_of_eight_tenths_of_its_width(
    width: float, depth: float, shut: bool, below: bool
) -> None:
    found = find_lids([notched(width, depth, below=below)], BOUNDS)
    if not shut:
        assert found == []
        return
    (lids,) = found
    assert (lids.a, lids.b) == (0, 0)
    mouth = 20 if below else 40
    np.testing.assert_allclose(lids.segments, [[[50 - width / 2, mouth], [50 + width / 2, mouth]]])


def test_wedge_is_shut_at_the_height_where_it_is_deep_enough() -> None:
    """A V 10 m deep and 16 m wide is too shallow for its mouth; narrower steps further down count for themselves."""
    funnel = Polygon(
        [(30, 20), (70, 20), (70, 40), (58, 40), (52, 36), (52, 26), (48, 26), (48, 36), (42, 40), (30, 40)]
    )
    ((segment,),) = [lids.segments for lids in find_lids([outline(funnel)], BOUNDS)]
    np.testing.assert_allclose(segment, [[42, 40], [58, 40]])
    shallow = Polygon(
        [(30, 20), (70, 20), (70, 40), (64, 40), (52, 36), (52, 26), (48, 26), (48, 36), (36, 40), (30, 40)]
    )
    ((segment,),) = [lids.segments for lids in find_lids([outline(shallow)], BOUNDS)]
    np.testing.assert_allclose(segment, [[48, 36], [52, 36]])


@pytest.mark.parametrize(("gap", "shut"), [(4.0, True), (12.0, True), (13.0, False), (30.0, False)])
def test_street_between_two_blocks_has_two_lids_from_twice_that_depth(gap: float, shut: bool) -> None:
    blocks = [outline(box(30 - gap / 2, 20, 40 - gap / 2, 40)), outline(box(40 + gap / 2, 20, 50 + gap / 2, 40))]
    found = [lids for lids in find_lids(blocks, BOUNDS) if lids.a != lids.b]
    if not shut:
        assert found == []
        return
    (lids,) = found
    ends = [[40 - gap / 2, y] for y in (20, 40)]
    np.testing.assert_allclose(sorted(lids.segments.tolist()), [[[x, y], [x + gap, y]] for x, y in ends])


def test_no_street_through_a_third_block() -> None:
    blocks = [outline(box(20, 20, 30, 40)), outline(box(40, 20, 50, 40)), outline(box(33, 25, 37, 35))]
    streets = {(lids.a, lids.b) for lids in find_lids(blocks, BOUNDS)}
    assert (0, 1) not in streets
    assert {(0, 2), (2, 1)} <= streets


def test_street_along_the_border_needs_no_lid_where_it_ends_blindly() -> None:
    """A block 4 m off the left border, standing on a foot that touches it: one lid, at the top."""
    block = Polygon([(0, 10), (20, 10), (20, 40), (4, 40), (4, 14), (0, 14)])
    found = find_lids([outline(block)], BOUNDS)
    segments = np.concatenate([lids.segments for lids in found])
    np.testing.assert_allclose(segments, [[[0, 40], [4, 40]]])


@pytest.mark.parametrize("seed", [2, 3, 17, 20, 22, 35])
def test_lids_are_level_and_span_free_ground_between_their_outlines(seed: int) -> None:
    rings = sample_world(seed).grown.rings_m()
    outlines = [outline_of([ring], np.empty((0, 2, 2)), (0, 0, 100, 60)) for ring in rings]
    wholes = [Polygon(o.ring()) for o in outlines]
    assert shapely.union_all(wholes).area == pytest.approx(sum(whole.area for whole in wholes))
    solid = shapely.union_all([whole.buffer(-1e-6) for whole in wholes])
    found = find_lids(outlines, (0, 0, 100, 60))
    assert found
    for lids in found:
        for segment in lids.segments:
            assert segment[0, 1] == segment[1, 1]
            assert segment[0, 0] < segment[1, 0]
            assert LineString(segment).intersection(solid).is_empty
            for end, k in zip(segment, (lids.a, lids.b), strict=True):
                on_border = end[0] in (0.0, 100.0)
                assert on_border or wholes[k].exterior.distance(shapely.Point(end)) < 1e-6
