"""Algorithm 1: equal arc length between fixed nodes, corners and tips kept, shared nodes on free pieces."""

import itertools

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from world_samples import BOUNDS, grown_world, random_shapes

from sandwich_sitl.channels.boundary import along_arc, columns_needed, integer_columns, spread_nodes
from sandwich_sitl.channels.build import _barriers
from sandwich_sitl.channels.classify import classify
from sandwich_sitl.channels.dividers import Piece, lay_dividers
from sandwich_sitl.channels.stations import Stations, lay_stations
from sandwich_sitl.world.grow import snapped

CELL_M = 1.5


def arc_at(path: np.ndarray, point: np.ndarray) -> float:
    """Arc length of the point of the path that is nearest to `point`."""
    best, at, run = np.inf, 0.0, 0.0
    for a, b in itertools.pairwise(path):
        length = float(np.hypot(*(b - a)))
        share = float(np.clip((point - a) @ (b - a) / length**2, 0, 1))
        distance = float(np.hypot(*(a + share * (b - a) - point)))
        if distance < best - 1e-12:
            best, at = distance, run + share * length
        run += length
    assert best < 1e-9
    return at


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.tuples(st.floats(0.1, 5.0), st.floats(-5.0, 5.0)), min_size=1, max_size=8),
    nodes=st.integers(2, 40),
)
def test_nodes_lie_at_equal_arc_length(steps: list[tuple[float, float]], nodes: int) -> None:
    path = np.concatenate([[(0.0, 0.0)], np.cumsum(steps, axis=0)])
    points = along_arc(path, nodes)
    np.testing.assert_array_equal(points[[0, -1]], path[[0, -1]])
    total = float(np.hypot(*np.diff(path, axis=0).T).sum())
    np.testing.assert_allclose([arc_at(path, p) for p in points], np.linspace(0, total, nodes), atol=1e-9 * total)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), least=st.lists(st.integers(1, 5), min_size=1, max_size=6), spare=st.integers(0, 20))
def test_integer_columns_keep_order_and_room(data: st.DataObject, least: list[int], spare: int) -> None:
    last = sum(least) + spare
    inner = data.draw(st.lists(st.floats(0, last), min_size=len(least) - 1, max_size=len(least) - 1))
    wishes = np.array([0.0, *sorted(inner), last])
    columns = integer_columns(wishes, least, last)
    assert (columns[0], columns[-1]) == (0, last)
    assert (np.diff(columns) >= least).all()


@pytest.mark.parametrize("seed", range(5))
def test_integer_columns_are_nearest_to_the_wishes(seed: int) -> None:
    """Against a general least-squares solver, up to rounding."""
    rng = np.random.default_rng(seed)
    least = rng.integers(1, 4, 5)
    last = int(least.sum()) + 12
    wishes = np.concatenate([[0.0], np.sort(rng.uniform(0, last, 4)), [last]])
    gaps = {"type": "ineq", "fun": lambda c: np.diff(np.concatenate([[0.0], c, [last]])) - least}
    start = np.cumsum(least)[:-1] + 12 * np.arange(1, 5) / 5
    best = minimize(lambda c: ((c - wishes[1:-1]) ** 2).sum(), start, constraints=[gaps], options={"ftol": 1e-12}).x
    assert np.abs(integer_columns(wishes, least.tolist(), last)[1:-1] - best).max() <= 0.5 + 1e-4


def laid(seed: int) -> tuple[tuple[tuple[Piece, ...], ...], Stations]:
    """Dividing streamlines and stations of the seed's world, as the map lays them."""
    grown = snapped(grown_world(*random_shapes(seed)))
    barriers, _, _ = _barriers(grown, CELL_M)
    dividers = lay_dividers(classify(barriers, BOUNDS[1], BOUNDS[3], CELL_M), BOUNDS, CELL_M)
    return dividers, lay_stations([shapely.Polygon(barrier.ring_m) for barrier in barriers], BOUNDS)


