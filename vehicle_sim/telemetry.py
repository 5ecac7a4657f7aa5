"""The vehicle's state as MAVLink messages, at PX4's onboard rates. One function a message; units are MAVLink's.

Every conversion from SI, NED/FRD happens here. Times are microseconds or milliseconds since boot, never the wall clock.
"""

from collections.abc import Callable
from math import degrees, hypot, isfinite, nan
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.guidance import LandTask, ReturnTask
from vehicle_sim.autopilot.modes import Mode, base_mode
from vehicle_sim.rotation import euler_from_quaternion, rotate_back
from vehicle_sim.sensors import TEMPERATURE_C, pressure_altitude_m
from vehicle_sim.vehicle import Vehicle

Builder = Callable[[Vehicle], Any]

_SENSORS_PRESENT = 0x300402F
_SENSORS_ENABLED = 0x301402F
_HEALTH_READY = 0x1320C83F
_HEALTH_BOOT = 0x0320C80F
_PREARM_CHECK = 0x10000000
_UINT16_UNKNOWN = 65535
_ESTIMATOR_FLAGS_GOOD = 831
_GPS_FIX_AFTER_S = 2.0
_NO_COVARIANCE = [nan] + [0.0] * 20


def heartbeat(v: Vehicle) -> Any:
    """HEARTBEAT as measured on PX4."""
    commander, pilot = v.autopilot.commander, v.autopilot
    mode = commander.flown_mode
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        base_mode(mode, commander.armed, pilot.offboard_signal()),
        mode.custom_mode,
        int(commander.system_status()),
        3,
    )


def attitude(v: Vehicle) -> Any:
    """ATTITUDE: Euler angles and body rates of the estimate."""
    angles = euler_from_quaternion(v.estimate.q_wb_wxyz)
    return mavlink.MAVLink_attitude_message(_ms(v), *angles, *v.estimate.omega_wb_b_radps)


def attitude_quaternion(v: Vehicle) -> Any:
    """ATTITUDE_QUATERNION."""
    return mavlink.MAVLink_attitude_quaternion_message(
        _ms(v), *v.estimate.q_wb_wxyz, *v.estimate.omega_wb_b_radps, [0.0, 0.0, 0.0, 0.0]
    )


def highres_imu(v: Vehicle) -> Any:
    """HIGHRES_IMU: raw sensors, FRD."""
    r = v.readings
    altitude_m = pressure_altitude_m(r.pressure_hpa)
    return mavlink.MAVLink_highres_imu_message(
        v.t_us,
        *r.specific_force_mps2,
        *r.gyroscope_radps,
        *r.magnetometer_gauss,
        r.pressure_hpa,
        0.0,
        altitude_m,
        TEMPERATURE_C,
        0x1FFF,
        0,
    )


def local_position_ned(v: Vehicle) -> Any:
    """LOCAL_POSITION_NED."""
    return mavlink.MAVLink_local_position_ned_message(_ms(v), *v.estimate.position_ned_m, *v.estimate.velocity_ned_mps)


def odometry(v: Vehicle) -> Any:
    """ODOMETRY: pose in LOCAL_NED (1), velocity in BODY_FRD (12)."""
    e = v.estimate
    return mavlink.MAVLink_odometry_message(
        v.t_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_BODY_FRD,
        *e.position_ned_m,
        list(e.q_wb_wxyz),
        *rotate_back(e.q_wb_wxyz, e.velocity_ned_mps),
        *e.omega_wb_b_radps,
        _NO_COVARIANCE,
        _NO_COVARIANCE,
        0,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def global_position_int(v: Vehicle) -> Any:
    """GLOBAL_POSITION_INT of the estimate; heading in centidegrees."""
    place = v.geo.to_geodetic(v.estimate.position_ned_m)
    vn, ve, vd = v.estimate.velocity_ned_mps
    return mavlink.MAVLink_global_position_int_message(
        _ms(v),
        _e7(place.latitude_deg),
        _e7(place.longitude_deg),
        round(place.altitude_m * 1e3),
        round(_relative_altitude_m(v) * 1e3),
        _int16(vn * 100),
        _int16(ve * 100),
        _int16(vd * 100),
        round(_heading_deg(v) * 100) % 36000,
    )


def altitude(v: Vehicle) -> Any:
    """ALTITUDE."""
    up = -v.estimate.position_ned_m[2]
    above_sea = v.geo.origin.altitude_m + up
    return mavlink.MAVLink_altitude_message(v.t_us, above_sea, above_sea, up, _relative_altitude_m(v), nan, nan)


def vfr_hud(v: Vehicle) -> Any:
    """VFR_HUD."""
    vn, ve, vd = v.estimate.velocity_ned_mps
    speed = hypot(vn, ve)
    above_sea = v.geo.origin.altitude_m - v.estimate.position_ned_m[2]
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, round(_heading_deg(v)) % 360, round(100 * v.autopilot.thrust_sp), above_sea, -vd
    )


