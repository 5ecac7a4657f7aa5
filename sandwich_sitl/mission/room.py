"""Whether a configuration leaves its plans room: refused before there is a flight, not given up in one.

Raises `InputError` with the keys and what would be right; paper mode knows no limits and is not looked at.
"""

from math import ceil, floor

from sandwich_sitl.config import RunConfig
from sandwich_sitl.control.horizon import INSCRIBED
from sandwich_sitl.control.mpc import Mpc, motion_limits
from sandwich_sitl.control.stop_plan import STEEPEST
from sandwich_sitl.control.tracker import LIFT_M, accepted_motion
from sandwich_sitl.errors import InputError

_LONG_ENOUGH = 6.0  # horizon times bandwidth with which plans settle at every rate
_LEAST_BAND_M = 0.3  # a plan needs 0.25 to 0.29 at bandwidths from 16 to 4 rad/s, after a push-off of 0.2
_RATE_WHERE_STEEPEST = 0.5  # s' of a stop when it brakes hardest; what the plan itself does then counts by its square


def check_room(config: RunConfig, mpc: Mpc) -> None:
    """Limits that leave less than the reference asks for, a horizon too short to settle or to stop in, a band of height
    that ends below the push-off.
    """
    if config.mode == "paper":
        return
    _check_limits(config)
    _check_settling(config, mpc)
    _check_stopping(config)
    _check_lift_off(config)


def _check_limits(config: RunConfig) -> None:
    """A plan that may not do what its reference does falls behind and is given up in flight; so it is not taken up.

    Across, the plan keeps within a polygon inside the limit's circle.
    """
    planner, tilted = config.planner, "acceleration_mps2 (with mpc.tilt_deg)"
    pairs = [
        ("speed_mps", INSCRIBED * config.mpc.speed_mps, "speed_mps", planner.speed_mps),
        (
            tilted,
            INSCRIBED * motion_limits(config.mpc).acceleration_mps2,
            "acceleration_mps2",
            planner.acceleration_mps2,
        ),
    ]
    if planner.floors_m:
        pairs += [
            ("climb_mps", config.mpc.climb_mps, "climb_mps", planner.climb_mps),
            ("climb_mps", config.mpc.climb_mps, "descent_mps", planner.descent_mps),
        ]
    for key, plan, slower, reference in pairs:
        if plan < reference:
            raise InputError(
                f"mpc.{key}: leaves the plan {plan:.3g} in every direction, less than planner.{slower} {reference:g}, so "
                "it could not follow its own reference; raise the one or lower the other"
            )


def _check_settling(config: RunConfig, mpc: Mpc) -> None:
    """Plans over a horizon that is short for their bandwidth do not come to rest at its end, and overshoot ever more."""
    radius = max(horizon.settling(1.0 / config.mpc.rate_hz) for horizon in (mpc.plane, mpc.height))
    if radius >= 1.0:
        raise InputError(
            f"mpc.horizon_steps x mpc.step_s: {mpc.n_tau * mpc.step_s:.3g} s are too short for mpc.bandwidth_radps "
            f"{config.mpc.bandwidth_radps:g} at mpc.rate_hz {config.mpc.rate_hz:g}: from tick to tick the plans would run away "
            f"from their reference; give a horizon of {_LONG_ENOUGH / config.mpc.bandwidth_radps:.1f} s or more"
        )


def _check_stopping(config: RunConfig) -> None:
    """A plan is flown only if its stop keeps the limits, and a stop may last twice what is left of the horizon
    (`stop_plan`): where that is too short for the reference's speed, no plan of steady flight would ever be accepted.

    A stop that need not last so long brakes with `mission.brake_mps2`, which the limits leave room for.
    """
    mpc, planner = config.mpc, config.planner
    beside_mps2 = _RATE_WHERE_STEEPEST**2 * planner.acceleration_mps2
    room_mps2 = accepted_motion(config).across_mps2 - beside_mps2
    horizon_s, period_s = mpc.horizon_steps * mpc.step_s, 1.0 / mpc.rate_hz
    longest_s = 2.0 * (horizon_s - period_s)
    needed_s = STEEPEST * planner.speed_mps / room_mps2
    if longest_s < needed_s:
        raise InputError(
            f"mpc.horizon_steps x mpc.step_s: in {horizon_s:.3g} s no plan at planner.speed_mps {planner.speed_mps:g} stops "
            f"within the {room_mps2:.3g} m/s2 that mpc.acceleration_mps2 leaves for it, so none would be flown; give a "
            f"horizon of {_up(needed_s / 2 + period_s)} s or more, or a planner.speed_mps of "
            f"{_down(longest_s * room_mps2 / STEEPEST)} or less"
        )


def _check_lift_off(config: RunConfig) -> None:
    """The push-off asks for a height and a speed at once, while the reference waits on the ground: the plan goes on
    upwards before it comes back, and must not leave the band on the way, or none is flown.
    """
    band_m = config.mpc.height_band_m
    if band_m < _LEAST_BAND_M:
        raise InputError(
            f"mpc.height_band_m: {band_m:g} m do not hold the push-off of {LIFT_M:g} m, by which the autopilot takes off, "
            f"and the way back from it; give {_LEAST_BAND_M:g} or more"
        )


def _up(value: float) -> str:
    return f"{ceil(round(100 * value, 6)) / 100:g}"


def _down(value: float) -> str:
    return f"{floor(round(100 * value, 6)) / 100:g}"
