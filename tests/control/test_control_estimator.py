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


def test_a_steady_offset_is_found_at_the_bandwidth_and_stops_at_its_limit() -> None:
    estimator = VehicleEstimator(
        TrackingConfig(motion_radps=4.0, offset_limit_m=0.8, delay_s=0.0), DT, 0.0, np.zeros(12)
    )
    found = []
    for k in range(1, 300):
        estimator.measure(k * DT, k * DT, np.array([0.5, 0, 0]), np.zeros(3))
        found.append(estimator.offset_m[0])
    assert np.argmax(np.array(found) > 0.5 * (1 - np.exp(-1))) * DT == pytest.approx(1 / 4.0, abs=0.15)
    assert max(found) < 0.6
    assert found[-1] == pytest.approx(0.5, abs=1e-3)
    for k in range(300, 600):
        estimator.measure(k * DT, k * DT, np.array([3.0, 4.0, 0]), np.zeros(3))
        ahead = estimator.offset_ahead(np.arange(5) * 0.1)
        assert np.linalg.norm(ahead, axis=1).max() <= 0.8 + 1e-9
    np.testing.assert_allclose(estimator.offset_m, [0.48, 0.64, 0.0], atol=1e-3)


def test_the_offset_to_come_is_ahead_of_the_offset_seen() -> None:
    """A vehicle that is pushed off its command at 0.2 m/s: what it will be off by soon, but not for ever."""
    estimator = VehicleEstimator(TrackingConfig(delay_s=0.0), DT, 0.0, np.zeros(12))
    for k in range(1, 100):
        t = k * DT
        estimator.measure(t, t, np.array([0.2 * t, 0, 0]), np.array([0.2, 0, 0]))
    ahead = estimator.offset_ahead(np.array([0.0, 0.05, 0.1, 0.5, 2.0]))[:, 0]
    assert ahead[0] == pytest.approx(0.2 * 99 * DT, abs=1e-3)
    assert (np.diff(ahead) > 0).all()
    assert ahead[1] - ahead[0] == pytest.approx(0.2 * 0.05, rel=0.25)
    assert ahead[-1] - ahead[0] < 0.05


def test_after_a_gap_only_the_place_of_the_error_is_believed() -> None:
    """A second without telemetry while the error was moving fast: it is not carried through the gap."""
    estimator = VehicleEstimator(TrackingConfig(delay_s=0.0), DT, 0.0, np.zeros(12))
    for k in range(1, 30):
        t = k * DT
        estimator.measure(t, t, np.array([t * t, 0, 0]), np.array([2 * t, 0, 0]))
    place = estimator.offset_m[0]
    t = 30 * DT + 0.45
    assert estimator.measure(t, t, np.array([place, 0, 0]), np.zeros(3))
    assert estimator.offset_m[0] == pytest.approx(place, abs=0.01)


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