@pytest.mark.parametrize("seed", [3, 8, 12, 14, 19, 22])
@pytest.mark.parametrize("spare", [0, 40])
def test_streamlines_keep_corners_and_share_free_nodes(seed: int, spare: int) -> None:
    dividers, stations = laid(seed)
    m_phi = columns_needed(dividers, CELL_M) + spare
    for pieces in dividers:
        line = spread_nodes(pieces, stations, m_phi, CELL_M)
        lower, upper = ({tuple(node) for node in side} for side in (line.lower, line.upper))
        for piece in pieces:
            assert {tuple(corner) for corner in piece.lower} <= lower
            assert {tuple(corner) for corner in piece.upper} <= upper
        np.testing.assert_array_equal(line.barrier >= 0, (line.lower != line.upper).any(axis=1))
        for side, paths in (
            (line.lower, [piece.lower for piece in pieces]),
            (line.upper, [piece.upper for piece in pieces]),
        ):
            assert (np.hypot(*np.diff(side, axis=0).T) > 0).all()
            whole = shapely.union_all([shapely.LineString(path) for path in paths])
            assert shapely.distance(whole, shapely.points(side)).max() < 1e-9
            # Nodes in order along it: the polyline through them is no longer than the streamline.
            assert np.hypot(*np.diff(side, axis=0).T).sum() == pytest.approx(whole.length)


def test_nodes_of_a_wall_carry_its_barrier() -> None:
    dividers, stations = laid(12)
    for pieces in dividers[1:-1]:
        line = spread_nodes(pieces, stations, columns_needed(dividers, CELL_M) + 10, CELL_M)
        walls = {piece.barrier.index: piece for piece in pieces if piece.barrier is not None}
        assert set(line.barrier[line.barrier >= 0]) == set(walls)
        for index, piece in walls.items():
            at = line.barrier == index
            for nodes, path in ((line.lower[at], piece.lower), (line.upper[at], piece.upper)):
                assert shapely.distance(shapely.LineString(path), shapely.points(nodes)).max() < 1e-9


def test_free_piece_keeps_its_vertices_and_is_spread_evenly_between_them() -> None:
    """In an open world the station is x, in which a straight stretch is even."""
    path = np.array([[0.0, 0.0], [30.0, 40.0], [80.0, 40.0]])
    line = spread_nodes((Piece(None, path, path),), lay_stations([], (0.0, 0.0, 80.0, 50.0)), 11, 8.0)
    np.testing.assert_array_equal(line.lower, line.upper)
    (bend,) = np.flatnonzero((line.lower == path[1]).all(axis=1))
    for part in (line.lower[: bend + 1], line.lower[bend:]):
        np.testing.assert_allclose(
            np.diff(part, axis=0), np.broadcast_to(part[1] - part[0], (len(part) - 1, 2)), atol=1e-12
        )


def test_nodes_lie_closer_where_stations_rise_faster() -> None:
    """Half of the spacing follows the station: in a throat whose station rises three times as fast, nodes are denser."""
    stations = Stations((0.0, 0.0, 80.0, 10.0), np.repeat(np.array([0.0, 0.125, 0.875, 1.0])[:, None], 3, axis=1))
    path = np.array([[0.0, 5.0], [80.0, 5.0]])
    x = spread_nodes((Piece(None, path, path),), stations, 81, 1.0).lower[:, 0]
    third = 80 / 3
    inside = np.diff(x[(x > third + 1) & (x < 2 * third - 1)])
    outside = np.diff(x[x < third - 1])
    # Progress rises by (1/80 + station') / 2 a metre: station' = 0.75 / third in the throat, 0.125 / third before it.
    ratio = (1 / 80 + 0.125 / third) / (1 / 80 + 0.75 / third)
    np.testing.assert_allclose(inside, inside[0], rtol=1e-6)
    assert inside[0] / outside[0] == pytest.approx(ratio, rel=0.02)
