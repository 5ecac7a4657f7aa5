"""Eq. (ellipticpde) on channels whose map is known in closed form, and under refinement."""

import itertools

import numpy as np
import pytest
from map_laws import second_differences

from sandwich_sitl.channels.elliptic import MOST_CYCLES, interpolate, residual, solve_elliptic


def lattice(m: int, n: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.linspace(0, 1, m), np.linspace(0, 1, n), indexing="ij"), axis=-1)


def disturbed(grid: np.ndarray, amount: float, seed: int = 0) -> np.ndarray:
    """The grid with its inner nodes pushed about."""
    out = grid.copy()
    out[1:-1, 1:-1] += np.random.default_rng(seed).uniform(-amount, amount, out[1:-1, 1:-1].shape)
    return out


MATRICES = {
    "square": np.eye(2),
    "stretched": np.diag([12.0, 3.0]),
    "sheared": np.array([[5.0, 2.0], [0.0, 3.0]]),
    "turned": np.array([[3.0, -2.0], [2.0, 4.0]]),
}


@pytest.mark.parametrize("shape", [(17, 9), (33, 5), (14, 8), (65, 33)])
@pytest.mark.parametrize("name", MATRICES)
def test_linear_maps_are_solutions(name: str, shape: tuple[int, int]) -> None:
    """Rectangles, stretched, sheared and turned boxes: the grid is the image of the lattice."""
    exact = lattice(*shape) @ MATRICES[name].T
    assert residual(exact).max() < 1e-12
    solved = solve_elliptic(disturbed(exact, 0.3 / max(shape)), 1e-9)
    assert solved.residual_m <= 1e-9
    np.testing.assert_allclose(solved.xy_m, exact, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_residual_is_that_of_the_finite_difference_formula(seed: int) -> None:
    grid = disturbed(lattice(12, 9) * (11.0, 20.0), 0.4, seed)
    found = residual(grid)
    np.testing.assert_allclose(found[1:-1, 1:-1], second_differences(grid), atol=1e-12)
    found[1:-1, 1:-1] = 0
    assert not found.any()


def sector(m: int, n: int) -> np.ndarray:
    """exp of a rectangle: the conformal map onto an annulus sector, left to right."""
    w = lattice(m, n)
    angle, radius = np.pi * (1 - w[..., 0]), np.exp(w[..., 1])
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def test_annulus_sector_converges_to_the_conformal_map_at_second_order() -> None:
    errors, residuals = [], []
    for m, n in ((13, 5), (25, 9), (49, 17), (97, 33)):
        exact = sector(m, n)
        start = interpolate(exact[:, 0], exact[:, -1], n)
        start[[0, -1]] = exact[[0, -1]]
        solved = solve_elliptic(start, 1e-8)
        assert solved.residual_m <= 1e-8
        errors.append(np.abs(solved.xy_m - exact).max())
        residuals.append(residual(exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders[1:] > 1.7).all()
    assert errors[-1] < 1e-3
    # The residual is scaled by the squared spacing: fourth order for the exact solution.
    assert np.log2(residuals[-2] / residuals[-1]) > 3.5


def wavy(m: int, n: int) -> np.ndarray:
    """Start grid of a channel with smooth, different sides and straight ends."""
    x = np.linspace(0, 40, m)
    bottom = np.column_stack([x, 2 * np.sin(np.pi * x / 20) ** 2])
    return interpolate(bottom, np.column_stack([x, 10 + np.sin(np.pi * x / 40) ** 2]), n)


def test_refinement_converges_at_second_order_on_a_smooth_channel() -> None:
    """Differences between successive refinements, at the nodes of the coarsest grid, fall fourfold."""
    grids = [solve_elliptic(wavy(16 * k + 1, 4 * k + 1), 1e-9).xy_m[::k, ::k] for k in (1, 2, 4, 8, 16)]
    changes = np.array([np.abs(b - a).max() for a, b in itertools.pairwise(grids)])
    orders = np.log2(changes[:-1] / changes[1:])
    assert (orders[1:] > 1.8).all()
    assert (orders[1:] < 2.3).all()


def test_solution_keeps_its_boundary_and_satisfies_the_equation() -> None:
    start = wavy(81, 17)
    solved = solve_elliptic(start, 1e-9)
    for side in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        np.testing.assert_array_equal(solved.xy_m[side], start[side])
    assert second_differences(solved.xy_m).max() < 2e-9
    assert solved.cycles > 0


def test_number_of_cycles_does_not_grow_with_the_grid() -> None:
    cycles = [solve_elliptic(wavy(32 * k + 1, 8 * k + 1), 1e-6 / k).cycles for k in (1, 2, 4, 8)]
    assert max(cycles) <= MOST_CYCLES - 2
    assert cycles[-1] <= cycles[0] + 3


def test_symmetric_bump_gives_a_symmetric_grid() -> None:
    x = np.linspace(-20, 20, 41)
    bottom = np.column_stack([x, 3 * np.exp(-((x / 6) ** 2))])
    solved = solve_elliptic(interpolate(bottom, np.column_stack([x, np.full(41, 12.0)]), 13), 1e-10)
    assert solved.residual_m <= 1e-10
    np.testing.assert_allclose(solved.xy_m, solved.xy_m[::-1] * (-1, 1), atol=1e-7)
    lifted = solved.xy_m[:, 1:-1, 1] - np.linspace(0, 12, 13)[1:-1]
    assert (lifted[1:-1] > 0).all()


def test_solution_turns_and_scales_with_its_boundary() -> None:
    start = wavy(49, 9)
    turn = 2.5 * np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    here, there = solve_elliptic(start, 1e-10).xy_m, solve_elliptic(start @ turn.T, 1e-10).xy_m
    np.testing.assert_allclose(there, here @ turn.T, atol=1e-7)


def test_straight_columns_join_the_two_sides() -> None:
    grid = wavy(9, 5)
    np.testing.assert_allclose(grid[:, 1], 0.75 * grid[:, 0] + 0.25 * grid[:, -1])
