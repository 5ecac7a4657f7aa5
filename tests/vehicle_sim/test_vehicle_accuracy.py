"""ESTIMATOR_STATUS says how far off the estimate is: against the vehicle's own errors over seeds, as sensors fail and return; and what an
autopilot does that no longer knows where it is.
"""

from math import degrees, hypot

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.parts import FailureConfig, SensorsConfig
from vehicle_sim.rotation import rotate, yaw_of
from vehicle_sim.telemetry.status import estimator_status, heartbeat
from vehicle_sim.vehicle import Vehicle

from .flight import Flight

_AFTER_S = (1.0, 3.0, 5.0)
_ACROSS = int(
    mavlink.ESTIMATOR_VELOCITY_HORIZ
    | mavlink.ESTIMATOR_POS_HORIZ_REL
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
)


def errors_m(vehicle: Vehicle) -> tuple[float, float]:
    """Across and in height."""
    p, x = vehicle.estimate.position_ned_m, vehicle.state
    return hypot(p[0] - x.n, p[1] - x.e), abs(p[2] - x.d)


def said_m(vehicle: Vehicle) -> tuple[float, float]:
    status = estimator_status(vehicle)
    return status.pos_horiz_accuracy, status.pos_vert_accuracy


def after_the_loss_of(part: str, loss_s: float, moving: bool, sensors: SensorsConfig) -> tuple[NDArray, NDArray]:
    """RMS error and what is said, each (3, 2): across and in height, at `_AFTER_S`, over a dozen seeds."""
    squares, said = np.zeros((3, 2)), np.zeros((3, 2))
    for seed in range(12):
        flight = Flight(seed, failures=(FailureConfig(at_s=loss_s, part=part),), sensors=sensors).take_off()  # type: ignore[arg-type]
        legs = 0
        for k, after_s in enumerate((0.0, *_AFTER_S)):
            while (left_s := loss_s + after_s - flight.vehicle.t_s) > 0.01:
                place = (4.0 * (legs % 2), 2.0 * (legs % 3), -4.0) if moving else (0.0, 0.0, -4.0)
                flight.run(min(left_s, 4.0), place)
                legs += 1
            if k > 0:
                squares[k - 1] += np.square(errors_m(flight.vehicle)) / 12
                said[k - 1] = said_m(flight.vehicle)
    return np.sqrt(squares), said


@pytest.mark.parametrize(
    ("part", "axis", "loss_s", "moving", "estimator"),
    [
        ("gps", 0, 14.0, True, "filter"),
        ("gps", 0, 30.0, False, "filter"),
        ("gps", 0, 30.0, True, "filter"),
        ("gps", 0, 14.0, False, "error_model"),
        ("barometer", 1, 20.0, False, "filter"),
    ],
)
def test_what_is_said_after_a_loss_is_what_the_errors_are(
    part: str, axis: int, loss_s: float, moving: bool, estimator: str
) -> None:
    """Within a factor of 1.7 either way, over a dozen seeds; in flight it tends to say too little, for heading is left out."""
    rms, said = after_the_loss_of(part, loss_s, moving, SensorsConfig(estimator=estimator))  # type: ignore[arg-type]
    ratio = rms[:, axis] / said[:, axis]
    assert np.all((ratio > 1 / 1.7) & (ratio < 1.7)), ratio
    assert said[-1, axis] > 1.4 * said[0, axis]


def test_a_gps_that_returns_makes_it_as_accurate_as_before() -> None:
    """Soon by its gains after a short loss; at the first fix after a long one, as the estimate itself."""
    for away_s, within_s, left in ((5.0, 3.0, 1.1), (20.0, 0.5, 1.2)):
        failures = (FailureConfig(at_s=20.0, part="gps"), FailureConfig(at_s=20.0 + away_s, part="gps", ok=True))
        flight = Flight(3, failures=failures).take_off()
        flight.run(19.8 - flight.vehicle.t_s)
        before_m, _ = said_m(flight.vehicle)
        flight.run(away_s + 0.2)
        worst_m, _ = said_m(flight.vehicle)
        flight.run(0.1)
        assert said_m(flight.vehicle)[0] >= worst_m  # no fix has come yet
        flight.run(within_s)
        assert worst_m > 1.4 * before_m
        assert said_m(flight.vehicle)[0] < left * before_m
        assert errors_m(flight.vehicle)[0] < 3.0 * before_m


