"""A new plan in flight, when an obstacle has appeared (pure).

    OBSTACLE_DISTANCE (link) -> `sightings` \\
                                              new obstacles -> `mission.rerouting` -> `Question` -> `replan` -> `Replan`
    Zenoh (JSON) -> `mission.reports`       /                                                                   |
                                                              `Pilot.adopt` <- `mission.rerouting` <------------+

Input: what is known of the ground (`Known`: the map and every obstacle, the new ones put into both by `learnt`), the
reference in force, and its time `from_s` at which the new plan takes over. Output: one reference with its corridor on
the same time base: up to `from_s` the samples of the old one, then the new. So whoever flies it changes over by
exchanging the two, at any time before `from_s`, and nothing steps.

In this order, the first that is proven by `prove_corridor` counts:

 1. a route to the goal, left for while moving, or after a stop on the old reference (`handover`);
 2. a stop on the old reference, inside regions that keep clear of the new obstacles too;
 3. nothing: the vehicle brakes at once, along the plan it is on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.update import update_map
from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import InputError, MapError, NoRouteError
from sandwich_sitl.planning.corridor import proven_corridor
from sandwich_sitl.planning.flight_plan import Corridor, FlightPlan, Reference
from sandwich_sitl.planning.handover import handover, state_at, stop_limits, stop_reference
from sandwich_sitl.planning.map_graph import MapGraph, build_map_graph, links
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import Ground, ground_of
from sandwich_sitl.planning.routes import RouteKind, find_route, shortened
from sandwich_sitl.world.grow import mitred
from sandwich_sitl.world.world import Obstacle

Array = NDArray[np.float64]

_NO_ROUTE = np.empty((0, 2))


class Verdict(StrEnum):
    """What a `Replan` brings."""

    ROUTE = "route"  # a way on to the goal
    STOP = "stop"  # rest on the way that was planned before
    NONE = "none"  # nothing that is proven


@dataclass(frozen=True)
class Known:
    """The map, and the obstacles as they were given, not grown."""

    channel_map: ChannelMap
    obstacles: tuple[Obstacle, ...]

    @classmethod
    def of(cls, plan: FlightPlan) -> "Known":
        """What was known before take-off."""
        heights = [None if np.isnan(height) else float(height) for height in plan.obstacle_heights_m]
        shapes = zip(plan.obstacle_names, plan.obstacles_m, heights, strict=True)
        return cls(plan.channel_map, tuple(Obstacle(name, shapely.Polygon(ring), z) for name, ring, z in shapes))


@dataclass(frozen=True)
class Question:
    """`obstacles` that are new, the plan in force, and its time from which a new one is wanted."""

    obstacles: tuple[Obstacle, ...]
    reference: Reference
    corridor: Corridor
    from_s: float


@dataclass(frozen=True)
class Replan:
    """The answer: `reference` and `corridor` as a whole (those of the question when the verdict is NONE).

    `route_m` (N, 2) leads from the change-over to the goal, N = 0 without a route; `why` says what was in the way.
    """

    verdict: Verdict
    reference: Reference
    corridor: Corridor
    route_m: Array
    why: str = ""


def learnt(config: RunConfig, known: Known, obstacles: Sequence[Obstacle]) -> Known:
    """`known` with more obstacles, grown for planning in the map."""
    reach_m = config.planner.vehicle_radius_m + config.planner.margin_m
    channel_map = known.channel_map
    for obstacle in obstacles:
        for part in shapely.get_parts(mitred(obstacle.polygon, reach_m)):
            channel_map = update_map(channel_map, part, obstacle.name, config.planner.cell_m)
    return Known(channel_map, (*known.obstacles, *obstacles))


def replan(config: RunConfig, known: Known, question: Question) -> Replan:
    """Answer a question on ground that already holds its obstacles. Never raises what a planner may raise.

    Among floors no new way is sought: the map in force is that of one floor, and the old reference climbs and sinks.
    """
    if config.planner.floors_m:
        why = "a way among floors is not planned anew in flight"
        return Replan(Verdict.NONE, question.reference, question.corridor, _NO_ROUTE, why)
    ground = ground_of(config, known.channel_map, [o.polygon for o in known.obstacles])
    try:
        here = state_at(question.reference, question.from_s).r_m[:2]
        route = _route(config, known.channel_map, here)
        reference, corridor = handover(config, ground, question.reference, question.from_s, route)
        _prove(config, known, reference, corridor)
        return Replan(Verdict.ROUTE, *_spliced(question, reference, corridor), route)
    except (InputError, MapError, NoRouteError) as error:
        why = str(error)
    for limits in stop_limits(config):
        stop = stop_reference(question.reference, question.from_s, limits).reference
        try:
            return Replan(Verdict.STOP, *_spliced(question, *_kept(config, known, ground, stop)), _NO_ROUTE, why)
        except MapError:
            continue
    return Replan(Verdict.NONE, question.reference, question.corridor, _NO_ROUTE, why)


def _route(config: RunConfig, channel_map: ChannelMap, here: Array) -> Array:
    """The route (n, 2) from `here` to the goal; it begins on the map's nearest ground where `here` has been left out."""
    map_graph, goal = build_map_graph(channel_map), np.array(config.goal_m, dtype=float)
    if not links(map_graph, goal):
        blocker = channel_map.grown.blocker(config.goal_m)
        raise NoRouteError(f"the goal lies in obstacle '{blocker}', grown by the vehicle's radius and margin")
    entry = here if links(map_graph, here) else _nearest_node(config, map_graph, here)
    route = find_route(channel_map, map_graph, entry, goal)
    kind: RouteKind = "exact" if config.planner.route == "exact" else "tight"
    points = shortened(map_graph, build_nav_mesh(channel_map.grown), route, kind).points_m
    return points if entry is here else np.concatenate([here[None], points])


