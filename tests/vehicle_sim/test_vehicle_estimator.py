"""From sensors to the estimate: errors of the size that is stated and of PX4's size, rates, delays, and the loss of a sensor."""

from math import hypot, sqrt

import numpy as np
import pytest

from vehicle_sim.accuracy import Accuracy
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.config import VehicleConfig
from vehicle_sim.parts import FailureConfig, SensorsConfig
from vehicle_sim.protocol.node import Node
from vehicle_sim.sensors import MAGNETIC_FIELD_NED_GAUSS
from vehicle_sim.telemetry.status import estimator_status
from vehicle_sim.vehicle import Vehicle

from .flight import Flight
from .node_client import EXACT, Client, named

#: A wander that forgets within seconds, so that a minute of one seed holds many independent errors.
QUICK = SensorsConfig(gps_correlation_s=5.0)
UNBIASED = SensorsConfig(accelerometer_bias_std_mps2=0.0, gyroscope_bias_std_radps=0.0, magnetometer_bias_std_gauss=0.0)


def horizontal_error_m(vehicle: Vehicle) -> float:
    p, x = vehicle.estimate.position_ned_m, vehicle.state
    return hypot(p[0] - x.n, p[1] - x.e)


def test_the_default_estimate_is_made_of_the_sensors() -> None:
    """Nothing of the truth but what the sensors read reaches it: with silent sensors it does not move."""
    assert SensorsConfig().estimator == "filter"
    vehicle = Vehicle(VehicleConfig(), 1)
    vehicle.advance(2000)
    vehicle.constants.put("sensors_lost", 7)
    vehicle.flight.x[0] += 5.0
    vehicle.flight.before[0] += 5.0
    before = vehicle.estimate.position_ned_m[0]
    vehicle.advance(400)
    assert abs(vehicle.estimate.position_ned_m[0] - before) < 0.2


@pytest.mark.parametrize("moving", [False, True])
def test_errors_and_innovations_are_of_the_stated_size(moving: bool) -> None:
    """Normalised squared errors average one over seeds and axes; innovations have the spread that the gains and noises imply."""
    squares, innovations, worst = [], [], 0.0
    for seed in range(8):
        flight = Flight(seed, sensors=QUICK)
        if moving:
            flight.take_off()
        vehicle = flight.vehicle

        def look(v: Vehicle = vehicle, a: Accuracy = vehicle.accuracy) -> None:
            error = np.array(v.estimate.position_ned_m) - v.state.position_ned_m
            squares.append((error / (a.position_m, a.position_m, a.height_m)) ** 2)
            innovations.append(v.flight.innovation.copy())

        flight.run(30.0)  # the gyroscope biases are found
        for k in range(5):
            flight.run(8.0, (4.0 * (k % 2), 2.0 * (k % 3), -4.0) if moving else (0.0, 0.0, 1.0), look)
        worst = max(worst, *np.max(squares, axis=0))
    assert np.mean(squares, axis=0) == pytest.approx([1.0, 1.0, 1.0], rel=0.35)
    assert worst < 4.0**2
    spread = np.sqrt(np.mean(np.square(innovations), axis=0))
    a = vehicle.accuracy
    stated = [a.gps_position_m, a.gps_position_m, a.gps_velocity_mps, a.gps_velocity_mps, a.barometer_m, a.compass_rad]
    assert spread[[0, 1, 3, 4, 6, 7]] == pytest.approx(stated, rel=0.2)
    assert np.all(np.abs(np.mean(innovations, axis=0))[[0, 1, 3, 4, 6, 7]] < np.array(stated) / 5)


def test_measured_accuracy_of_the_estimate() -> None:
    """PX4's simulator: 0.3 m at the median horizontally and 0.7 m at most; up to 1.2 m in height."""
    across, down = [], []
    for seed in range(1, 13):
        vehicle = Vehicle(VehicleConfig(), seed)
        for _ in range(120):
            vehicle.advance(400)
            across.append(horizontal_error_m(vehicle))
            down.append(abs(vehicle.estimate.position_ned_m[2] - vehicle.state.d))
    assert np.median(across) == pytest.approx(0.3, abs=0.1)
    assert 0.6 < max(across) < 1.4
    assert 0.05 < np.median(down) < 0.4
    assert max(down) < 1.2


