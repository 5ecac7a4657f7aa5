"""Distances to prisms against points sampled in them."""

import numpy as np
import pytest
import shapely

from sandwich_sitl.planning.prisms import Prisms

RINGS = (np.array([[0.0, 0], [4, 0], [4, 3], [0, 3]]), np.array([[10.0, 0], [14, 1], [11, 5]]))
HEIGHTS = np.array([2.0, 7.0])


def sampled(count: int) -> np.ndarray:
    """Points (n, 3) all over the surface and inside of both prisms, corners among them."""
    random = np.random.default_rng(0)
    clouds = []
    for ring, height in zip(RINGS, HEIGHTS, strict=True):
        xy = random.dirichlet(np.full(len(ring), 0.3), count) @ ring
        z = height * np.clip(random.uniform(-0.2, 1.2, count), 0.0, 1.0)
        clouds.append(np.column_stack([xy, z]))
        clouds.append(np.column_stack([ring, np.full(len(ring), height)]))
    return np.concatenate(clouds)


def test_the_distance_of_a_point_is_that_to_the_nearest_point_of_a_prism() -> None:
    cloud, random = sampled(40_000), np.random.default_rng(1)
    points = random.uniform((-4, -4, 0), (18, 9, 12), (60, 3))
    nearest = np.array([np.linalg.norm(cloud - p, axis=1).min() for p in points])
    found = Prisms(RINGS, HEIGHTS).distance_m(points)
    inside = found == 0.0
    assert (found <= nearest + 1e-9).all()
    np.testing.assert_allclose(found[~inside], nearest[~inside], atol=0.12)
    assert inside.any()


def test_without_a_top_it_is_the_distance_in_plan() -> None:
    points = np.random.default_rng(2).uniform((-4, -4, 0), (18, 9, 50), (50, 3))
    union = shapely.union_all([shapely.Polygon(ring) for ring in RINGS])
    plan = shapely.distance(union, shapely.points(points[:, :2]))
    np.testing.assert_array_equal(Prisms(RINGS, np.array([np.inf, np.inf])).distance_m(points), plan)
    assert Prisms((), np.empty(0)).distance_m(points).min() == np.inf


@pytest.mark.parametrize("height_m", [2.0, 9.0])
def test_one_that_joins_counts_as_if_it_had_been_there(height_m: float) -> None:
    points = np.random.default_rng(3).uniform((-4, -4, 0), (18, 9, 12), (50, 3))
    ring, before = np.array([[3.0, 2], [7, 2], [7, 6]]), Prisms(RINGS, HEIGHTS)
    alone = before.distance_m(points)
    joined = before.joined_by(ring, height_m).distance_m(points)
    np.testing.assert_allclose(
        joined, Prisms([*RINGS, ring], np.append(HEIGHTS, height_m)).distance_m(points), atol=1e-12
    )
    assert (joined < alone).any()
    np.testing.assert_array_equal(before.distance_m(points), alone)


def test_a_path_is_as_near_as_its_nearest_point() -> None:
    prisms = Prisms(RINGS, HEIGHTS)
    over = np.array([[-3.0, 1.5, 2.5], [8.0, 1.5, 3.5]])
    assert prisms.distance_of_path_m(over) == pytest.approx(
        prisms.distance_m(np.linspace(*over, 20_001)).min(), abs=1e-5
    )
    assert prisms.distance_of_path_m(over) == pytest.approx(0.775, abs=0.01)  # above the first box's edge at x = 0
    assert prisms.distance_of_path_m(np.array([[-3.0, 1.5, 1.9], [8.0, 1.5, 1.9]])) == 0.0
    assert prisms.distance_of_path_m(np.array([[12.0, 2.0, 9.0]])) == pytest.approx(2.0)
    flat = Prisms(RINGS, np.array([np.inf, np.inf]))
    assert flat.distance_of_path_m(np.array([[7.0, -5.0], [7.0, 8.0]])) == pytest.approx(3.0)
