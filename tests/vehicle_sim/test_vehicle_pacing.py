"""The absolute schedule of real time: lateness is passed over, not passed on."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_sim.pacing import Schedule

STEP_US = 2500
LATE = st.lists(st.floats(0.0, 0.099), min_size=1, max_size=200)
SPEED = st.sampled_from((0.1, 0.5, 1.0, 3.0, 10.0))


@given(LATE, SPEED)
def test_lateness_below_a_tenth_of_a_second_never_moves_the_schedule(late_s: list[float], speed: float) -> None:
    schedule = Schedule(speed, STEP_US)
    schedule.start(100.0)
    now_s = 100.0
    for late in late_s:
        # Nobody begins a batch before the last one was begun.
        now_s = max(now_s, schedule.deadline_s + late)
        schedule.passed(now_s)
    drift_s = schedule.deadline_s - (100.0 + (len(late_s) + 1) * schedule.batch_s)
    assert schedule.resynchronised == 0
    assert abs(drift_s) < 1e-9 * len(late_s)


@given(st.floats(0.25, 30.0), SPEED)
def test_after_a_long_stop_the_schedule_begins_anew_and_says_so(stop_s: float, speed: float) -> None:
    schedule = Schedule(speed, STEP_US)
    schedule.start(0.0)
    now_s = schedule.deadline_s + schedule.batch_s + stop_s
    schedule.passed(now_s)
    assert schedule.resynchronised == 1
    assert schedule.deadline_s == now_s + schedule.batch_s
    assert "begun anew 1 times" in schedule.report()


@given(SPEED)
def test_a_batch_takes_its_simulated_time_divided_by_the_speed(speed: float) -> None:
    schedule = Schedule(speed, STEP_US)
    assert schedule.batch_s * speed * 1e6 == pytest.approx(schedule.batch_us)
    assert schedule.batch_us % STEP_US == 0
    assert schedule.batch_s >= 0.002


def test_percentiles_are_those_of_the_lateness() -> None:
    schedule = Schedule(1.0, STEP_US)
    schedule.start(0.0)
    for k in range(1000):
        schedule.passed(schedule.deadline_s + (0.050 if k == 500 else 0.001 if k % 50 == 0 else 0.0))
    assert "p50 0.00, p99 1.00, p99.9 50.00, max 50.00" in schedule.report()
