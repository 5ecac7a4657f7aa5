"""Offset, delay and motion of a vehicle that follows its command late and shifted, found from what it reports."""

import numpy as np
import pytest

from sandwich_sitl.config import TrackingConfig
from sandwich_sitl.control.estimator import STALE_S, VehicleEstimator, kalman_gain
from sandwich_sitl.control.model import quadruple_integrator

from .flights import DT


def command(t_s: float) -> np.ndarray:
    """A figure of eight of 8 m at 0.6 rad/s: r, v, a, j."""
    w = 0.6
    phases = np.array([w * t_s, 2 * w * t_s])
    rows = []
    for k in range(4):
        x = 4 * w**k * np.sin(phases[0] + k * np.pi / 2)
        y = 2 * (2 * w) ** k * np.sin(phases[1] + k * np.pi / 2)
        rows.append([x, y, 0.0])
    return np.concatenate(rows)


def flown(
    estimator: VehicleEstimator, delay_s: float, offset_m: np.ndarray, until_s: float, age_s: float = 0.0
) -> None:
    """Telemetry of a vehicle at c(t - delay) + offset, `age_s` old when it comes."""
    for k in range(1, round(until_s / DT)):
        now = k * DT
        truth = command(now - age_s - delay_s)
        estimator.measure(now, now - age_s, truth[:3] + offset_m, truth[3:6])
        estimator.commanded(now, command(now))


@pytest.mark.parametrize("delay_s", [0.0, 0.04, 0.11, 0.2])
@pytest.mark.parametrize("age_s", [0.0, 0.06])
def test_delay_is_measured_whatever_the_wind_and_the_age_of_telemetry(delay_s: float, age_s: float) -> None:
    estimator = VehicleEstimator(TrackingConfig(), DT, 0.0, command(0.0))
    flown(estimator, delay_s, np.array([0.4, -0.2, 0.1]), 40.0, age_s)
    assert estimator.delay_s == pytest.approx(delay_s, abs=0.012)
    np.testing.assert_allclose(estimator.offset_m, [0.4, -0.2, 0.1], atol=0.03)


def test_a_delay_that_is_given_is_not_learned() -> None:
    estimator = VehicleEstimator(TrackingConfig(delay_s=0.1), DT, 0.0, command(0.0))
    flown(estimator, 0.0, np.zeros(3), 20.0)
    assert estimator.delay_s == 0.1


def test_offset_comes_in_at_its_rate_and_stops_at_its_limit() -> None:
    config = TrackingConfig(observer_radps=1.5, offset_limit_m=0.8, delay_s=0.0)
    estimator = VehicleEstimator(config, DT, 0.0, np.zeros(12))
    for k in range(1, 200):
        estimator.measure(k * DT, k * DT, np.array([0.5, 0, 0]), np.zeros(3))
        assert estimator.offset_m[0] == pytest.approx(0.5 * (1 - np.exp(-1.5 * k * DT)), abs=1e-9)
    for k in range(200, 600):
        estimator.measure(k * DT, k * DT, np.array([3.0, 4.0, 0]), np.zeros(3))
    assert np.linalg.norm(estimator.offset_m) == pytest.approx(0.8)
    np.testing.assert_allclose(estimator.offset_m, [0.48, 0.64, 0.0], atol=1e-3)


def test_acceleration_and_jerk_are_estimated_where_the_vehicle_does_not_do_as_told() -> None:
    """Commanded to stand still, it flies a sine: all four derivatives are found, later by the estimator's own lag."""
    estimator = VehicleEstimator(TrackingConfig(motion_radps=12.0), DT, 0.0, np.zeros(12))
    w, worst = 0.8, np.zeros(4)
    for k in range(1, 1000):
        t = k * DT
        truth = np.array([np.sin(w * t + i * np.pi / 2) * w**i for i in range(4)])
        estimator.measure(t, t, np.array([truth[0], 0, 0]), np.array([truth[1], 0, 0]))
        if k > 300:
            worst = np.maximum(worst, np.abs(estimator.motion[::3] - truth))
    assert (worst < [0.01, 0.02, 0.1, 0.3]).all()


@pytest.mark.parametrize("w", [2.0, 6.0, 12.0])
def test_the_gain_is_stable_and_of_its_bandwidth(w: float) -> None:
    A = quadruple_integrator(DT, "zoh").A_p[::3, ::3]
    poles = np.linalg.eigvals(A - kalman_gain(DT, w) @ np.eye(4)[:2])
    assert np.abs(poles).max() < 1.0
    speeds = np.abs(np.log(poles)) / DT
    assert w / 3 < speeds.min() <= speeds.max() < 6 * w


def test_what_cannot_be_used_is_said_and_changes_nothing() -> None:
    estimator = VehicleEstimator(TrackingConfig(), DT, 0.0, np.zeros(12))
    assert estimator.measure(DT, DT, np.array([0.1, 0, 0]), np.zeros(3))
    before = estimator.offset_m.copy()
    assert not estimator.measure(2 * DT, 2 * DT, np.full(3, np.nan), np.zeros(3))
    assert not estimator.measure(2 * DT, 2 * DT, np.zeros(3), np.array([0, np.inf, 0]))
    assert not estimator.measure(1.0 + STALE_S, 0.99, np.ones(3), np.zeros(3))
    assert estimator.measure(3 * DT, DT, np.array([9.0, 0, 0]), np.zeros(3))  # the same measurement once more
    np.testing.assert_array_equal(estimator.offset_m, before)


def test_commands_are_remembered_and_joined_smoothly() -> None:
    estimator = VehicleEstimator(TrackingConfig(), DT, 0.0, command(0.0))
    for k in range(1, 60):
        estimator.commanded(k * DT, command(k * DT))
    for t in np.linspace(0.05, 59 * DT, 300):
        np.testing.assert_allclose(estimator.command_at(float(t))[:6], command(float(t))[:6], atol=2e-4)
