"""Attitude, position, velocity and what is asked of them, as MAVLink payloads. One function a message; units are MAVLink's.

Every conversion from SI, NED/FRD happens in this package. Fields stand in wire order (largest types first).
"""

from math import degrees, hypot, isfinite, nan

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.protocol.payloads import Layout, Payload
from vehicle_sim.rotation import euler_from_quaternion, rotate_back, yaw_of
from vehicle_sim.vehicle import Vehicle

_ATTITUDE = Layout(mavlink.MAVLink_attitude_message)
_ATTITUDE_QUATERNION = Layout(mavlink.MAVLink_attitude_quaternion_message)
_LOCAL_POSITION_NED = Layout(mavlink.MAVLink_local_position_ned_message)
_ODOMETRY = Layout(mavlink.MAVLink_odometry_message)
_GLOBAL_POSITION_INT = Layout(mavlink.MAVLink_global_position_int_message)
_ALTITUDE = Layout(mavlink.MAVLink_altitude_message)
_VFR_HUD = Layout(mavlink.MAVLink_vfr_hud_message)
_SERVO_OUTPUT_RAW = Layout(mavlink.MAVLink_servo_output_raw_message)
_ATTITUDE_TARGET = Layout(mavlink.MAVLink_attitude_target_message)
_POSITION_TARGET = Layout(mavlink.MAVLink_position_target_local_ned_message)
_HIL_STATE = Layout(mavlink.MAVLink_hil_state_quaternion_message)
_NO_COVARIANCE = (nan, *([0.0] * 20))
_AIRSPEED_UNKNOWN = 0


