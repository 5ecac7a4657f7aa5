"""The parts of the vehicle as the configuration names them: airframe, wind, sensors, battery, failures, home, signing.

Keys carry their units; ENU where a key says so, else body axes forward, right, down.
"""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True, config=STRICT)
class AirframeConfig:
    """An X quadcopter; the defaults are of the x500 class."""

    mass_kg: Positive = 2.0
    inertia_kgm2: Annotated[
        tuple[Positive, Positive, Positive], Field(description="principal moments about forward, right, down")
    ] = (0.0217, 0.0217, 0.04)
    arm_m: Annotated[float, Field(gt=0, description="hub to motor")] = 0.246
    thrust_coefficient_n_per_radps2: Annotated[float, Field(gt=0, description="thrust = k omega^2")] = 8.55e-6
    torque_coefficient_m: Annotated[float, Field(gt=0, description="drag torque / thrust of a rotor")] = 0.016
    motor_time_constant_s: Annotated[float, Field(gt=0, description="of a rotor that speeds up")] = 0.02
    motor_time_constant_down_s: Annotated[float, Field(ge=0, description="of one that slows down; 0: the same")] = 0.0
    max_thrust_n: Annotated[float, Field(gt=0, description="of one rotor")] = 8.55
    linear_drag_n_per_mps: Annotated[
        tuple[NonNegative, NonNegative, NonNegative], Field(description="along forward, right, down")
    ] = (0.19, 0.19, 0.1)
    quadratic_drag_n_per_mps2: NonNegative = 0.02
    rotor_drag_n_per_mps_radps: Annotated[
        float, Field(ge=0, description="of each rotor, across its axis, in proportion to its speed")
    ] = 0.0


@dataclass(frozen=True, config=STRICT)
class GustConfig:
    """One gust of the shape (1 - cos) / 2: it swells to `peak_enu_mps` and is over after `duration_s`."""

    at_s: NonNegative
    duration_s: Positive
    peak_enu_mps: tuple[float, float, float]


@dataclass(frozen=True, config=STRICT)
class WindConfig:
    """Uniform mean wind, a first-order gust on each axis, Dryden turbulence (MIL-F-8785C, low altitude), discrete gusts."""

    mean_enu_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_std_mps: Annotated[tuple[NonNegative, NonNegative, NonNegative], Field(description="east, north, up")] = (
        0.0,
        0.0,
        0.0,
    )
    gust_correlation_s: Positive = 2.0
    dryden_w20_mps: Annotated[
        float, Field(ge=0, le=40, description="wind speed at 20 ft that sets the turbulence; 0: none")
    ] = 0.0
    discrete_gusts: tuple[GustConfig, ...] = ()


@dataclass(frozen=True, config=STRICT)
class SensorsConfig:
    """White noise, constant biases and slow wander of the sensors, and what the autopilot makes of them."""

    estimator: Annotated[
        Literal["filter", "error_model"],
        Field(
            description="filter: an estimate made of the sensors, with PX4-like errors; "
            "error_model: truth plus the errors `estimate_*`, all zero for a perfect estimate"
        ),
    ] = "filter"
    accelerometer_std_mps2: NonNegative = 0.05
    accelerometer_bias_std_mps2: NonNegative = 0.03
    gyroscope_std_radps: NonNegative = 0.002
    gyroscope_bias_std_radps: NonNegative = 0.002
    magnetometer_std_gauss: NonNegative = 0.002
    magnetometer_bias_std_gauss: NonNegative = 0.002
    barometer_std_hpa: NonNegative = 0.02
    barometer_drift_std_m: NonNegative = 0.2
    gps_horizontal_std_m: Annotated[float, Field(ge=0, description="each axis, nearly all of it slow wander")] = 0.3
    gps_vertical_std_m: NonNegative = 0.6
    gps_speed_std_mps: NonNegative = 0.1
    gps_rate_hz: Annotated[float, Field(ge=1, le=50)] = 8.0
    gps_delay_s: Annotated[float, Field(ge=0, le=0.15, description="from measurement to arrival")] = 0.12
    gps_correlation_s: Annotated[float, Field(gt=0, description="of the wander of GPS and barometer")] = 60.0
    estimate_position_std_m: NonNegative = 0.02
    estimate_velocity_std_mps: NonNegative = 0.02
    estimate_attitude_std_rad: NonNegative = 0.003
    estimate_correlation_s: Positive = 5.0


@dataclass(frozen=True, config=STRICT)
class BatteryConfig:
    """A lithium-polymer pack."""

    cells: Annotated[int, Field(ge=1, le=14)] = 4
    capacity_ah: Positive = 5.0
    initial_charge: Annotated[float, Field(ge=0, le=1, description="state of charge at boot")] = 1.0
    internal_resistance_ohm: NonNegative = 0.02
    base_current_a: Annotated[float, Field(ge=0, description="avionics")] = 0.6
    efficiency: Annotated[float, Field(gt=0, le=1, description="shaft power / electrical power")] = 0.75


@dataclass(frozen=True, config=STRICT)
class FailureConfig:
    """A part that fails, or is `ok` again, at a time since boot; `wind` is a step to a new mean wind."""

    at_s: NonNegative
    part: Literal["motor", "gps", "barometer", "magnetometer", "battery", "wind"]
    ok: bool = False
    instance: Annotated[int, Field(ge=0, le=4, description="motor 1 to 4 in PX4's order, 0 for all")] = 0
    wind_enu_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, config=STRICT)
class ObstacleConfig:
    """Something solid that stands in the true world from a time on; others learn of it through the range sensor alone."""

    name: Annotated[str, Field(min_length=1)]
    polygon_m: Annotated[
        tuple[tuple[float, float], ...], Field(min_length=3, description="corners, x east, y north, world frame")
    ]
    appears_s: Annotated[float, Field(ge=0, description="time since boot")] = 0.0
    height_m: Annotated[float | None, Field(gt=0, description="above the ground; null: higher than anything flies")] = (
        None
    )


@dataclass(frozen=True, config=STRICT)
class RangeSensorConfig:
    """A level scanner on the vehicle's nose that sends OBSTACLE_DISTANCE."""

    rate_hz: Annotated[float, Field(ge=0.5, le=50)] = 10.0
    reach_m: Annotated[float, Field(gt=0, le=650)] = 20.0
    least_m: Annotated[float, Field(ge=0, description="shortest range it can tell")] = 0.2
    field_deg: Annotated[float, Field(gt=0, le=360, description="centred on the nose")] = 360.0
    sectors: Annotated[int, Field(ge=1, le=72)] = 72
    noise_std_m: NonNegative = 0.03


@dataclass(frozen=True, config=STRICT)
class SigningConfig:
    """MAVLink 2 signing: on when there is a passphrase."""

    passphrase: Annotated[str, Field(description="as typed into the ground station; empty: no signing")] = ""
    epoch: Annotated[int, Field(ge=0, description="time stamp at boot, in 10 us since 2015")] = 0


@dataclass(frozen=True, config=STRICT)
class HomeConfig:
    """Where the local origin lies on the earth (WGS84)."""

    latitude_deg: Annotated[float, Field(ge=-85, le=85)] = 47.397742
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = 8.545594
    altitude_m: Annotated[float, Field(ge=-500, le=10000, description="above mean sea level")] = 488.0
