"""The mend: folded grids are unfolded with their boundary fixed, good ones are left alone, the energy is what it says."""

import itertools

import numpy as np
import pytest

from sandwich_sitl.channels.elliptic import solve_elliptic
from sandwich_sitl.channels.untangle import _node_energy, corner_sines, quad_sines, untangle

LEAST = 0.01
SIDES = (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1])


def lattice(m: int, n: int) -> np.ndarray:
    """Unit cells."""
    return np.stack(np.meshgrid(np.arange(m), np.arange(n), indexing="ij"), axis=-1).astype(float)


def disturbed(grid: np.ndarray, amount: float, seed: int) -> np.ndarray:
    """The grid with its inner nodes pushed about."""
    out = grid.copy()
    out[1:-1, 1:-1] += np.random.default_rng(seed).uniform(-amount, amount, out[1:-1, 1:-1].shape)
    return out


def bent(m: int, n: int) -> np.ndarray:
    """Half an annulus."""
    w = lattice(m, n) / (m - 1, n - 1)
    angle, radius = np.pi * (1 - w[..., 0]), 4 + 6 * w[..., 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def test_corner_sines_are_sines_of_the_corner_angles() -> None:
    rhombus = lattice(4, 3) @ np.array([[2.0, 1.0], [0.0, np.sqrt(3.0)]]).T
    np.testing.assert_allclose(np.abs(corner_sines(rhombus)), np.sin(np.arctan2(np.sqrt(3), 1)), atol=1e-12)
    np.testing.assert_allclose(corner_sines(lattice(5, 4)), 1.0)
    np.testing.assert_allclose(corner_sines(lattice(5, 4)[::-1]), -1.0)
    folded = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]])  # the third corner is reflex
    np.testing.assert_array_equal(quad_sines(folded) > 0, [True, True, False, True])
    np.testing.assert_array_equal(quad_sines(folded[[0, 0, 2, 3]])[:2], [-1, -1])


@pytest.mark.parametrize(
    "grid", [lattice(17, 11), bent(25, 9), lattice(21, 9) * (1.0, 6.0)], ids=["box", "arc", "tall"]
)
@pytest.mark.parametrize("seed", range(6))
def test_folded_grid_is_unfolded_with_its_boundary_fixed(grid: np.ndarray, seed: int) -> None:
    folded = disturbed(grid, 1.4, seed)
    assert (corner_sines(folded) <= 0).any()
    mended = untangle(folded, LEAST)
    assert (corner_sines(mended.xy_m) > LEAST).all()
    for side in SIDES:
        np.testing.assert_array_equal(mended.xy_m[side], folded[side])


@pytest.mark.parametrize("seed", range(4))
def test_grid_collapsed_to_random_points_is_unfolded(seed: int) -> None:
    grid = lattice(15, 13)
    grid[1:-1, 1:-1] = np.random.default_rng(seed).uniform((0, 0), (14, 12), (13, 11, 2))
    mended = untangle(grid, LEAST)
    assert (corner_sines(mended.xy_m) > LEAST).all()


def test_re_entrant_corner_at_which_central_differences_fold_is_mended() -> None:
    """A step in the wall, as high as the channel is wide above it: there the discrete map folds."""
    t = np.linspace(0, 1, 13)
    wall = np.concatenate(
        [
            np.column_stack([10 * t, 0 * t])[:-1],
            np.column_stack([10 + 0 * t, 8 * t])[:-1],
            np.column_stack([10 + 10 * t, 8 + 0 * t]),
        ]
    )
    m = len(wall)
    top = np.column_stack([np.linspace(0, 20, m), np.full(m, 12.0)])
    share = np.linspace(0, 1, 17)[None, :, None]
    solved = solve_elliptic((1 - share) * wall[:, None] + share * top[:, None], 1e-3).xy_m
    assert (corner_sines(solved) <= 0).any()
    mended = untangle(solved, LEAST)
    assert (corner_sines(mended.xy_m) > 0).all()


