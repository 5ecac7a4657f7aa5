"""Is the vehicle on the ground? PX4's three stages: ground contact, maybe landed, landed.

Input: estimated velocity (NED), the velocity asked for, the thrust asked for (share of hover). Nothing measures the ground: contact
is a vehicle that is told to sink and does not. A horizontal velocity that the estimator calls invalid is not looked at, as in PX4:
without position the estimate goes on moving while the vehicle stands.
"""

from dataclasses import dataclass
from math import hypot

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.rotation import Vector

_CONTACT_S = 0.5
_SINK_ASKED_MPS = 0.25
_LOW_THRUST_OF_HOVER = 0.3
_TAKEOFF_CLIMB_M = 0.15


@dataclass(frozen=True)
class LandedLimits:
    """Speeds below which the vehicle may stand, and how long it must."""

    vertical_mps: float
    horizontal_mps: float
    trigger_s: float

    @classmethod
    def of(cls, parameters: ParameterStore) -> "LandedLimits":
        """Read the table."""
        return cls(parameters["LNDMC_Z_VEL_MAX"], parameters["LNDMC_XY_VEL_MAX"], parameters["LNDMC_TRIG_TIME"])


class LandedDetector:
    """Call `update` at a fixed period."""

    def __init__(self, limits: LandedLimits) -> None:
        self.limits = limits
        self.landed = True
        self.ground_contact = True
        self._contact_s = 0.0
        self._still_s = 0.0
        self._ground_d_m = 0.0

    def update(
        self,
        position: Vector,
        velocity: Vector,
        asked_down_mps: float,
        thrust_of_hover: float,
        dt_s: float,
        across_valid: bool = True,
    ) -> None:
        """`asked_down_mps` NaN counts as not asked; `across_valid`: the horizontal velocity is worth something."""
        if self.landed:
            self._watch_for_takeoff(position, velocity, thrust_of_hover)
            return
        rests = not across_valid or hypot(velocity[0], velocity[1]) < self.limits.horizontal_mps
        still = rests and abs(velocity[2]) < self.limits.vertical_mps
        low = thrust_of_hover < _LOW_THRUST_OF_HOVER
        self._contact_s = self._contact_s + dt_s if still and (low or asked_down_mps > _SINK_ASKED_MPS) else 0.0
        self.ground_contact = self._contact_s > _CONTACT_S
        self._still_s = self._still_s + dt_s if self.ground_contact and low else 0.0
        if self._still_s > self.limits.trigger_s:
            self.landed = True
            self._ground_d_m = position[2]

    def _watch_for_takeoff(self, position: Vector, velocity: Vector, thrust_of_hover: float) -> None:
        if thrust_of_hover < _LOW_THRUST_OF_HOVER:
            self._ground_d_m = position[2]
        elif position[2] < self._ground_d_m - _TAKEOFF_CLIMB_M or velocity[2] < -2.0 * self.limits.vertical_mps:
            self.landed = self.ground_contact = False
            self._contact_s = self._still_s = 0.0