def _nearest_node(config: RunConfig, map_graph: MapGraph, here: Array) -> Array:
    """A flown curve may be nearer to an obstacle than planning allows, but not by more than the margin."""
    away = np.hypot(*(map_graph.graph.xy_m - here).T)
    if not np.isfinite(away).any() or float(np.nanmin(away)) > config.planner.margin_m + config.planner.cell_m:
        raise NoRouteError("the vehicle is shut in by obstacles")
    return np.asarray(map_graph.graph.xy_m[int(np.nanargmin(away))])


def _kept(config: RunConfig, known: Known, ground: Ground, stop: Reference) -> tuple[Reference, Corridor]:
    found = proven_corridor(stop.t_s, stop.xyz_m, ground.channel_map, ground.outlines, config.mpc.step_s)
    _prove(config, known, *found)
    return found


def _prove(config: RunConfig, known: Known, reference: Reference, corridor: Corridor) -> None:
    rings = [np.asarray(shapely.get_coordinates(shapely.get_exterior_ring(o.polygon))[:-1]) for o in known.obstacles]
    radius_m = config.planner.vehicle_radius_m
    proof = prove_corridor(reference, corridor, rings, radius_m, config.mpc.step_s)
    if not proof.proven:
        raise MapError(f"corridor: {proof.problem}")


def _spliced(question: Question, reference: Reference, corridor: Corridor) -> tuple[Reference, Corridor]:
    """The old plan up to the change-over, then the new; regions of the old one keep their numbers."""
    old, k = question.reference, change_over(question.reference, question.from_s)
    more = len(question.corridor.Gamma)
    whole = Reference(
        np.concatenate([old.t_s[:k], old.t_s[k] + reference.t_s]),
        np.concatenate([old.xyz_m[:k], reference.xyz_m]),
        np.concatenate([old.region[:k], reference.region + more]),
    )
    joined = replace(
        corridor,
        Lambda=np.concatenate([question.corridor.Lambda, corridor.Lambda]),
        Gamma=np.concatenate([question.corridor.Gamma, corridor.Gamma]),
        polygons_m=(*question.corridor.polygons_m, *corridor.polygons_m),
        neighbours_m=np.concatenate([question.corridor.neighbours_m, corridor.neighbours_m]),
    )
    return whole, joined


def change_over(reference: Reference, from_s: float) -> int:
    """The first sample at or after `from_s`."""
    return min(int(np.searchsorted(reference.t_s, from_s - 1e-9)), len(reference.t_s) - 1)
