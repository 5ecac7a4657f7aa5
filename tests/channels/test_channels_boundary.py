"""Algorithm 1: equal arc length between fixed nodes, corners and tips kept, shared nodes on free pieces."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from world_samples import BOUNDS, grown_world, random_shapes

from sandwich_sitl.channels.boundary import along_arc, columns_needed, integer_columns, spread_nodes
from sandwich_sitl.channels.classify import classify
from sandwich_sitl.channels.dividers import Piece, lay_dividers


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


@pytest.mark.parametrize("seed", [3, 8, 12, 14, 19, 22])
def test_streamlines_keep_corners_and_share_free_nodes(seed: int) -> None:
    dividers = lay_dividers(classify(grown_world(*random_shapes(seed))), BOUNDS, 1.5)
    m_phi = max(60, columns_needed(dividers))
    for pieces in dividers:
        line = spread_nodes(pieces, BOUNDS[0], BOUNDS[2], m_phi)
        lower, upper = ({tuple(node) for node in side} for side in (line.lower, line.upper))
        for piece in pieces:
            if piece.barrier is not None:
                assert {tuple(corner) for corner in piece.lower} <= lower
                assert {tuple(corner) for corner in piece.upper} <= upper
        np.testing.assert_array_equal(line.barrier >= 0, (line.lower != line.upper).any(axis=1))
        steps = np.hypot(*np.diff(line.lower, axis=0).T)
        assert (steps > 0).all()


def test_least_columns_give_every_corner_its_own_node() -> None:
    dividers = lay_dividers(classify(grown_world(*random_shapes(12))), BOUNDS, 1.5)
    m_phi = columns_needed(dividers)
    for pieces in dividers:
        line = spread_nodes(pieces, BOUNDS[0], BOUNDS[2], m_phi)
        assert (np.hypot(*np.diff(line.lower, axis=0).T) > 0).all()
        assert (np.hypot(*np.diff(line.upper, axis=0).T) > 0).all()


def test_free_piece_keeps_its_vertices_and_is_spread_evenly_between_them() -> None:
    path = np.array([[0.0, 0.0], [30.0, 40.0], [80.0, 40.0]])
    line = spread_nodes((Piece(None, path, path),), 0.0, 80.0, 11)
    np.testing.assert_array_equal(line.lower, line.upper)
    (bend,) = np.flatnonzero((line.lower == path[1]).all(axis=1))
    for part in (line.lower[: bend + 1], line.lower[bend:]):
        np.testing.assert_allclose(
            np.diff(part, axis=0), np.broadcast_to(part[1] - part[0], (len(part) - 1, 2)), atol=1e-12
        )
