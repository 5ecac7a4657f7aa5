"""`FlightPlan`: everything a run has decided before take-off, as plain arrays. The log carries it, viewers draw it.

All positions are ENU metres in the world's frame; z is up from the ground at the start.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap

Array = NDArray[np.float64]

_PATH_STEP_M = 0.5
_HAIR_M = 1e-9


@dataclass(frozen=True)
class Reference:
    """Desired motion along the route, sampled once a control period (the paper's p_k, with times).

    `t_s` (K,) starts at 0 with the vehicle at rest over the start; `xyz_m` (K, 3); `region` (K,) indexes `Corridor`.
    """

    t_s: Array
    xyz_m: Array
    region: NDArray[np.int64]


@dataclass(frozen=True)
class Corridor:
    """Convex regions Lambda_m [x, y] <= Gamma_m (paper, Eq. (mainsafety)), convex and clear of every grown obstacle.

    `Lambda` (M, F, 2) with unit rows, `Gamma` (M, F) in metres; unused rows repeat the last one. `polygons_m` are the
    same regions as counter-clockwise rings without closing point, `neighbours_m` (M, 4, 2) the paper's raw quadrangles.
    `z_m` (M, 2) are the lowest and highest altitude of each region; it has no rows where there is one floor, at whose
    altitude alone the regions are meant, and which every obstacle reaches.
    """

    Lambda: Array
    Gamma: Array
    polygons_m: tuple[Array, ...]
    neighbours_m: Array
    z_m: Array = field(default_factory=lambda: np.empty((0, 2)))


@dataclass(frozen=True)
class CorridorProof:
    """What `prove_corridor` found; lengths in metres.

    `least_margin_m`: of a reference point to a side of its region. `least_clearance_m`: of a region to an obstacle grown
    by the vehicle's radius and by what the vehicle may leave it by between samples, at most `between_samples_m`.
    `least_headroom_m`: of a region over an obstacle below it, less the same two; None when it flies over none.
    """

    proven: bool
    problem: str
    steps: int
    least_margin_m: float
    least_clearance_m: float
    between_samples_m: float
    least_headroom_m: float | None = None


@dataclass(frozen=True)
class FlightFigures:
    """The way along the route, without the climb: metres and seconds.

    `least_duration_s` is that of the time-optimal law along the same curve under the limits on speed and acceleration
    alone (and the speed that clearances allow): no law that also limits jerk and snap is faster.
    """

    route_m: float
    curve_m: float
    duration_s: float
    least_duration_s: float


@dataclass(frozen=True)
class FloorFigures:
    """One floor as the planner saw it: lengths over ground in metres, nan without a route, with the reason in `refused`.

    `climb_cost_m` is what climbing to it from the start's floor and descending to the goal's is worth, in metres of
    level flight; the floor with the least  route + climb_cost  is flown.
    """

    altitude_m: float
    obstacles: int
    channels: int
    nodes: int
    grid_astar_m: float
    sandwich_m: float
    route_m: float
    exact_m: float
    climb_cost_m: float
    refused: str = ""


@dataclass(frozen=True)
class FloorPlan:
    """The floors a route may rise to, from the lowest up, the one whose route is flown, and the way in space.

    The way begins when take-off has reached the start's floor and ends on the goal's. `changes` counts steps from a
    floor to the next.
    """

    figures: tuple[FloorFigures, ...]
    flown: int
    length_m: float
    climbed_m: float
    descended_m: float
    changes: int


@dataclass(frozen=True)
class FlightPlan:
    """World, map, routes, reference and corridor of one run."""

    name: str
    bounds_m: tuple[float, float, float, float]
    start_m: tuple[float, float]
    goal_m: tuple[float, float]
    altitude_m: float
    vehicle_radius_m: float
    obstacle_names: tuple[str, ...]
    obstacles_m: tuple[Array, ...]  # rings (V, 2), not grown, counter-clockwise, no closing point
    obstacle_heights_m: Array  # (n,), nan where unknown
    grown_m: tuple[Array, ...]  # rings of the obstacles grown for planning
    channel_map: ChannelMap
    sandwich_m: Array  # (N, 2) A* on the mapped grid
    sandwich_phi_psi: Array  # (N, 2) the same nodes in planning space
    grid_astar_m: Array  # (N, 2) A* on the uniform motion-space grid, the paper's baseline
    exact_m: Array  # (N, 2) exact shortest path
    reference: Reference
    corridor: Corridor
    route_kind: str = "sandwich"  # which route is flown: sandwich, tight or exact
    route_proven: bool = False  # no path among the grown obstacles is shorter than the flown route
    tight_m: Array = field(default_factory=lambda: np.empty((0, 2)))  # (N, 2) the flown route when it is not sandwich_m
    proof: CorridorProof | None = None  # None in plans that were made without one
    flight: FlightFigures | None = None  # None in paper mode
    floors: FloorPlan | None = None  # None where there is one floor
    seconds: dict[str, float] = field(default_factory=dict)  # wall time of each stage; never part of a payload

    @property
    def route_m(self) -> Array:
        """The flown route (N, 2)."""
        return self.sandwich_m if self.route_kind == "sandwich" else self.tight_m

    @property
    def path_m(self) -> Array:
        """The flown way (N, 3): the route at its altitude, or with floors the reference from take-off's end on, thinned."""
        if self.floors is None:
            return np.column_stack([self.route_m, np.full(len(self.route_m), self.altitude_m)])
        xyz = self.reference.xyz_m
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xyz, axis=0), axis=1))])
        begin = float(along[np.argmax(xyz[:, 2] >= self.altitude_m - _HAIR_M)])
        at = np.linspace(begin, along[-1], max(2, int((along[-1] - begin) / _PATH_STEP_M) + 1))
        return np.column_stack([np.interp(at, along, column) for column in xyz.T])

    @property
    def map_altitude_m(self) -> float:
        """Altitude of the channel map and its routes."""
        return self.altitude_m if self.floors is None else self.floors.figures[self.floors.flown].altitude_m

    @property
    def blocking_heights_m(self) -> Array:
        """How high (n,) each obstacle is in the way: infinitely, where its height is unknown or there is one floor."""
        known = np.isfinite(self.obstacle_heights_m) & (self.floors is not None)
        return np.where(known, self.obstacle_heights_m, np.inf)
