"""Health, sensors, battery, time and identity as MAVLink messages: those that are sent a few times a second.

Times are microseconds or milliseconds since boot, never the wall clock.
"""

from math import hypot, sqrt
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.commander import READY_AFTER_S
from vehicle_sim.autopilot.guidance import DescendTask, LandTask, ReturnTask
from vehicle_sim.autopilot.mission import MissionTask
from vehicle_sim.autopilot.modes import Mode, base_mode
from vehicle_sim.protocol.payloads import Layout, Payload
from vehicle_sim.sensors import TEMPERATURE_C, pressure_altitude_m
from vehicle_sim.telemetry.motion import e7, int16, int32
from vehicle_sim.vehicle import Vehicle

_HIGHRES_IMU = Layout(mavlink.MAVLink_highres_imu_message)

_SENSORS_PRESENT = 0x300402F
_SENSORS_ENABLED = 0x301402F
_HEALTH_READY = 0x1320C83F
_HEALTH_BOOT = 0x0320C80F
_UINT16_UNKNOWN = 65535
_ESTIMATOR_ATTITUDE = int(mavlink.ESTIMATOR_ATTITUDE)
_ESTIMATOR_ACROSS = 2 | 8 | 16 | 256 | 512  # velocity, position: relative, absolute, and to be had of either
_ESTIMATOR_DOWN = 4 | 32  # climb, height
_GPS_FIX_AFTER_S = 2.0
_INNOVATION_GATE = 5.0
_ROOT2 = sqrt(2.0)


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


def highres_imu(v: Vehicle) -> Payload:
    """HIGHRES_IMU: raw sensors, FRD."""
    r = v.readings
    altitude_m = pressure_altitude_m(r.pressure_hpa)
    return _HIGHRES_IMU.pack(
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


def gps_raw_int(v: Vehicle) -> Any:
    """GPS_RAW_INT."""
    r = v.readings
    found = v.t_s >= _GPS_FIX_AFTER_S and not v.failures.gps_lost
    fix = mavlink.GPS_FIX_TYPE_3D_FIX if found else mavlink.GPS_FIX_TYPE_NO_FIX
    place = v.geo.to_geodetic(r.gps_ned_m)
    vn, ve, _ = r.gps_velocity_mps
    millimetres = int32(place.altitude_m * 1e3)
    return mavlink.MAVLink_gps_raw_int_message(
        v.t_us,
        fix,
        e7(place.latitude_deg),
        e7(place.longitude_deg),
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
        _SENSORS_PRESENT,
        _SENSORS_ENABLED,
        health & ~v.failures.health_bits_lost,
        250,
        min(65534, round(b.voltage_v * 1e3)),
        int16(b.current_a * 100),
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
    """ESTIMATOR_STATUS: each test ratio is an innovation over its gate, each accuracy one standard deviation, in both axes together."""
    a, z = v.accuracy, v.flight.innovation.tolist()
    across_m, down_m = v.accuracy_now()
    return mavlink.MAVLink_estimator_status_message(
        v.t_us,
        _estimator_flags(v),
        _test_ratio(hypot(z[3], z[4]), a.gps_velocity_mps),
        _test_ratio(hypot(z[0], z[1]), a.gps_position_m),
        _test_ratio(z[6], a.barometer_m),
        _test_ratio(z[7], a.compass_rad),
        0.0,
        0.0,
        _ROOT2 * across_m,
        down_m,
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
        e7(place.latitude_deg),
        e7(place.longitude_deg),
        int32(place.altitude_m * 1e3),
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
        e7(o.latitude_deg), e7(o.longitude_deg), int32(o.altitude_m * 1e3), v.t_us
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
        int16(b.current_a * 100),
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


def _ms(v: Vehicle) -> int:
    return v.t_us // 1000


def _estimator_flags(v: Vehicle) -> int:
    """What is valid; horizontally it is not when GPS has been lost for longer than EKF2_NOAID_TOUT."""
    flags = _ESTIMATOR_ATTITUDE
    if v.t_s >= READY_AFTER_S:
        flags |= _ESTIMATOR_ACROSS if v.autopilot.commander.health.estimate_good else 0
        flags |= 0 if v.failures.height_lost else _ESTIMATOR_DOWN
    return flags


def _test_ratio(innovation: float, std: float) -> float:
    return abs(innovation) / (_INNOVATION_GATE * std) if std > 0.0 else 0.0


def _is_landing(v: Vehicle) -> bool:
    task = v.autopilot.task
    return isinstance(task, LandTask | DescendTask) or (isinstance(task, ReturnTask | MissionTask) and task.landing)


def _charge_state(v: Vehicle) -> int:
    charge, parameters = v.battery.charge, v.autopilot.parameters
    if charge <= parameters["BAT_EMERGEN_THR"]:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY)
    if charge <= parameters["BAT_CRIT_THR"]:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL)
    if charge <= parameters["BAT_LOW_THR"]:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_LOW)
    return int(mavlink.MAV_BATTERY_CHARGE_STATE_OK)
