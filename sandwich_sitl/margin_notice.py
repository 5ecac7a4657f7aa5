"""A word before a flight whose margin is too small for the vehicle's own estimate of where it is."""

from sandwich_sitl.config import RunConfig
from vehicle_sim.accuracy import accuracy_of
from vehicle_sim.config import VehicleConfig

_SPREADS = 3.0  # standard deviations on each axis; flights in gusts with less left their corridor
_STEP_S, _TICK_S = 0.002, 0.02  # of the vehicle at the usual rates; the spread hardly depends on them


def margin_notice(config: RunConfig, vehicle: VehicleConfig) -> str | None:
    """What to say, if anything: no controller sees that the estimate is off, so the margin has to have room for it."""
    spread_m = accuracy_of(vehicle.sensors, _STEP_S, _TICK_S).position_m
    if config.planner.margin_m >= _SPREADS * spread_m:
        return None
    return (
        f"planner.margin_m {config.planner.margin_m:g} is less than {_SPREADS:g} times the {spread_m:.2g} m by which the "
        f"vehicle's estimate is off on each axis (vehicle.sensors.estimator {vehicle.sensors.estimator}), so an obstacle may "
        f"be touched; give {_SPREADS * spread_m:.1f} or more"
    )