def attitude(v: Vehicle) -> Payload:
    """ATTITUDE: Euler angles and body rates of the estimate."""
    e = v.estimate
    roll, pitch, yaw = euler_from_quaternion(e.q_wb_wxyz)
    p, q, r = e.omega_wb_b_radps
    return _ATTITUDE.pack(v.t_us // 1000, roll, pitch, yaw, p, q, r)


def attitude_quaternion(v: Vehicle) -> Payload:
    """ATTITUDE_QUATERNION."""
    e = v.estimate
    return _ATTITUDE_QUATERNION.pack(v.t_us // 1000, *e.q_wb_wxyz, *e.omega_wb_b_radps, 0.0, 0.0, 0.0, 0.0)


def local_position_ned(v: Vehicle) -> Payload:
    """LOCAL_POSITION_NED."""
    e = v.estimate
    return _LOCAL_POSITION_NED.pack(v.t_us // 1000, *e.position_ned_m, *e.velocity_ned_mps)


def odometry(v: Vehicle) -> Payload:
    """ODOMETRY: pose in LOCAL_NED (1), velocity in BODY_FRD (12)."""
    e = v.estimate
    return _ODOMETRY.pack(
        v.t_us,
        *e.position_ned_m,
        *e.q_wb_wxyz,
        *rotate_back(e.q_wb_wxyz, e.velocity_ned_mps),
        *e.omega_wb_b_radps,
        *_NO_COVARIANCE,
        *_NO_COVARIANCE,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_BODY_FRD,
        0,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def global_position_int(v: Vehicle) -> Payload:
    """GLOBAL_POSITION_INT of the estimate; heading in centidegrees."""
    e = v.estimate
    place = v.geo.to_geodetic(e.position_ned_m)
    vn, ve, vd = e.velocity_ned_mps
    return _GLOBAL_POSITION_INT.pack(
        v.t_us // 1000,
        e7(place.latitude_deg),
        e7(place.longitude_deg),
        int32(place.altitude_m * 1e3),
        int32(relative_altitude_m(v) * 1e3),
        int16(vn * 100),
        int16(ve * 100),
        int16(vd * 100),
        round(_heading_deg(v) * 100) % 36000,
    )


def altitude(v: Vehicle) -> Payload:
    """ALTITUDE."""
    up = -v.estimate.position_ned_m[2]
    above_sea = v.geo.origin.altitude_m + up
    return _ALTITUDE.pack(v.t_us, above_sea, above_sea, up, relative_altitude_m(v), nan, nan)


def vfr_hud(v: Vehicle) -> Payload:
    """VFR_HUD."""
    vn, ve, vd = v.estimate.velocity_ned_mps
    speed = hypot(vn, ve)
    above_sea = v.geo.origin.altitude_m - v.estimate.position_ned_m[2]
    throttle = round(100 * v.flight.get("thrust_sp"))
    return _VFR_HUD.pack(speed, speed, above_sea, -vd, round(_heading_deg(v)) % 360, throttle)


def servo_output_raw(v: Vehicle) -> Payload:
    """SERVO_OUTPUT_RAW: 1000 to 2000 us, 900 when disarmed."""
    armed = v.autopilot.commander.armed
    outputs = [round(1000 + 1000 * f) if armed else 900 for f in v.fractions]
    return _SERVO_OUTPUT_RAW.pack(v.t_us & 0xFFFFFFFF, *outputs, 0, 0, 0, 0, 0, *([0] * 8))


def attitude_target(v: Vehicle) -> Payload:
    """ATTITUDE_TARGET."""
    f = v.flight
    return _ATTITUDE_TARGET.pack(v.t_us // 1000, *f.attitude_sp.tolist(), *f.rate_sp.tolist(), f.get("thrust_sp"), 0)


def position_target_local_ned(v: Vehicle) -> Payload:
    """POSITION_TARGET_LOCAL_NED: what the position controller was given; NaN where nothing was."""
    s = v.autopilot.setpoint
    values = (*s.position_ned_m, *s.velocity_ned_mps, *s.acceleration_ned_mps2)
    mask = sum(1 << i for i, value in enumerate(values) if not isfinite(value))
    mask |= (0 if isfinite(s.yaw_rad) else 1 << 10) | (0 if isfinite(s.yaw_rate_radps) else 1 << 11)
    return _POSITION_TARGET.pack(
        v.t_us // 1000, *values, s.yaw_rad, s.yaw_rate_radps, mask, mavlink.MAV_FRAME_LOCAL_NED
    )


def hil_state_quaternion(v: Vehicle) -> Payload:
    """HIL_STATE_QUATERNION: the truth. Acceleration in mg, speeds in cm/s, heights in mm."""
    x = v.state
    place = v.geo.to_geodetic(x.position_ned_m)
    ax, ay, az = v.specific_force_mps2()
    airspeed = hypot(*(a - b for a, b in zip(x.velocity_ned_mps, v.wind_ned_mps, strict=True)))
    return _HIL_STATE.pack(
        v.t_us,
        *x.q_wb_wxyz,
        *x.omega_wb_b_radps,
        e7(place.latitude_deg),
        e7(place.longitude_deg),
        int32(place.altitude_m * 1e3),
        int16(x.vn * 100),
        int16(x.ve * 100),
        int16(x.vd * 100),
        _AIRSPEED_UNKNOWN,
        min(65535, round(airspeed * 100)),
        int16(ax / 9.80665e-3),
        int16(ay / 9.80665e-3),
        int16(az / 9.80665e-3),
    )


def e7(degree: float) -> int:
    """Degrees in units of 1e-7."""
    return int32(degree * 1e7)


def int32(value: float) -> int:
    """Rounded and kept within a signed 32-bit field."""
    return max(-2147483647, min(2147483647, round(value)))


def int16(value: float) -> int:
    """Rounded and kept within a signed 16-bit field."""
    return max(-32767, min(32767, round(value)))


def relative_altitude_m(v: Vehicle) -> float:
    """Height above home."""
    home = v.autopilot.home_ned_m
    return (home[2] if home is not None else 0.0) - v.estimate.position_ned_m[2]


def _heading_deg(v: Vehicle) -> float:
    return degrees(yaw_of(v.estimate.q_wb_wxyz)) % 360.0