def test_who_asks_when_changes_nothing() -> None:
    failures = (FailureConfig(at_s=14.0, part="gps"), FailureConfig(at_s=19.0, part="gps", ok=True))
    often, once = Flight(1, failures=failures), Flight(1, failures=failures)
    for flight in (often, once):
        for _ in range(100):
            flight.run(0.22)
            if flight is often:
                said_m(flight.vehicle)
    assert said_m(often.vehicle) == said_m(once.vehicle)


def test_flags_drop_when_the_position_is_no_longer_valid_and_come_back() -> None:
    failures = (FailureConfig(at_s=14.0, part="gps"), FailureConfig(at_s=24.0, part="gps", ok=True))
    flight = Flight(1, failures=failures).take_off()
    seen: list[tuple[float, int]] = []
    flight.run(14.0, each=lambda: seen.append((flight.vehicle.t_s, estimator_status(flight.vehicle).flags)))
    without = [t for t, flags in seen if not flags & _ACROSS]
    assert min(without) == pytest.approx(19.0, abs=0.05)  # EKF2_NOAID_TOUT
    assert max(without) == pytest.approx(24.0, abs=0.05)
    assert {flags | _ACROSS for _, flags in seen} == {831}  # height and attitude stay valid
    flight.vehicle.inject_failure(3, 1, 0)
    flight.vehicle.inject_failure(4, 1, 0)
    assert not estimator_status(flight.vehicle).flags & int(mavlink.ESTIMATOR_POS_VERT_ABS)


def test_a_take_off_does_not_upset_the_estimate() -> None:
    """Held by its feet while the rotors speed up, wherever it is to look, and felt by the gyroscope."""
    for seed, yaw_deg in ((1, 0.0), (2, 0.0), (3, 200.0), (4, 200.0)):
        flight, worst_deg = Flight(seed, initial_yaw_deg=yaw_deg), 0.0

        def look(v: Vehicle = flight.vehicle) -> None:
            nonlocal worst_deg
            up = np.subtract(rotate(v.state.q_wb_wxyz, (0, 0, 1.0)), rotate(v.estimate.q_wb_wxyz, (0, 0, 1.0)))
            worst_deg = max(worst_deg, degrees(float(np.linalg.norm(up))))

        flight.run(4.6)
        flight.vehicle.autopilot.request_mode(Mode.OFFBOARD)
        flight.vehicle.autopilot.request_arm()
        flight.run(5.0, each=look)
        assert flight.vehicle.state.d < -2.0
        assert worst_deg < 2.5


def test_without_a_position_it_descends_level_lands_and_disarms() -> None:
    """PX4's Descend, shown as Land: no horizontal velocity is asked for, and none is needed to know that it stands."""
    for seed in (2, 5):
        flight = Flight(seed, failures=(FailureConfig(at_s=16.0, part="gps"),)).take_off()
        vehicle, pilot = flight.vehicle, flight.vehicle.autopilot
        flight.run(16.0 - vehicle.t_s, (0.0, 0.0, -6.0))
        tilts: list[float] = []

        def look(v: Vehicle = vehicle, tilts: list[float] = tilts) -> None:
            if v.autopilot.commander.flown_mode is Mode.DESCEND and not v.autopilot.landed:
                _, _, down = rotate(v.estimate.q_wb_wxyz, (0.0, 0.0, 1.0))
                tilts.append(degrees(np.arccos(min(1.0, down))))

        flight.run(5.5, (0.0, 0.0, -6.0), look)
        assert heartbeat(vehicle).custom_mode == 4 << 16 | 6 << 24
        assert heartbeat(vehicle).system_status == mavlink.MAV_STATE_CRITICAL
        tilts.clear()
        vehicle.flight.estimate[3:5] += 3.0  # as worthless as it may be
        flight.run(14.0, (0.0, 0.0, -6.0), look)
        assert np.max(tilts) < 2.0
        assert vehicle.state.d == 0.0
        assert pilot.landed
        assert not pilot.commander.armed
        assert abs(yaw_of(vehicle.state.q_wb_wxyz)) < 0.2