def servo_output_raw(v: Vehicle) -> Any:
    """SERVO_OUTPUT_RAW: 1000 to 2000 us, 900 when disarmed."""
    armed = v.autopilot.commander.armed
    outputs = [round(1000 + 1000 * f) if armed else 900 for f in v.fractions]
    return mavlink.MAVLink_servo_output_raw_message(v.t_us & 0xFFFFFFFF, 0, *outputs, *([0] * 12))


def attitude_target(v: Vehicle) -> Any:
    """ATTITUDE_TARGET."""
    pilot = v.autopilot
    return mavlink.MAVLink_attitude_target_message(_ms(v), 0, list(pilot.attitude_sp), *pilot.rate_sp, pilot.thrust_sp)


def position_target_local_ned(v: Vehicle) -> Any:
    """POSITION_TARGET_LOCAL_NED: what the position controller was given; NaN where nothing was."""
    s = v.autopilot.setpoint
    values = (*s.position_ned_m, *s.velocity_ned_mps, *s.acceleration_ned_mps2)
    mask = sum(1 << i for i, value in enumerate(values) if not isfinite(value))
    mask |= (0 if isfinite(s.yaw_rad) else 1 << 10) | (0 if isfinite(s.yaw_rate_radps) else 1 << 11)
    return mavlink.MAVLink_position_target_local_ned_message(
        _ms(v), mavlink.MAV_FRAME_LOCAL_NED, mask, *values, s.yaw_rad, s.yaw_rate_radps
    )


def gps_raw_int(v: Vehicle) -> Any:
    """GPS_RAW_INT."""
    r = v.readings
    fix = mavlink.GPS_FIX_TYPE_3D_FIX if v.t_s >= _GPS_FIX_AFTER_S else mavlink.GPS_FIX_TYPE_NO_FIX
    place = v.geo.to_geodetic(r.gps_ned_m)
    vn, ve, _ = v.state.velocity_ned_mps
    millimetres = round(place.altitude_m * 1e3)
    return mavlink.MAVLink_gps_raw_int_message(
        v.t_us,
        fix,
        _e7(place.latitude_deg),
        _e7(place.longitude_deg),
        millimetres,
        70,
        100,
        min(65534, round(hypot(vn, ve) * 100)),
        _UINT16_UNKNOWN,
        14 if fix == mavlink.GPS_FIX_TYPE_3D_FIX else 0,
        millimetres,
        round(v.config.sensors.gps_horizontal_std_m * 1e3),
        round(v.config.sensors.gps_vertical_std_m * 1e3),
        100,
        0,
        0,
    )


def sys_status(v: Vehicle) -> Any:
    """SYS_STATUS: sensor bits as measured on PX4; the pre-arm bit follows the commander."""
    ready = v.autopilot.commander.is_ready()
    health = _HEALTH_READY if ready else _HEALTH_BOOT
    b = v.battery
    return mavlink.MAVLink_sys_status_message(
        _SENSORS_PRESENT | _PREARM_CHECK,
        _SENSORS_ENABLED | _PREARM_CHECK,
        health,
        250,
        min(65534, round(b.voltage_v * 1e3)),
        _int16(b.current_a * 100),
        round(100 * b.charge),
        0,
        0,
        0,
        0,
        0,
        0,
    )


def extended_sys_state(v: Vehicle) -> Any:
    """EXTENDED_SYS_STATE: on ground 1, in air 2, taking off 3, landing 4."""
    pilot = v.autopilot
    state = mavlink.MAV_LANDED_STATE_IN_AIR
    if pilot.landed:
        state = mavlink.MAV_LANDED_STATE_ON_GROUND
    elif pilot.commander.flown_mode is Mode.TAKEOFF:
        state = mavlink.MAV_LANDED_STATE_TAKEOFF
    elif _is_landing(v):
        state = mavlink.MAV_LANDED_STATE_LANDING
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state)


def estimator_status(v: Vehicle) -> Any:
    """ESTIMATOR_STATUS."""
    ready = v.autopilot.commander.is_ready()
    std = v.config.sensors.estimate_position_std_m
    return mavlink.MAVLink_estimator_status_message(
        v.t_us, _ESTIMATOR_FLAGS_GOOD if ready else 1, 0.05, 0.05, 0.05, 0.05, 0.0, 0.0, std, std
    )


def system_time(v: Vehicle) -> Any:
    """SYSTEM_TIME: boot time alone, so that no payload depends on the wall clock."""
    return mavlink.MAVLink_system_time_message(0, _ms(v))


