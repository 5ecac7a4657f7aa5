"""The sensors in the flight kernel: what each one measures, how often and how late. Functions of the kernel's records.

    reading = truth + bias + wander + white noise

IMU: every step. Magnetometer: every `readings_every` steps; both with constant biases. Barometer: with it, and its height wanders. GPS:
position (wandering) and velocity at a rate of its own, `gps_delay` ticks late; a tick is one slow step. What is lost keeps its last
reading. The telemetry shows the same numbers that the estimator is given.

`m` is the record FLIGHT, `c` CONSTANTS, `n` this step's row of standard normal numbers.
"""

from math import nan
from typing import Any

from vehicle_sim.compiled import inlined
from vehicle_sim.dynamics import specific_force
from vehicle_sim.memory import put, state_of, three
from vehicle_sim.noise import NOISE_COLUMNS, first_column
from vehicle_sim.sensors import magnetic_field, noisy, pressure_hpa

MAG_LOST, BARO_LOST, GPS_LOST = 1, 2, 4
#: Ticks that fixes under way and past estimates are kept.
HISTORY = 16
_GYRO, _ACCEL = first_column(NOISE_COLUMNS, "gyroscope"), first_column(NOISE_COLUMNS, "accelerometer")
_MAG, _BARO = first_column(NOISE_COLUMNS, "magnetometer"), first_column(NOISE_COLUMNS, "barometer")
_GPS, _GPS_SPEED = first_column(NOISE_COLUMNS, "gps"), first_column(NOISE_COLUMNS, "gps velocity")
_GPS_WANDER, _BARO_WANDER = first_column(NOISE_COLUMNS, "gps wander"), first_column(NOISE_COLUMNS, "barometer wander")


@inlined
def sense_motion(m: Any, c: Any, n: Any) -> None:
    """Accelerometer and gyroscope."""
    x, std, a, b = state_of(m.x), c.sensor_std, c.accel_bias, c.gyro_bias
    f = specific_force(state_of(m.before), x, c.dt_s)
    put(m.readings, noisy((f[0] + a[0], f[1] + a[1], f[2] + a[2]), std[0], three(n, _ACCEL)))
    put(m.readings, noisy((x.p + b[0], x.q + b[1], x.r + b[2]), std[1], three(n, _GYRO)), 3)


@inlined
def sense_field_and_pressure(m: Any, c: Any, n: Any) -> None:
    """Magnetometer and barometer."""
    x, std = state_of(m.x), c.sensor_std
    if not c.sensors_lost & MAG_LOST:
        f, b = magnetic_field(x), c.field_bias
        put(m.readings, noisy((f[0] + b[0], f[1] + b[1], f[2] + b[2]), std[2], three(n, _MAG)), 6)
    if not c.sensors_lost & BARO_LOST:
        m.readings[9] = pressure_hpa(c.ground_altitude - x.d - m.wander[3]) + std[3] * n[_BARO]


@inlined
def wander(m: Any, c: Any, n: Any) -> None:
    """First-order wander of GPS position and of the barometer, one tick further."""
    for i in range(3):
        m.wander[i] = c.wander_keep * m.wander[i] + c.wander_kick[i] * n[_GPS_WANDER + i]
    m.wander[3] = c.wander_keep * m.wander[3] + c.wander_kick[3] * n[_BARO_WANDER]


@inlined
def sense_place(m: Any, c: Any, n: Any, tick: int) -> bool:
    """GPS: send a fix on its way when one is due; true when one arrives."""
    lost = bool(c.sensors_lost & GPS_LOST)
    if _is_fix(tick, c):
        line = m.gps_line[tick % HISTORY]
        for i in range(3):
            line[i] = m.x[i] + m.wander[i] + c.sensor_std[4 + i // 2] * n[_GPS + i]
            line[3 + i] = m.x[3 + i] + c.sensor_std[6] * n[_GPS_SPEED + i]
        if lost:
            line[0] = nan
    then = tick - c.gps_delay
    if lost or not _is_fix(then, c):
        return False
    line = m.gps_line[then % HISTORY]
    if line[0] != line[0]:
        return False
    for i in range(6):
        m.readings[10 + i] = line[i]
    return True


@inlined
def _is_fix(tick: int, c: Any) -> bool:
    """Whether a fix is measured in this tick; the rate need not divide the ticks'."""
    if tick < 1:
        return False
    return int(tick * c.fixes_per_tick + 1e-9) != int((tick - 1) * c.fixes_per_tick + 1e-9)
