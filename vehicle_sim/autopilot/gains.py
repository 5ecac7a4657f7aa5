"""Parameters into the kernel's constants: gains and limits of the controllers, read again when the table changes."""

from vehicle_sim.autopilot.attitude_control import AttitudeGains, RateGains, derivative_keep
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.position_control import PositionGains
from vehicle_sim.memory import Fields


def write_gains(parameters: ParameterStore, constants: Fields) -> None:
    """Fill the control fields of `constants`."""
    constants.position_gains[:] = PositionGains.of(parameters)
    attitude = AttitudeGains.of(parameters)
    constants.attitude_gains[:] = (*attitude.gain, attitude.yaw_weight, *attitude.limit_radps)
    rates = RateGains.of(parameters)
    constants.rate_p[:] = rates.p
    constants.rate_i[:] = rates.i
    constants.rate_d[:] = rates.d
    constants.rate_ff[:] = rates.feed_forward
    constants.rate_integral_limit[:] = rates.integral_limit
    constants.put("rate_keep", derivative_keep(constants.get("dt_s")))