def test_tilt_heading_and_gyroscope_bias_are_found_in_flight() -> None:
    for seed in (1, 2, 3):
        flight = Flight(seed, initial_yaw_deg=70.0).take_off()
        turns: list[float] = []

        def look(v: Vehicle = flight.vehicle, turns: list[float] = turns) -> None:
            dot = abs(float(np.dot(v.state.q_wb_wxyz, v.estimate.q_wb_wxyz)))
            turns.append(2 * np.arccos(min(1.0, dot)))

        for k in range(8):
            flight.run(5.0, (4.0 * (k % 2), 2.0 * (k % 3), -4.0), look)
        assert np.degrees(np.median(turns)) < 2.0
        bias = flight.vehicle.flight.gyro_bias - flight.vehicle.constants.gyro_bias
        assert np.abs(bias).max() < 1.5e-3


def test_gps_comes_at_its_rate_and_late_in_telemetry_too() -> None:
    """A vehicle that moves north at 2 m/s is shown where it was one delay ago."""
    quiet = SensorsConfig(gps_horizontal_std_m=0.0, gps_vertical_std_m=0.0, gps_speed_std_mps=0.0, gps_delay_s=0.12)
    vehicle = Vehicle(VehicleConfig(sensors=quiet), 1)
    seen: list[tuple[float, float]] = []
    for k in range(400):
        vehicle.flight.x[0] = vehicle.flight.before[0] = 2.0 * vehicle.t_s
        vehicle.flight.x[3] = vehicle.flight.before[3] = 2.0
        vehicle.flight.x[2] = vehicle.flight.before[2] = -50.0
        vehicle.advance(4)
        place = vehicle.readings.gps_ned_m[0]
        if k > 100 and (not seen or place != seen[-1][1]):
            seen.append((vehicle.t_s, place))
    gaps = np.diff([t for t, _ in seen])
    assert np.mean(gaps) == pytest.approx(0.125, abs=0.002)
    lag = [t - place / 2.0 for t, place in seen[1:]]
    assert lag == pytest.approx([0.12] * len(lag), abs=0.0151)  # looked at one tick, moved by hand one tick
    assert vehicle.readings.gps_velocity_mps[0] == pytest.approx(2.0, abs=0.2)


def test_inertial_sensors_and_magnetometer_are_biased_by_the_seed() -> None:
    """The mean of many readings at rest is truth and bias; another seed has others, a configuration of zeros none."""
    means = []
    for seed, sensors in ((1, SensorsConfig()), (2, SensorsConfig()), (1, UNBIASED)):
        vehicle = Vehicle(VehicleConfig(sensors=sensors), seed)
        vehicle.advance(400)
        read = []
        for _ in range(1000):
            vehicle.advance(8)
            r = vehicle.readings
            read.append((*r.specific_force_mps2, *r.gyroscope_radps, *r.magnetometer_gauss))
        c = vehicle.constants
        offset = np.mean(read, axis=0) - (0.0, 0.0, -9.80665, 0.0, 0.0, 0.0, *MAGNETIC_FIELD_NED_GAUSS)
        assert offset == pytest.approx(np.concatenate((c.accel_bias, c.gyro_bias, c.field_bias)), abs=0.006)
        means.append(np.concatenate((c.accel_bias, c.gyro_bias, c.field_bias)))
    assert np.all(np.abs(means[0]) > 0)
    assert not np.any(np.isclose(means[0], means[1], rtol=1e-3))
    assert not np.any(means[2])


