"""What the range sensor sees, as OBSTACLE_DISTANCE: centimetres, degrees clockwise from the nose, BODY_FRD."""

from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.vehicle import Vehicle

_ELEMENTS = 72
_UNUSED = 65535


def obstacle_distance(v: Vehicle) -> Any:
    """OBSTACLE_DISTANCE; None without a range sensor."""
    sensor = v.range_sensor
    if sensor is None:
        return None
    sweep = sensor.sweep(v.t_us, v.state.position_ned_m, v.state.q_wb_wxyz)
    reach_cm = round(sensor.config.reach_m * 100)
    seen = np.isfinite(sweep.ranges_m)
    distances = [_UNUSED] * _ELEMENTS
    distances[: len(seen)] = np.where(seen, np.rint(np.where(seen, sweep.ranges_m, 0.0) * 100), reach_cm + 1).astype(
        int
    )
    return mavlink.MAVLink_obstacle_distance_message(
        v.t_us,
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        [int(distance) for distance in distances],
        0,
        round(sensor.config.least_m * 100),
        reach_cm,
        sweep.increment_deg,
        sweep.first_deg,
        mavlink.MAV_FRAME_BODY_FRD,
    )
