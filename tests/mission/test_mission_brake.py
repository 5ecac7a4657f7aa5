"""Laws of the braking profile: it starts where the vehicle is, decelerates at the given rate, ends at rest, and is smooth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandwich_sitl.mission.brake import BrakeProfile

vectors = st.tuples(*(st.floats(-20.0, 20.0),) * 3).map(np.array)
decelerations = st.floats(0.5, 10.0)


@given(vectors, vectors, decelerations)
def test_it_begins_where_the_vehicle_is_and_ends_at_rest(r0: np.ndarray, v0: np.ndarray, decel: float) -> None:
    profile = BrakeProfile(r0, v0, decel)
    r, v, _ = profile.at(0.0)
    assert r == pytest.approx(r0)
    assert v == pytest.approx(v0)
    r, v, a = profile.at(profile.duration_s + 5.0)
    assert np.linalg.norm(r - r0) == pytest.approx(np.dot(v0, v0) / (2.0 * decel))  # v^2 = 2 a s
    assert v.tolist() == a.tolist() == [0.0, 0.0, 0.0]


@given(vectors, vectors, decelerations, st.floats(0.05, 0.95))
def test_velocity_is_the_slope_of_position(r0: np.ndarray, v0: np.ndarray, decel: float, part: float) -> None:
    profile = BrakeProfile(r0, v0, decel)
    step, t = 1e-4, part * max(profile.duration_s, 0.1)
    slope = (profile.at(t + step)[0] - profile.at(t - step)[0]) / (2.0 * step)
    assert slope == pytest.approx(profile.at(t)[1], abs=2.0 * decel * step + 1e-6)


@given(vectors, vectors, decelerations, st.floats(0.0, 0.99))
def test_deceleration_is_as_configured_and_against_the_motion(
    r0: np.ndarray, v0: np.ndarray, decel: float, part: float
) -> None:
    profile = BrakeProfile(r0, v0, decel)
    if profile.duration_s < 1e-6:
        return
    _, _, a = profile.at(part * profile.duration_s)
    assert np.linalg.norm(a) == pytest.approx(decel)
    assert np.dot(a, v0) == pytest.approx(-decel * np.linalg.norm(v0))