def test_telemetry_states_the_accuracy_and_the_test_ratios() -> None:
    client = Client(Node(Vehicle(VehicleConfig(), 1), lockstep=False))
    statuses = named(client.run(30.0), "ESTIMATOR_STATUS")[5:]
    accuracy = client.node.vehicle.accuracy
    assert statuses[-1].pos_horiz_accuracy == pytest.approx(sqrt(2) * accuracy.position_m, rel=1e-4)
    assert statuses[-1].pos_vert_accuracy == pytest.approx(accuracy.height_m, rel=1e-4)
    for name in ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"):
        ratios = [getattr(status, name) for status in statuses]
        assert 0.0 < np.median(ratios) < 0.6, name
        assert max(ratios) < 1.0, name
    perfect = Vehicle(VehicleConfig(sensors=EXACT), 1)
    assert estimator_status(perfect).pos_horiz_accuracy == 0.0
    assert perfect.estimate.position_ned_m == perfect.state.position_ned_m


def test_without_gps_the_estimate_drifts_and_after_the_time_out_the_vehicle_descends() -> None:
    loss, back = FailureConfig(at_s=14.0, part="gps"), FailureConfig(at_s=21.0, part="gps", ok=True)
    flight = Flight(2, failures=(loss, back)).take_off()
    modes: list[tuple[float, Mode]] = []

    def look() -> None:
        modes.append((flight.vehicle.t_s, flight.vehicle.autopilot.commander.flown_mode))

    flight.run(2.4)
    before_m = horizontal_error_m(flight.vehicle)
    flight.run(12.0, each=look)
    left_s = next(t for t, mode in modes if mode is Mode.DESCEND)
    assert left_s == pytest.approx(14.0 + 5.0, abs=0.1)  # EKF2_NOAID_TOUT
    assert list(dict.fromkeys(mode for _, mode in modes)) == [Mode.OFFBOARD, Mode.DESCEND]
    assert modes[-1][1] is Mode.OFFBOARD
    drifting = Flight(2, failures=(loss,)).take_off()
    drifting.run(30.0)
    assert horizontal_error_m(drifting.vehicle) > before_m + 0.3


def test_gps_that_comes_back_after_long_is_believed_at_once() -> None:
    loss, back = FailureConfig(at_s=14.0, part="gps"), FailureConfig(at_s=34.0, part="gps", ok=True)
    vehicle = Vehicle(VehicleConfig(failures=(loss, back)), 2)
    vehicle.advance(400 * 14)
    vehicle.flight.estimate[:2] += 20.0  # as after a long drift
    vehicle.advance(400 * 20)
    assert horizontal_error_m(vehicle) > 10.0
    vehicle.advance(200)
    assert horizontal_error_m(vehicle) < 1.5


def test_a_short_loss_of_gps_is_bridged() -> None:
    loss, back = FailureConfig(at_s=14.0, part="gps"), FailureConfig(at_s=17.0, part="gps", ok=True)
    flight = Flight(failures=(loss, back)).take_off()
    modes: set[Mode] = set()
    flight.run(8.0, each=lambda: modes.add(flight.vehicle.autopilot.commander.flown_mode))
    assert modes == {Mode.OFFBOARD}


@pytest.mark.parametrize(("part", "bit"), [("barometer", 0x08), ("magnetometer", 0x04)])
def test_without_barometer_or_magnetometer_it_flies_on_by_the_others(part: str, bit: int) -> None:
    """PX4 flies on without either in the air and says so in SYS_STATUS; the reading freezes."""
    flight = Flight(3, failures=(FailureConfig(at_s=13.0, part=part),)).take_off()  # type: ignore[arg-type]
    flight.run(3.0)
    vehicle = flight.vehicle
    before = vehicle.readings
    flight.run(20.0, (3.0, 2.0, -5.0))
    after = vehicle.readings
    assert vehicle.failures.health_bits_lost == bit
    assert vehicle.autopilot.commander.flown_mode is Mode.OFFBOARD
    assert np.array(vehicle.state.position_ned_m) == pytest.approx(np.array((3.0, 2.0, -5.0)), abs=1.2)
    frozen = (after.magnetometer_gauss == before.magnetometer_gauss, after.pressure_hpa == before.pressure_hpa)
    assert frozen == (part == "magnetometer", part == "barometer")
    assert after.gyroscope_radps != before.gyroscope_radps
    assert not vehicle.inject_failure(8, 1, 0)
    assert not vehicle.inject_failure(101, 3, 0)
