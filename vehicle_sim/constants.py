"""The kernel's constants from the configuration: body, rotors, battery, wind, sensors. NED/FRD, SI."""

from math import exp, sqrt

import numpy as np

from vehicle_sim.battery import Pack
from vehicle_sim.config import VehicleConfig
from vehicle_sim.dynamics import Body
from vehicle_sim.memory import CONSTANTS, Fields
from vehicle_sim.parts import AirframeConfig, SensorsConfig, WindConfig
from vehicle_sim.rotors import RotorModel
from vehicle_sim.sensing import HISTORY
from vehicle_sim.sensors import WHITE_OF_GPS, ErrorModel, wander_of_gps
from vehicle_sim.wind import WindModel, keep_of


def write_constants(config: VehicleConfig, dt_s: float, slow_every: int) -> Fields:
    """A record for steps of `dt_s` and ticks of `slow_every` steps. Gains and failures are written by others."""
    c = Fields(CONSTANTS)
    c.put("dt_s", dt_s)
    c.put("slow_s", slow_every * dt_s)
    c.put("slow_every", slow_every)
    c.put("readings_every", 2 * slow_every)
    c.put("attitude_every", 2)
    c.put("ground_altitude", config.home.altitude_m)
    c.pack[:] = Pack.of(config.battery)
    _write_airframe(c, config.airframe, dt_s)
    _write_wind(c, config.wind, slow_every * dt_s)
    _write_sensors(c, config.sensors, slow_every * dt_s)
    return c


def _write_airframe(c: Fields, airframe: AirframeConfig, dt_s: float) -> None:
    body, rotors = Body.of(airframe), RotorModel.of(airframe)
    c.put("mass", body.mass_kg)
    c.put("quadratic_drag", body.quadratic_drag)
    c.put("lag_keep_up", exp(-dt_s / rotors.time_constant_s))
    c.put("lag_keep_down", exp(-dt_s / (airframe.motor_time_constant_down_s or rotors.time_constant_s)))
    c.put("rotor_drag", airframe.rotor_drag_n_per_mps_radps)
    c.inertia[:] = body.inertia_kgm2
    c.linear_drag[:] = body.linear_drag
    c.rotor[:] = rotors
    c.motor_health[:] = 1.0


def _write_wind(c: Fields, config: WindConfig, tick_s: float) -> None:
    wind = WindModel.of(config, tick_s)
    c.put("w20", config.dryden_w20_mps)
    c.put("gust_keep", wind.keep)
    c.wind_mean[:] = wind.mean_ned_mps
    c.gust_kick[:] = wind.kick_ned_mps


def _write_sensors(c: Fields, s: SensorsConfig, tick_s: float) -> None:
    errors, keep = ErrorModel.of(s, tick_s), keep_of(tick_s, s.gps_correlation_s)
    c.put("filter", s.estimator == "filter")
    c.put("error_keep", errors.keep)
    c.error_kick[:] = errors[1:]
    c.put("fixes_per_tick", s.gps_rate_hz * tick_s)
    c.put("gps_delay", min(HISTORY - 1, round(s.gps_delay_s / tick_s)))
    across_m, down_m = wander_of_gps(s.gps_horizontal_std_m), wander_of_gps(s.gps_vertical_std_m)
    c.put("wander_keep", keep)
    c.wander_kick[:] = sqrt(1.0 - keep**2) * np.array((across_m, across_m, down_m, s.barometer_drift_std_m))
    c.sensor_std[:] = (
        s.accelerometer_std_mps2,
        s.gyroscope_std_radps,
        s.magnetometer_std_gauss,
        s.barometer_std_hpa,
        WHITE_OF_GPS * s.gps_horizontal_std_m,
        WHITE_OF_GPS * s.gps_vertical_std_m,
        s.gps_speed_std_mps,
    )
