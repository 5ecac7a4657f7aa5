"""OBSTACLE_DISTANCE into the world's frame: hand-computed directions for each frame, and what is malformed."""

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.errors import InputError
from sandwich_sitl.link.frames import quaternion_enu_from_ned, quaternion_from_euler
from sandwich_sitl.link.inbox import Inbox
from sandwich_sitl.link.range_scan import scan_of
from sandwich_sitl.link.telemetry import Telemetry
from sandwich_sitl.link.wire import FrameSplitter
from sandwich_sitl.mission.vehicle_view import RangeScan

HERE = np.array([3.0, 4.0, 5.0])
EAST = quaternion_enu_from_ned(*quaternion_from_euler(0.1, -0.1, np.pi / 2))  # nose to the east, a little tilted


def message(distances_cm: list[int], **fields: Any) -> Any:
    given = {
        "time_usec": 0, "sensor_type": 0, "increment": 90, "min_distance": 20, "max_distance": 2000,
        "increment_f": 0.0, "angle_offset": 0.0, "frame": mavlink.MAV_FRAME_BODY_FRD,
    } | fields  # fmt: skip
    return mavlink.MAVLink_obstacle_distance_message(
        distances=distances_cm + [65535] * (72 - len(distances_cm)), **given
    )


def points(scan: RangeScan) -> np.ndarray:
    """Where the returns lie in the world, from the vehicle."""
    rays = np.column_stack([np.cos(scan.bearings_rad), np.sin(scan.bearings_rad)])
    return np.asarray(scan.ranges_m[:, None] * rays)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        # Nose to the east: ahead is east, then clockwise south, west, north.
        ({}, [(1, 0), (0, -2), (-3, 0), (0, 4)]),
        ({"angle_offset": 90.0}, [(0, -1), (-2, 0), (0, 3), (4, 0)]),
        ({"increment_f": -90.0}, [(1, 0), (0, 2), (-3, 0), (0, -4)]),
        # Aligned with north, whatever the heading.
        ({"frame": mavlink.MAV_FRAME_GLOBAL}, [(0, 1), (2, 0), (0, -3), (-4, 0)]),
        ({"frame": mavlink.MAV_FRAME_LOCAL_NED, "angle_offset": -90.0}, [(-1, 0), (0, 2), (3, 0), (0, -4)]),
    ],
)
def test_returns_lie_where_the_message_says(fields: dict[str, Any], expected: list[tuple[int, int]]) -> None:
    scan = scan_of(message([100, 200, 300, 400], **fields), 1.5, HERE, EAST)
    np.testing.assert_allclose(points(scan), expected, atol=0.02)
    np.testing.assert_array_equal(scan.origin_m, HERE[:2])
    assert scan.heard_s == 1.5
    assert scan.width_rad == pytest.approx(np.pi / 2)


def test_nothing_in_reach_is_not_the_same_as_nothing_known() -> None:
    scan = scan_of(message([0, 2000, 2001, 65534, 65535, 50], increment=10), 0.0, HERE, EAST)
    np.testing.assert_array_equal(scan.ranges_m, [0.0, 20.0, np.inf, np.inf, np.nan, 0.5])


def test_no_more_than_a_full_circle_counts() -> None:
    assert len(scan_of(message([100] * 72, increment=10), 0.0, HERE, EAST).ranges_m) == 36
    assert len(scan_of(message([]), 0.0, HERE, EAST).ranges_m) == 0


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"increment": 0}, "increment"),
        ({"increment_f": float("nan")}, "increment"),
        ({"increment_f": 400.0}, "increment"),
        ({"angle_offset": float("inf")}, "angle_offset"),
        ({"frame": mavlink.MAV_FRAME_LOCAL_FLU}, "frame"),
    ],
)
def test_a_malformed_sweep_says_what_is_wrong(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        scan_of(message([100], **fields), 0.0, HERE, EAST)


def test_the_view_hands_out_each_sweep_once_and_only_from_a_known_pose() -> None:
    mav, splitter = mavlink.MAVLink(None, 1, 1), FrameSplitter()
    inbox = Inbox(Telemetry((10.0, 20.0), (245, 191)), lambda _t, _way, _raw: None)

    def say(*said: Any) -> None:
        for one in said:
            inbox.take(splitter.feed_datagram(one.pack(mav)), 2.5)

    say(mav.heartbeat_encode(2, 12, 29, 4 << 16, 3), message([100]))
    assert inbox.telemetry.view(heard=True).scans == ()
    say(
        mavlink.MAVLink_local_position_ned_message(0, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0),
        mavlink.MAVLink_attitude_quaternion_message(0, *quaternion_from_euler(0, 0, np.pi / 2), 0, 0, 0),
        message([100]),
        message([100], increment=0),
    )
    view = inbox.telemetry.view(heard=True)
    (scan,) = view.scans
    np.testing.assert_allclose(scan.origin_m, [12.0, 21.0])
    np.testing.assert_allclose(points(scan), [[1.0, 0.0]], atol=1e-6)
    assert scan.heard_s == 2.5
    assert len(view.scan_problems) == 1
    assert inbox.telemetry.view(heard=True).scans == ()
