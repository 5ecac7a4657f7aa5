"""The snap-driven plant against the exact quadruple integrator, and yaw as a double integrator with the step in its B."""

from math import cos, factorial, sin

import numpy as np
import pytest

from vehicle_sim.snap_plant import (
    SingularPlantError,
    SnapBody,
    SnapState,
    acceleration_mps2,
    closed_yaw_matrix,
    hover_state,
    jerk_mps3,
    linearising_input,
    plant_derivative,
    step_snap,
    yaw_and_rate,
    yaw_matrices,
)

BODY = SnapBody()


def snap_command(k: int) -> np.ndarray:
    """A vigorous manoeuvre: tilts to about 35 degrees and turns while it climbs."""
    t = 0.05 * k
    return np.array([30.0 * cos(3.0 * t), 22.0 * sin(2.5 * t), 6.0 * cos(2.0 * t)])


def chain_step(chain: np.ndarray, u: np.ndarray, h: float) -> np.ndarray:
    """Exact quadruple integrator, rows r, v, a, j."""
    full = np.vstack([chain, u])
    return np.array([sum(full[i + k] * h**k / factorial(k) for k in range(5 - i)) for i in range(4)])


def test_plant_is_the_quadruple_integrator_over_a_manoeuvre() -> None:
    x = hover_state(np.array([1.0, 2.0, 3.0]), BODY)
    chain = np.array([[1.0, 2.0, 3.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]], float)
    yaw, yaw_rate, tilt = 0.0, 0.0, 0.0
    for k in range(60):
        u, v = snap_command(k), 0.8 * cos(0.2 * k)
        for _ in range(10):
            x = step_snap(x, u, v, BODY, 0.005)
        chain = chain_step(chain, u, 0.05)
        yaw, yaw_rate = yaw + 0.05 * yaw_rate + v * 0.05**2 / 2, yaw_rate + 0.05 * v
        tilt = max(tilt, float(np.arccos(x.R_wb[2, 2])))
        got = np.array([x.position_m, x.velocity_mps, acceleration_mps2(x, BODY), jerk_mps3(x, BODY)])
        assert got == pytest.approx(chain, abs=2e-5)
        assert yaw_and_rate(x) == pytest.approx((yaw, yaw_rate), abs=2e-5)
    assert np.degrees(tilt) > 20.0
    assert np.linalg.norm(chain[1]) > 1.0


def test_snap_by_finite_differences_of_the_jerk() -> None:
    x = hover_state(np.zeros(3), BODY)
    for k in range(30):
        x = step_snap(x, snap_command(k), 0.3, BODY, 0.02)
    wanted = np.array([5.0, -7.0, 2.0])
    u = linearising_input(x, wanted, 0.0, BODY)
    h = 1e-5
    d = plant_derivative(x, u, BODY)
    moved = SnapState(
        x.position_m + h * d.position_m,
        x.velocity_mps + h * d.velocity_mps,
        x.R_wb + h * d.R_wb,
        x.omega_wb_b_radps + h * d.omega_wb_b_radps,
        x.thrust_n + h * d.thrust_n,
        x.thrust_rate_nps + h * d.thrust_rate_nps,
    )
    assert (jerk_mps3(moved, BODY) - jerk_mps3(x, BODY)) / h == pytest.approx(wanted, abs=1e-2)


def test_no_thrust_and_lying_on_its_side_are_refused() -> None:
    hover = hover_state(np.zeros(3), BODY)
    side = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    for x in (
        SnapState(hover.position_m, hover.velocity_mps, hover.R_wb, hover.omega_wb_b_radps, 0.0, 0.0),
        SnapState(hover.position_m, hover.velocity_mps, side, hover.omega_wb_b_radps, 10.0, 0.0),
    ):
        with pytest.raises(SingularPlantError):
            linearising_input(x, np.zeros(3), 0.0, BODY)


@pytest.mark.parametrize("poles", [(0.9, 0.8), (0.5, 0.5), (0.95 + 0.1j, 0.95 - 0.1j)])
def test_yaw_converges_exactly_for_stable_gains(poles: tuple[complex, complex]) -> None:
    dT = 0.05
    trace, det = sum(poles).real, (poles[0] * poles[1]).real
    # char. poly of [[1 + k1 h^2/2, h + k2 h^2/2], [k1 h, 1 + k2 h]]
    M = np.array([[dT**2 / 2, dT], [-(dT**2) / 2, dT]])
    k = np.linalg.solve(M, [trace - 2.0, det - 1.0])
    A = closed_yaw_matrix(k, dT)
    assert sorted(np.abs(np.linalg.eigvals(A))) == pytest.approx(sorted(np.abs(poles)), abs=1e-6)
    z = np.array([1.0, -0.5])
    for _ in range(400):
        z = A @ z
    assert z == pytest.approx([0.0, 0.0], abs=1e-6)


def test_unstable_gain_diverges_and_sampled_yaw_matches_the_plant() -> None:
    assert max(np.abs(np.linalg.eigvals(closed_yaw_matrix(np.array([1.0, 1.0]), 0.05)))) > 1.0
    A, B = yaw_matrices(0.05)
    x, z = hover_state(np.zeros(3), BODY), np.zeros(2)
    for k in range(20):
        v = sin(0.7 * k)
        x = step_snap(x, snap_command(k), v, BODY, 0.05)
        z = A @ z + B[:, 0] * v
    assert yaw_and_rate(x) == pytest.approx(tuple(z), abs=1e-3)
