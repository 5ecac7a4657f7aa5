"""Stations against potentials known in closed form, and the flux through every section."""

import numpy as np
import pytest
from shapely import Polygon, box
from world_samples import disc

from sandwich_sitl.channels.stations import _potential, lay_stations

BOUNDS = (10.0, -20.0, 110.0, 40.0)


def points_in(bounds: tuple[float, float, float, float], count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(bounds[:2], bounds[2:], (count, 2))


def test_open_world_has_stations_proportional_to_x() -> None:
    points = points_in(BOUNDS, 300)
    stations = lay_stations([], BOUNDS)
    np.testing.assert_allclose(stations.at(points), (points[:, 0] - 10) / 100, atol=1e-12)


@pytest.mark.parametrize(
    "shape", [box(40, -5, 60, 20), Polygon([(30, -20), (60, -20), (50, 30)]), disc(60, 10, 15, 40)]
)
def test_stations_run_from_zero_to_one(shape: Polygon) -> None:
    stations = lay_stations([shape], BOUNDS)
    y = np.linspace(-20, 40, 50)
    np.testing.assert_allclose(stations.at(np.column_stack([np.full(50, 10.0), y])), 0, atol=1e-12)
    np.testing.assert_allclose(stations.at(np.column_stack([np.full(50, 110.0), y])), 1, atol=1e-12)
    inner = stations.values[1:-1]
    assert 0 < inner.min() < inner.max() < 1


def test_resistances_in_series_by_hand() -> None:
    """Slabs across the flow: the potential falls in proportion to the resistances up to each raster point."""
    sigma = np.repeat(np.array([1.0, 1.0, 0.25, 0.25, 0.25, 1.0, 0.5])[:, None], 5, axis=1)
    resistance = np.concatenate([[0.0], np.cumsum((1 / sigma[1:, 0] + 1 / sigma[:-1, 0]) / 2)])
    expected = np.repeat((resistance / resistance[-1])[:, None], 5, axis=1)
    np.testing.assert_allclose(_potential(sigma, 0.7), expected, atol=1e-12)


def test_layers_along_the_flow_leave_it_straight() -> None:
    sigma = np.repeat(np.array([1.0, 0.01, 0.01, 1.0, 0.3])[None], 9, axis=0)
    np.testing.assert_allclose(_potential(sigma, 1.3), np.repeat(np.linspace(0, 1, 9)[:, None], 5, axis=1), atol=1e-12)


def test_disc_in_the_middle_is_a_dipole() -> None:
    """phi = x (1 - (s - 1) / (s + 1) R^2 / r^2) outside a disc of conductivity s in an unbounded uniform field.

    The box repeats the disc by mirror images, which add at most (pi / 4) R^2 x; a disc of raster squares has its radius
    to within half a square.
    """
    n, radius, inside = 201, 0.12, 0.01
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    r = np.hypot(x, y)
    phi = 2 * _potential(np.where(r < radius, inside, 1.0), 1.0) - 1
    ring = (r > 1.5 * radius) & (r < 3 * radius)
    dipole = -x[ring] * (inside - 1) / (inside + 1) * radius**2 / r[ring] ** 2
    images = np.pi / 4 * radius**2 * 3 * radius
    squares = dipole.max() * 2 * (0.5 * 2 / (n - 1)) / radius
    assert images + squares < 0.2 * dipole.max()
    np.testing.assert_allclose((phi - x)[ring], dipole, atol=images + squares)


def test_flux_is_the_same_through_every_section() -> None:
    rng = np.random.default_rng(2)
    sigma = np.where(rng.random((40, 25)) < 0.3, 0.01, 1.0)
    phi = _potential(sigma, 1.0)
    face = 2 * sigma[1:] * sigma[:-1] / (sigma[1:] + sigma[:-1])
    face[:, [0, -1]] /= 2
    flux = (face * np.diff(phi, axis=0)).sum(axis=1)
    np.testing.assert_allclose(flux, flux.mean(), rtol=1e-9)


def test_free_points_have_the_mean_of_their_neighbours() -> None:
    sigma = np.ones((30, 30))
    sigma[10:18, 5:20] = 0.01
    phi = _potential(sigma, 1.0)
    mean = (phi[:-2, 1:-1] + phi[2:, 1:-1] + phi[1:-1, :-2] + phi[1:-1, 2:]) / 4
    alone = np.ones((28, 28), dtype=bool)
    alone[8:18, 3:20] = False
    np.testing.assert_allclose(phi[1:-1, 1:-1][alone], mean[alone], atol=1e-10)
