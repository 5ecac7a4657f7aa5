"""How far off the estimate is expected to be, from the estimator's gains and the sensors' noise (`error_laws`).

At boot the place is known and the sensors' biases are not: until the gyroscope's is found, in half a minute, the estimate is not yet much
worse, but it drifts five times as fast as later when GPS is lost. When GPS or the barometer is lost, the covariance of that moment moves on
without their corrections; when they are back, with them again, from the first fix that arrives on; after more than `RESET_AFTER_S` without,
that fix is believed at once, as the estimator does. All this is worked out when somebody asks, from the list of what failed when. SI.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.error_laws import Law, barometer_white_m, laws_of
from vehicle_sim.estimator import RESET_AFTER_S
from vehicle_sim.failures import SensorsLost
from vehicle_sim.parts import SensorsConfig
from vehicle_sim.sensing import BARO_LOST, GPS_LOST
from vehicle_sim.sensors import HORIZONTAL_FIELD_GAUSS, WHITE_OF_GPS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Accuracy:
    """Standard deviations: of the estimate on each horizontal axis and of its height; of the innovations of GPS, barometer, compass."""

    position_m: float
    height_m: float
    gps_position_m: float = 0.0
    gps_velocity_mps: float = 0.0
    barometer_m: float = 0.0
    compass_rad: float = 0.0


@dataclass(frozen=True)
class _Span:
    """A time in which no sensor fails or returns: covariances at its beginning, when the last fix came before it, whether GPS is
    there from its beginning on, so that its first fix is still to come.
    """

    begun_s: float
    lost: int
    spreads: tuple[Array, Array]
    fixed_s: float
    awaits_fix: bool


def accuracy_of(config: SensorsConfig, dt_s: float, tick_s: float) -> Accuracy:
    """Of the estimator fed by all of these sensors; of the error model, what it was told."""
    across, down = (law.settled() for law in laws_of(config, dt_s, tick_s))
    if config.estimator == "error_model":
        return Accuracy(sqrt(across[0, 0]), sqrt(down[0, 0]))
    white_m = WHITE_OF_GPS * config.gps_horizontal_std_m
    return Accuracy(
        sqrt(across[0, 0]),
        sqrt(down[0, 0]),
        sqrt(across[0, 0] + across[4, 4] - 2.0 * across[0, 4] + white_m**2),
        sqrt(across[1, 1] + config.gps_speed_std_mps**2),
        sqrt(down[0, 0] + down[3, 3] - 2.0 * down[0, 3] + barometer_white_m(config) ** 2),
        config.magnetometer_std_gauss / HORIZONTAL_FIELD_GAUSS,
    )


class AccuracyInFlight:
    """The accuracy since boot, as sensors fail and return."""

    def __init__(self, config: SensorsConfig, dt_s: float, tick_s: float) -> None:
        self._laws = laws_of(config, dt_s, tick_s)
        self._tick_s = tick_s
        self._seen = 0
        self._span = _Span(0.0, 0, (self._laws[0].begins, self._laws[1].begins), 0.0, True)

    def at(self, t_s: float, failed: Sequence[SensorsLost]) -> tuple[float, float]:
        """Standard deviations (m) of the position on each horizontal axis and of the height, at a time no earlier than asked for
        before; `failed` is all that has failed or returned until then, in order.
        """
        for change in failed[self._seen :]:
            self._span = self._next(change)
        self._seen = len(failed)
        across, down = self._spreads(t_s)
        return sqrt(across[0, 0]), sqrt(down[0, 0])

    def _next(self, change: SensorsLost) -> _Span:
        span = self._span
        waited_s = self._laws[0].ticks_to_first * self._tick_s if span.awaits_fix else 0.0
        had_fix = not span.lost & GPS_LOST and change.t_s - span.begun_s >= waited_s
        fixed_s = change.t_s if had_fix else span.fixed_s
        awaits_fix = not had_fix and not change.bits & GPS_LOST
        return _Span(change.t_s, change.bits, self._spreads(change.t_s), fixed_s, awaits_fix)

    def _spreads(self, t_s: float) -> tuple[Array, Array]:
        (across, down), (first, second) = self._laws, self._span.spreads
        return self._moved(across, first, t_s), self._moved(down, second, t_s)

    def _moved(self, law: Law, spread: Array, t_s: float) -> Array:
        span = self._span
        ticks = round((t_s - span.begun_s) / self._tick_s)
        phase = law.without if span.lost & BARO_LOST else law.with_barometer
        if span.lost & GPS_LOST:
            return phase.coasting.spread(spread, ticks)
        if not span.awaits_fix:
            return phase.cycle.spread(spread, ticks // law.ticks_per_fix)
        since_first = ticks - law.ticks_to_first
        spread = phase.coasting.spread(spread, min(ticks, law.ticks_to_first))
        if since_first < 0:
            return spread
        without_s = span.begun_s - span.fixed_s + law.ticks_to_first * self._tick_s
        spread = phase.reset.spread(spread) if without_s > RESET_AFTER_S else phase.cycle.spread(spread, 1)
        return phase.cycle.spread(spread, since_first // law.ticks_per_fix)
