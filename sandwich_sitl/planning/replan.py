"""A new plan in flight, when an obstacle has appeared (pure).

    OBSTACLE_DISTANCE (link) -> `sightings` \\
                                              new obstacles -> `mission.rerouting` -> `Question` -> `replan` -> `Replan`
    Zenoh (JSON) -> `mission.reports`       /                                                                   |
                                                              `Pilot.adopt` <- `mission.rerouting` <------------+

Input: what is known of the ground (`Known`: the map and every obstacle, the new ones put into both by `learnt`), the
reference in force, and its time `from_s` at which the new plan takes over. Output: one reference with its corridor on
the same time base: up to `from_s` the samples of the old one, then the new. So whoever flies it changes over by
exchanging the two, at any time before `from_s`, and nothing steps.

Time counts: so the first plan need not lead to the goal, only `Question.reach_m` along the route to it, to rest; the
rest of the way is then asked for with more time. What planning costs grows with the length of the way.

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
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import Ground, ground_of
from sandwich_sitl.planning.shortest import shortest_path
from sandwich_sitl.world.grow import GrownWorld, mitred
from sandwich_sitl.world.world import Obstacle

Array = NDArray[np.float64]

_HAIR_M = 1e-6
_NOT_MUCH = 1.3
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
    """`obstacles` that are new, the plan in force, its time from which a new one is wanted, and how far it has to reach."""

    obstacles: tuple[Obstacle, ...]
    reference: Reference
    corridor: Corridor
    from_s: float
    reach_m: float = np.inf


@dataclass(frozen=True)
class Replan:
    """The answer: `reference` and `corridor` as a whole (those of the question when the verdict is NONE).

    `route_m` (N, 2) leads from the change-over to the goal, N = 0 without a route; `whole`: so does the reference, which
    else rests where the question's reach ends. `why` says what was in the way.
    """

    verdict: Verdict
    reference: Reference
    corridor: Corridor
    route_m: Array
    why: str = ""
    whole: bool = True


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
        route = _route(config, known.channel_map.grown, here)
        near = _within(route, question.reach_m)
        reference, corridor = handover(config, ground, question.reference, question.from_s, near)
        _prove(config, known, reference, corridor)
        return Replan(Verdict.ROUTE, *_spliced(question, reference, corridor), route, whole=near is route)
    except (InputError, MapError, NoRouteError) as error:
        why = str(error)
    for limits in stop_limits(config):
        stop = stop_reference(question.reference, question.from_s, limits).reference
        try:
            return Replan(Verdict.STOP, *_spliced(question, *_kept(config, known, ground, stop)), _NO_ROUTE, why)
        except MapError:
            continue
    return Replan(Verdict.NONE, question.reference, question.corridor, _NO_ROUTE, why)


def _route(config: RunConfig, grown: GrownWorld, here: Array) -> Array:
    """The shortest route (n, 2) from `here` to the goal on the free ground of the map, as a navigation mesh.

    That is the optimum itself, and sooner than the map's grid could be searched: at 100,000 nodes it would have to be
    numbered and linked anew. The route begins on the nearest free ground, where a flown curve is nearer to an obstacle
    than planning allows; the curve made from it keeps what clearance there is.
    """
    mesh, goal = build_nav_mesh(grown), np.array(config.goal_m, dtype=float)
    blocker = grown.blocker(config.goal_m)
    if blocker is not None:
        raise NoRouteError(f"the goal lies in obstacle '{blocker}', grown by the vehicle's radius and margin")
    entry = _free_ground(config, grown, here)
    found = shortest_path(mesh, entry, goal)
    if found is None:
        raise NoRouteError("obstacles close every way to the goal")
    return np.concatenate([here[None], found.points_m[np.hypot(*(found.points_m - here).T) > _HAIR_M]])


def _within(route: Array, reach_m: float) -> Array:
    """The beginning of a route, `reach_m` long; the route itself when it is not much longer."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    if arc[-1] <= _NOT_MUCH * reach_m:
        return route
    end = [np.interp(reach_m, arc, route[:, axis]) for axis in range(2)]
    return np.concatenate([route[arc < reach_m], [end]])


def _free_ground(config: RunConfig, grown: GrownWorld, here: Array) -> Array:
    """`here`, or the nearest point outside the grown obstacle that holds it; by less than the margin."""
    point = shapely.Point(here)
    for polygon in grown.polygons:
        if polygon.contains(point):
            if polygon.exterior.distance(point) > config.planner.margin_m:
                break
            foot = shapely.get_coordinates(shapely.shortest_line(point, polygon.exterior))[1]
            away = foot - here
            return np.asarray(foot + _HAIR_M * away / max(float(np.hypot(*away)), _HAIR_M))
    else:
        return here
    raise NoRouteError("the vehicle is shut in by obstacles")


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