def ping(v: Vehicle) -> Any:
    """PING request."""
    return mavlink.MAVLink_ping_message(v.t_us, v.t_us // 1_000_000 & 0xFFFFFFFF, 0, 0)


def timesync(v: Vehicle) -> Any:
    """TIMESYNC request, nanoseconds since boot."""
    return mavlink.MAVLink_timesync_message(0, v.t_us * 1000)


def scaled_pressure(v: Vehicle) -> Any:
    """SCALED_PRESSURE."""
    return mavlink.MAVLink_scaled_pressure_message(_ms(v), v.readings.pressure_hpa, 0.0, round(TEMPERATURE_C * 100), 0)


def home_position(v: Vehicle) -> Any:
    """HOME_POSITION; None until home is set."""
    home = v.autopilot.home_ned_m
    if home is None:
        return None
    place = v.geo.to_geodetic(home)
    return mavlink.MAVLink_home_position_message(
        _e7(place.latitude_deg),
        _e7(place.longitude_deg),
        round(place.altitude_m * 1e3),
        *home,
        [1.0, 0.0, 0.0, 0.0],
        0.0,
        0.0,
        0.0,
        v.t_us,
    )


def gps_global_origin(v: Vehicle) -> Any:
    """GPS_GLOBAL_ORIGIN: the local frame's origin."""
    o = v.geo.origin
    return mavlink.MAVLink_gps_global_origin_message(
        _e7(o.latitude_deg), _e7(o.longitude_deg), round(o.altitude_m * 1e3), v.t_us
    )


def battery_status(v: Vehicle) -> Any:
    """BATTERY_STATUS; the cells are equal."""
    b, config = v.battery, v.config.battery
    cell_mv = min(65534, round(b.voltage_v * 1e3 / config.cells))
    cells = [cell_mv if i < config.cells else _UINT16_UNKNOWN for i in range(10)]
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        cells,
        _int16(b.current_a * 100),
        round(b.consumed_ah * 1e3),
        -1,
        round(100 * b.charge),
        0,
        _charge_state(v),
        [cell_mv if 10 + i < config.cells else 0 for i in range(4)],
        0,
        0,
    )


def vibration(v: Vehicle) -> Any:
    """VIBRATION: this vehicle has none."""
    return mavlink.MAVLink_vibration_message(v.t_us, 0.0, 0.0, 0.0, 0, 0, 0)


def autopilot_version(v: Vehicle) -> Any:
    """AUTOPILOT_VERSION."""
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, 0x011000FF, 0x011000FF, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, v.config.system_id, [0] * 18
    )


#: Message id -> (builder, default interval in microseconds; 0 = on request only). Rates: row 16 and the measured list.
STREAMS: dict[int, tuple[Builder, int]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (heartbeat, 1_000_000),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (sys_status, 200_000),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (extended_sys_state, 200_000),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (attitude, 10_000),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (attitude_quaternion, 20_000),
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: (highres_imu, 20_000),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (global_position_int, 20_000),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (local_position_ned, 33_333),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: (odometry, 33_333),
    mavlink.MAVLINK_MSG_ID_TIMESYNC: (timesync, 100_000),
    mavlink.MAVLINK_MSG_ID_ALTITUDE: (altitude, 100_000),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (vfr_hud, 100_000),
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: (servo_output_raw, 100_000),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: (attitude_target, 100_000),
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: (position_target_local_ned, 100_000),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (gps_raw_int, 125_000),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (estimator_status, 1_000_000),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (system_time, 1_000_000),
    mavlink.MAVLINK_MSG_ID_PING: (ping, 1_000_000),
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: (scaled_pressure, 1_000_000),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: (home_position, 2_000_000),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: (battery_status, 2_000_000),
    mavlink.MAVLINK_MSG_ID_VIBRATION: (vibration, 2_000_000),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (gps_global_origin, 0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: (autopilot_version, 0),
}


def _ms(v: Vehicle) -> int:
    return v.t_us // 1000


def _e7(degree: float) -> int:
    return round(degree * 1e7)


def _int16(value: float) -> int:
    return max(-32767, min(32767, round(value)))


def _heading_deg(v: Vehicle) -> float:
    return degrees(euler_from_quaternion(v.estimate.q_wb_wxyz).yaw_rad) % 360.0


def _relative_altitude_m(v: Vehicle) -> float:
    home = v.autopilot.home_ned_m
    return (home[2] if home is not None else 0.0) - v.estimate.position_ned_m[2]


def _is_landing(v: Vehicle) -> bool:
    task = v.autopilot.task
    return isinstance(task, LandTask) or (isinstance(task, ReturnTask) and task.landing)


def _charge_state(v: Vehicle) -> int:
    charge, parameters = v.battery.charge, v.autopilot.parameters
    if charge <= parameters["BAT_EMERGEN_THR"]:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY)
    if charge <= parameters["BAT_CRIT_THR"]:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL)
    if charge <= parameters["BAT_LOW_THR"]:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_LOW)
    return int(mavlink.MAV_BATTERY_CHARGE_STATE_OK)
