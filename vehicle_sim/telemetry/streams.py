"""Which messages a client gets, and how often: PX4's onboard rates (row 16 of its behaviour and the measured list)."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.telemetry import identity, motion, ranging, status
from vehicle_sim.vehicle import Vehicle

Builder = Callable[[Vehicle], Any]

#: Message id -> (builder, default interval in microseconds; 0 = on request only). Rates: row 16 and the measured list.
STREAMS: dict[int, tuple[Builder, int]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (status.heartbeat, 1_000_000),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (status.sys_status, 200_000),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (status.extended_sys_state, 200_000),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (motion.attitude, 10_000),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (motion.attitude_quaternion, 20_000),
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: (status.highres_imu, 20_000),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (motion.global_position_int, 20_000),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (motion.local_position_ned, 33_333),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: (motion.odometry, 33_333),
    mavlink.MAVLINK_MSG_ID_TIMESYNC: (status.timesync, 100_000),
    mavlink.MAVLINK_MSG_ID_ALTITUDE: (motion.altitude, 100_000),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (motion.vfr_hud, 100_000),
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: (motion.servo_output_raw, 100_000),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: (motion.attitude_target, 100_000),
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: (motion.position_target_local_ned, 100_000),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (status.gps_raw_int, 125_000),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (status.estimator_status, 1_000_000),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (status.system_time, 1_000_000),
    mavlink.MAVLINK_MSG_ID_PING: (status.ping, 1_000_000),
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: (status.scaled_pressure, 1_000_000),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: (status.home_position, 2_000_000),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: (status.battery_status, 2_000_000),
    mavlink.MAVLINK_MSG_ID_VIBRATION: (status.vibration, 2_000_000),
    identity.CURRENT_MODE: (identity.current_mode, 2_000_000),
    identity.PROTOCOL_VERSION: (identity.protocol_version, 0),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (status.gps_global_origin, 0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: (identity.autopilot_version, 0),
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: (motion.hil_state_quaternion, 0),
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: (ranging.obstacle_distance, 0),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: (identity.mission_current, 1_000_000),
}
#: Messages that PX4 would send if the part were there: a rate may be set, nothing comes, a request is denied.
SILENT = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU2,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU3,
        mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR,
        mavlink.MAVLINK_MSG_ID_WIND_COV,
        mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS2_RAW,
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    }
)
DEFAULT_INTERVALS_US: dict[int, int] = {number: interval_us for number, (_, interval_us) in STREAMS.items()}
#: What goes to the port of the true state.
TRUTH_STREAMS: dict[int, int] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1_000_000,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: 20_000,
}
