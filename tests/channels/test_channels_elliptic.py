"""Eq. (ellipticpde) on channels whose map is known, and the mend of folded grids."""

import numpy as np
import pytest

from sandwich_sitl.channels.elliptic import interpolate, residual, solve_elliptic
from sandwich_sitl.channels.untangle import corner_sines, untangle


def lattice(m: int, n: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.linspace(0, 1, m), np.linspace(0, 1, n), indexing="ij"), axis=-1)


def disturbed(grid: np.ndarray, amount: float, seed: int = 0) -> np.ndarray:
    """The grid with its inner nodes pushed about."""
    out = grid.copy()
    out[1:-1, 1:-1] += np.random.default_rng(seed).uniform(-amount, amount, out[1:-1, 1:-1].shape)
    return out


@pytest.mark.parametrize(
    "matrix",
    [np.eye(2), np.diag([12.0, 3.0]), np.array([[5.0, 2.0], [0.0, 3.0]]), np.array([[3.0, -2.0], [2.0, 4.0]])],
    ids=["square", "stretched", "sheared", "turned"],
)
def test_linear_maps_are_solutions(matrix: np.ndarray) -> None:
    exact = lattice(13, 8) @ matrix.T
    assert residual(exact).max() < 1e-12
    solved = solve_elliptic(disturbed(exact, 0.02), 1e-12)
    np.testing.assert_allclose(solved.xy_m, exact, atol=1e-9)


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
        solved = solve_elliptic(start, 1e-10).xy_m
        errors.append(np.abs(solved - exact).max())
        residuals.append(residual(exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders[1:] > 1.7).all()
    assert errors[-1] < 1e-3
    # The residual is scaled by the squared spacing: fourth order for the exact solution.
    assert np.log2(residuals[-2] / residuals[-1]) > 3.5


def test_solution_keeps_its_boundary_and_satisfies_the_equation() -> None:
    x = np.linspace(0, 40, 61)
    bottom, top = np.column_stack([x, 2 * np.sin(x / 5)]), np.column_stack([x, 10 + np.cos(x / 7)])
    start = interpolate(bottom, top, 15)
    solved = solve_elliptic(start, 1e-9)
    for side in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        np.testing.assert_array_equal(solved.xy_m[side], start[side])
    assert residual(solved.xy_m).max() < 1e-8
    assert solved.last_move_m < 1e-9


def test_symmetric_bump_gives_a_symmetric_grid() -> None:
    x = np.linspace(-20, 20, 41)
    bottom = np.column_stack([x, 3 * np.exp(-((x / 6) ** 2))])
    grid = solve_elliptic(interpolate(bottom, np.column_stack([x, np.full(41, 12.0)]), 13), 1e-10).xy_m
    np.testing.assert_allclose(grid, grid[::-1] * (-1, 1), atol=1e-8)


def test_solution_turns_and_scales_with_its_boundary() -> None:
    x = np.linspace(0, 30, 31)
    bottom, top = np.column_stack([x, np.sin(x / 4)]), np.column_stack([x, 8 + 0.5 * np.sin(x / 3)])
    here = solve_elliptic(interpolate(bottom, top, 9), 1e-11).xy_m
    turn = 2.5 * np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    there = solve_elliptic(interpolate(bottom @ turn.T, top @ turn.T, 9), 1e-11).xy_m
    np.testing.assert_allclose(there, here @ turn.T, atol=1e-8)


def test_corner_sines_are_sines_of_the_corner_angles() -> None:
    rhombus = lattice(4, 3) @ np.array([[2.0, 1.0], [0.0, np.sqrt(3.0)]]).T
    np.testing.assert_allclose(np.abs(corner_sines(rhombus)), np.sin(np.arctan2(np.sqrt(3), 1)), atol=1e-12)
    np.testing.assert_allclose(corner_sines(lattice(5, 4)), 1.0)
    np.testing.assert_allclose(corner_sines(lattice(5, 4)[::-1]), -1.0)


@pytest.mark.parametrize("seed", range(6))
def test_folded_grid_is_unfolded_with_its_boundary_fixed(seed: int) -> None:
    grid = disturbed(lattice(17, 11) * (16.0, 10.0), 1.4, seed)
    assert (corner_sines(grid) <= 0).any()
    mended = untangle(grid, 0.01)
    assert (corner_sines(mended.xy_m) >= 0.01).all()
    for side in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        np.testing.assert_array_equal(mended.xy_m[side], grid[side])


def test_only_the_neighbourhood_of_a_fold_moves() -> None:
    grid = lattice(61, 21) * (60.0, 20.0)
    grid[30, 10] += (2.5, 0.0)
    mended = untangle(grid, 0.01)
    moved = (mended.xy_m != grid).any(axis=-1)
    assert (corner_sines(mended.xy_m) >= 0.01).all()
    assert moved[30, 10]
    assert not moved[:20].any()
    assert not moved[40:].any()
    cells = mended.repaired
    assert not moved[1:-1, 1:-1][~(cells[1:, 1:] | cells[1:, :-1] | cells[:-1, 1:] | cells[:-1, :-1])].any()


def test_good_grid_is_left_alone() -> None:
    grid = sector(25, 9)
    mended = untangle(grid, 0.01)
    np.testing.assert_array_equal(mended.xy_m, grid)
    assert not mended.repaired.any()


@pytest.mark.parametrize("eps", [1.0, 0.1, 0.01])
def test_energy_gradient_agrees_with_finite_differences(eps: float) -> None:
    from sandwich_sitl.channels import untangle as module

    rng = np.random.default_rng(3)
    nodes = rng.uniform(0, 3, (12, 2))
    triangles = np.array([rng.choice(12, 3, replace=False) for _ in range(20)])
    movable = np.arange(12) % 3 > 0
    energy = module._Energy(nodes, triangles, rng.choice([-1.0, 1.0], 20), rng.uniform(0.5, 2, (20, 2)), movable)
    energy._eps = eps
    at = nodes[movable].ravel()
    _, gradient = energy._value(at)
    step = 1e-6
    numeric = [
        (energy._value(at + step * unit)[0] - energy._value(at - step * unit)[0]) / (2 * step)
        for unit in np.eye(len(at))
    ]
    np.testing.assert_allclose(gradient, numeric, rtol=2e-4, atol=1e-5 * np.abs(gradient).max())