def test_only_the_neighbourhood_of_a_fold_moves() -> None:
    grid = lattice(61, 21)
    grid[30, 10] += (2.5, 0.0)
    mended = untangle(grid, LEAST)
    moved = (mended.xy_m != grid).any(axis=-1)
    assert (corner_sines(mended.xy_m) > LEAST).all()
    assert moved[30, 10]
    assert not moved[:20].any()
    assert not moved[40:].any()
    cells = mended.repaired
    assert not moved[1:-1, 1:-1][~(cells[1:, 1:] | cells[1:, :-1] | cells[:-1, 1:] | cells[:-1, :-1])].any()


def test_good_grid_is_left_alone() -> None:
    grid = bent(25, 9)
    mended = untangle(grid, LEAST)
    np.testing.assert_array_equal(mended.xy_m, grid)
    assert not mended.repaired.any()


def energy_of_cells(x: np.ndarray, y: np.ndarray, eps: float, area: float, aspect: float) -> float:
    """E_eps of the module's docstring over all corners of all cells, from its formula."""
    xy = np.stack([x, y], axis=-1)
    total = 0.0
    for i, j in itertools.product(range(x.shape[0] - 1), range(x.shape[1] - 1)):
        for di, dj in itertools.product((0, 1), (0, 1)):
            along = xy[i + 1, j + dj] - xy[i, j + dj]
            across = xy[i + di, j + 1] - xy[i + di, j]
            jacobian = (along[0] * across[1] - along[1] * across[0]) / area
            chi = (jacobian + np.sqrt(eps**2 + jacobian**2)) / 2
            total += (aspect * along @ along + across @ across / aspect) / area / chi
    return float(total)


@pytest.mark.parametrize("eps", [1.0, 0.3, 0.05])
@pytest.mark.parametrize("seed", range(3))
def test_energy_of_a_node_is_that_of_the_formula_and_its_gradient_the_difference_quotient(
    seed: int, eps: float
) -> None:
    grid = disturbed(lattice(3, 3), 0.9, seed)
    x, y = grid[..., 0].copy(), grid[..., 1].copy()
    area, aspect, step = 1.3, 0.7, 1e-6

    def value(at_x: float, at_y: float) -> tuple[float, ...]:
        return _node_energy(x, y, 1, 1, at_x, at_y, eps**2, area, aspect)

    found, g_x, g_y, h_xx, h_xy, h_yy = value(x[1, 1], y[1, 1])
    # Each cell's corner opposite the node does not depend on it: the node's energy leaves these four out.
    moved = grid + np.array([[[0.0, 0.0]] * 3, [[0, 0], [0.01, -0.02], [0, 0]], [[0, 0]] * 3])
    difference = energy_of_cells(moved[..., 0], moved[..., 1], eps, area, aspect) - energy_of_cells(
        x, y, eps, area, aspect
    )
    assert value(*moved[1, 1])[0] - found == pytest.approx(difference, rel=1e-8)
    at = x[1, 1], y[1, 1]
    slope_x = (value(at[0] + step, at[1])[0] - value(at[0] - step, at[1])[0]) / (2 * step)
    slope_y = (value(at[0], at[1] + step)[0] - value(at[0], at[1] - step)[0]) / (2 * step)
    scale = abs(g_x) + abs(g_y)
    assert g_x == pytest.approx(slope_x, abs=1e-6 * scale)
    assert g_y == pytest.approx(slope_y, abs=1e-6 * scale)
    assert h_xx > 0
    assert h_xx * h_yy >= h_xy**2 * (1 - 1e-9)


def test_settled_grid_is_stationary_for_the_harmonic_energy() -> None:
    """With eps = 0 the energy's stationary points are those of the harmonic functional: a lattice is one."""
    grid = lattice(5, 5)
    x, y = grid[..., 0].copy(), grid[..., 1].copy()
    _, g_x, g_y, *_ = _node_energy(x, y, 2, 2, 2.0, 2.0, 0.0, 1.0, 1.0)
    assert (g_x, g_y) == pytest.approx((0, 0), abs=1e-12)
