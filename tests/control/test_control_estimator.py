"""Offset, delay and motion of a vehicle that follows its command late and shifted, found from what it reports."""

import numpy as np
import pytest

from sandwich_sitl.config import TrackingConfig
from sandwich_sitl.control import estimator as module
from sandwich_sitl.control.estimator import STALE_S, VehicleEstimator, kalman_gain, steps_of
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


@pytest.mark.parametrize("rate_hz", [5, 10, 50, 100, 250, 500])
@pytest.mark.parametrize("w", [2.0, 8.0, 12.0])
def test_the_error_recursion_is_stable_and_of_its_bandwidth_however_far_apart_measurements_come(
    rate_hz: int, w: float
) -> None:
    """With the chain of the plant model over the whole interval; poles have the radius w as far as sampling goes."""
    C = np.eye(4)[:2]
    for m, (chain, gain) in enumerate(steps_of(1 / rate_hz, w), start=1):
        dt = m / rate_hz
        np.testing.assert_allclose(chain, quadruple_integrator(dt, "zoh").A_p[::3, ::3])
        poles = np.linalg.eigvals((np.eye(4) - gain @ C) @ chain)
        assert np.abs(poles).max() < np.exp(-0.4 * min(w * dt, 2.0))
        speeds = np.abs(np.log(poles.astype(complex))) / dt
        assert 0.85 * w < speeds.min() <= speeds.max() < 1.15 * w


@pytest.mark.parametrize("w", [1e-2, 40.0, 1000.0])
@pytest.mark.parametrize("interval_s", [0.002, 0.02, 0.25])
def test_no_bandwidth_is_too_fast_for_the_telemetry(w: float, interval_s: float) -> None:
    chain = quadruple_integrator(interval_s, "zoh").A_p[::3, ::3]
    poles = np.linalg.eigvals((np.eye(4) - kalman_gain(interval_s, w) @ np.eye(4)[:2]) @ chain)
    assert np.abs(poles).max() < np.exp(-0.4 * min(w * interval_s, 2.0))


@pytest.mark.parametrize(("rate_hz", "every"), [(50, 1), (50, 4), (50, 10), (100, 5), (250, 8), (500, 10), (5, 1)])
def test_an_offset_is_found_and_kept_at_any_rate_of_telemetry(rate_hz: int, every: int) -> None:
    estimator = VehicleEstimator(TrackingConfig(), 1 / rate_hz, 0.0, command(0.0))
    offset, delay_s, found = np.array([0.4, -0.2, 0.1]), 0.06, []
    for k in range(1, 15 * rate_hz):
        now = k / rate_hz
        if k % every == 0:
            truth = command(now - delay_s)
            estimator.measure(now, now, truth[:3] + offset, truth[3:6])
            found.append(estimator.offset_m)
        estimator.commanded(now, command(now))
    assert np.abs(np.array(found[len(found) // 3 :]) - offset).max() < 0.03


def test_an_offset_is_kept_by_telemetry_of_no_steady_rate() -> None:
    """Fifteen a second on average, early and late, on ticks of 100 Hz: the gain changes with every measurement."""
    estimator = VehicleEstimator(TrackingConfig(delay_s=0.0), 0.01, 0.0, np.zeros(12))
    rng, t, found = np.random.default_rng(3), 0.0, []
    for _ in range(600):
        t += 0.01 * float(rng.choice([4, 5, 6, 7, 8, 9]))
        estimator.measure(t, t, np.array([0.5, 0.0, 0.0]), np.zeros(3))
        found.append(estimator.offset_m[0])
    assert max(found) < 0.75
    np.testing.assert_allclose(found[100:], 0.5, atol=1e-3)


@pytest.mark.parametrize(("rate_hz", "every"), [(5, 1), (10, 1), (50, 6), (50, 10)])
def test_an_error_that_moves_is_seen_moving_by_slow_telemetry(rate_hz: int, every: int) -> None:
    """Measurements that always come 0.1 to 0.2 s apart are no gaps: the speed is carried from one to the next."""
    estimator = VehicleEstimator(TrackingConfig(delay_s=0.0), 1 / rate_hz, 0.0, np.zeros(12))
    for k in range(1, 20):
        t = k * every / rate_hz
        estimator.measure(t, t, np.array([0.2 * t, 0, 0]), np.array([0.2, 0, 0]))
    assert estimator.motion[0] == pytest.approx(0.2 * t, abs=1e-3)
    assert estimator.motion[3] == pytest.approx(0.2, abs=1e-3)
    lost = t + 2 * max(every / rate_hz, 0.1)
    estimator.measure(lost, lost, np.array([0.2 * t, 0, 0]), np.zeros(3))
    np.testing.assert_allclose(estimator.motion[::3], [0.2 * t, 0, 0, 0], atol=2e-3)


def test_a_second_start_in_flight_designs_no_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    estimator = VehicleEstimator(TrackingConfig(motion_radps=7.9), 0.002, 0.0, np.zeros(12))
    monkeypatch.setattr(module, "kalman_gain", None)
    again = estimator.restarted(1.0, np.ones(12))
    assert again.measure(1.1, 1.1, np.ones(3), np.ones(3))


def test_what_cannot_be_used_is_said_and_changes_nothing() -> None:
    estimator = VehicleEstimator(TrackingConfig(), DT, 0.0, np.zeros(12))
    assert estimator.measure(DT, DT, np.array([0.1, 0, 0]), np.zeros(3))
    before = estimator.offset_m.copy()
    assert not estimator.measure(2 * DT, 2 * DT, np.full(3, np.nan), np.zeros(3))
    assert not estimator.measure(2 * DT, 2 * DT, np.zeros(3), np.array([0, np.inf, 0]))
    assert not estimator.measure(1.0 + STALE_S, 0.99, np.ones(3), np.zeros(3))
    assert estimator.measure(3 * DT, DT, np.array([9.0, 0, 0]), np.zeros(3))  # the same measurement once more
    np.testing.assert_array_equal(estimator.offset_m, before)


@pytest.mark.parametrize("rate_hz", [5, 50, 500])
def test_the_command_in_force_is_known_as_far_back_as_old_telemetry_and_a_late_vehicle_ask(rate_hz: int) -> None:
    """And joined smoothly between the ticks, as well as four derivatives can."""
    estimator = VehicleEstimator(TrackingConfig(), 1 / rate_hz, 0.0, command(0.0))
    ticks = 2 * rate_hz
    for k in range(1, ticks + 1):
        estimator.commanded(k / rate_hz, command(k / rate_hz))
    atol = 1e-4 + 4 * (2 * 0.6) ** 4 * rate_hz**-3.0
    for t in ticks / rate_hz - np.linspace(0.0, STALE_S + 0.3, 300):
        np.testing.assert_allclose(estimator.command_at(float(t))[:6], command(float(t))[:6], atol=atol)
