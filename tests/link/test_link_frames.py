"""Signs of every conversion by hand, round trips by property, quaternions against rotation matrices."""

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sandwich_sitl.link import frames

metres = st.floats(-1e4, 1e4)
angles = st.floats(-pi, pi)


def test_position_ahead_north_and_above() -> None:
    """3 m north, 1 m east, 2 m up of an origin at east 10, north 20."""
    assert frames.position_enu_from_ned(3.0, 1.0, -2.0, (10.0, 20.0)).tolist() == [11.0, 23.0, 2.0]
    assert frames.position_ned_from_enu(np.array((11.0, 23.0, 2.0)), (10.0, 20.0)) == (3.0, 1.0, -2.0)


def test_velocity_sinking_and_moving_east() -> None:
    assert frames.enu_from_ned(0.0, 4.0, 1.0).tolist() == [4.0, 0.0, -1.0]


def test_acceleration_upwards_and_north() -> None:
    assert frames.ned_from_enu(np.array((0.0, 2.0, 3.0))) == (2.0, 0.0, -3.0)


@pytest.mark.parametrize(("ned", "enu"), [(0.0, pi / 2), (pi / 2, 0.0), (pi, -pi / 2), (-pi / 2, pi)])
def test_yaw_of_the_four_winds(ned: float, enu: float) -> None:
    assert frames.flip_yaw(ned) == pytest.approx(enu)


def test_quaternion_level_facing_north_is_a_quarter_turn_in_enu() -> None:
    assert frames.quaternion_enu_from_ned(1.0, 0.0, 0.0, 0.0) == pytest.approx([sqrt(0.5), 0.0, 0.0, sqrt(0.5)])


def test_quaternion_facing_east_nose_up_raises_the_nose() -> None:
    """Nose up by 30 degrees, facing east: the body's forward axis is (cos 30, 0, sin 30) in ENU."""
    w, x, y, z = frames.quaternion_enu_from_ned(*frames.quaternion_from_euler(0.0, pi / 6, pi / 2))
    assert Rotation.from_quat([x, y, z, w]).apply([1.0, 0.0, 0.0]) == pytest.approx([sqrt(0.75), 0.0, 0.5])


def test_quaternion_rolled_right_lowers_the_right_side() -> None:
    w, x, y, z = frames.quaternion_enu_from_ned(*frames.quaternion_from_euler(0.5, 0.0, 0.0))
    right_flu = [0.0, -1.0, 0.0]
    assert Rotation.from_quat([x, y, z, w]).apply(right_flu)[2] < 0.0


def test_boot_time_wraps_as_a_32_bit_number() -> None:
    assert frames.boot_ms(1.2345) == 1234
    assert frames.boot_ms((2**32 + 5) * 1e-3) == 5


@given(metres, metres, metres, metres, metres)
def test_position_round_trip(x: float, y: float, z: float, x0: float, y0: float) -> None:
    r = frames.position_enu_from_ned(x, y, z, (x0, y0))
    assert frames.position_ned_from_enu(r, (x0, y0)) == pytest.approx((x, y, z), abs=1e-9)


@given(metres, metres, metres)
def test_free_vectors_keep_their_length_and_come_back(x: float, y: float, z: float) -> None:
    v = frames.enu_from_ned(x, y, z)
    assert frames.ned_from_enu(v) == (x, y, z)
    assert np.linalg.norm(v) == pytest.approx(np.linalg.norm([x, y, z]))


@given(angles)
def test_yaw_is_its_own_inverse(yaw: float) -> None:
    assert abs(np.exp(1j * frames.flip_yaw(frames.flip_yaw(yaw))) - np.exp(1j * yaw)) < 1e-12


@given(angles, st.floats(-1.5, 1.5), angles)
def test_quaternion_turns_axes_as_the_matrices_do(roll: float, pitch: float, yaw: float) -> None:
    """R_enu_flu = T R_ned_frd S with T, S the matrices of the axes' exchange."""
    r_ned_frd = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    exchange = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    w, x, y, z = frames.quaternion_enu_from_ned(*frames.quaternion_from_euler(roll, pitch, yaw))
    assert w >= 0.0
    assert Rotation.from_quat([x, y, z, w]).as_matrix() == pytest.approx(
        exchange @ r_ned_frd @ np.diag([1.0, -1.0, -1.0]), abs=1e-9
    )
