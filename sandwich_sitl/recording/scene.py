"""The plan as `foxglove.SceneUpdate` messages: `/scene` (obstacles) and `/plan/map` (streamlines, grid, regions).

State: none. Input: a `FlightPlan`, ENU metres. Obstacles are prisms from the ground to their height; where the height
is unknown they rise to `UNKNOWN_HEIGHT_FACTOR` times the flight altitude. Map lines lie at the flight altitude, with
floors at that of the floor the map belongs to; regions that have altitudes are drawn at both, with their edges.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.messages import MAP_FRAME, set_timestamp

Array = NDArray[np.float64]
Rgba = tuple[float, float, float, float]

UNKNOWN_HEIGHT_FACTOR = 1.5
GRID_LINES = 60  # at most this many lines of each family
_OBSTACLE: Rgba = (0.45, 0.47, 0.52, 1.0)
_GROWN: Rgba = (0.85, 0.45, 0.1, 1.0)
_STREAMLINE: Rgba = (0.05, 0.05, 0.05, 1.0)
_GRID: Rgba = (0.6, 0.6, 0.65, 0.6)
_REGION: Rgba = (0.1, 0.55, 0.3, 0.8)


def scene_update(plan: FlightPlan, t_ns: int) -> bytes:
    """`/scene`: obstacles as prisms, with the outlines they were grown to."""
    update = SceneUpdate()
    for name, ring, height_m in zip(plan.obstacle_names, plan.obstacles_m, obstacle_heights(plan), strict=True):
        entity = _entity(update, f"obstacle/{name}", t_ns)
        points, triangles = prism(ring, height_m)
        mesh = entity.triangles.add(points=[], indices=triangles.ravel().tolist())
        _identity(mesh)
        _colour(mesh, _OBSTACLE)
        for x, y, z in points.tolist():
            mesh.points.add(x=x, y=y, z=z)
    if plan.grown_m:
        entity = _entity(update, "grown", t_ns)
        for ring in plan.grown_m:
            _line(entity, lift(ring, 0.05), _GROWN, closed=True)
    return update.SerializeToString()


def map_update(plan: FlightPlan, t_ns: int) -> bytes:
    """`/plan/map`: dividing streamlines, some grid lines and the corridor's regions at the flight altitude."""
    update = SceneUpdate()
    groups = (
        ("dividing_streamlines", dividing_streamlines(plan.channel_map), _STREAMLINE, False),
        ("grid", grid_lines(plan.channel_map, GRID_LINES) + bay_lines(plan.channel_map), _GRID, False),
    )
    for name, lines, colour, closed in groups:
        entity = _entity(update, name, t_ns)
        for line in lines:
            _line(entity, lift(line, plan.map_altitude_m), colour, closed=closed)
    entity = _entity(update, "regions", t_ns)
    for number, ring in enumerate(plan.corridor.polygons_m):
        for line in region_lines(ring, plan.altitude_m, plan.corridor.z_m[number : number + 1]):
            _line(entity, line, _REGION, closed=False)
    return update.SerializeToString()


def region_lines(ring: Array, altitude_m: float, z_m: Array) -> list[Array]:
    """Closed outline (F + 1, 3) of a region at an altitude, or the edges of the prism when it has altitudes (1, 2)."""
    closed = np.vstack([ring, ring[:1]])
    if not len(z_m):
        return [lift(closed, altitude_m)]
    low, high = (lift(closed, z) for z in z_m[0].tolist())
    return [low, high, *np.stack([low[:-1], high[:-1]], axis=1)]


def lift(xy_m: Array, z_m: float) -> Array:
    """Points (N, 2) at one height: (N, 3)."""
    return np.column_stack([xy_m, np.full(len(xy_m), z_m)])


def obstacle_heights(plan: FlightPlan) -> list[float]:
    """Height of each obstacle in metres, with a stand-in where it is unknown."""
    unknown_m = UNKNOWN_HEIGHT_FACTOR * plan.map_altitude_m
    heights_m: list[float] = np.where(np.isfinite(plan.obstacle_heights_m), plan.obstacle_heights_m, unknown_m).tolist()
    return heights_m


def prism(ring: Array, height_m: float) -> tuple[Array, NDArray[np.int64]]:
    """Closed prism over a ring (V, 2): vertices (2 V, 3), bottom then top, and outward triangles (T, 3)."""
    count = len(ring)
    points = np.vstack([np.column_stack([ring, np.zeros(count)]), np.column_stack([ring, np.full(count, height_m)])])
    here = np.arange(count)
    after = np.roll(here, -1)
    walls = np.vstack(
        [np.column_stack([here, after, after + count]), np.column_stack([here, after + count, here + count])]
    )
    cap = _triangulate(ring)
    return points, np.vstack([walls, cap + count, cap[:, ::-1]]).astype(np.int64)


def dividing_streamlines(channel_map: ChannelMap) -> list[Array]:
    """Bottom and top row of each channel (m_phi, 2): both sides of every dividing streamline, and the two borders."""
    return unbroken([xy[:, j] for xy in channel_map.xy_m for j in (0, -1)])


def grid_lines(channel_map: ChannelMap, most: int) -> list[Array]:
    """Inner rows (psi constant) and columns (phi constant, one a channel), thinned to `most` of each family."""
    rows = [xy[:, j] for xy in channel_map.xy_m for j in range(1, xy.shape[1] - 1)]
    step = max(1, -(-len(channel_map.phi) // most))
    columns = [xy[i] for xy in channel_map.xy_m for i in range(0, len(channel_map.phi), step)]
    return unbroken(rows[:: max(1, -(-len(rows) // most))] + columns)


def bay_lines(channel_map: ChannelMap) -> list[Array]:
    """Sides (2, 2) of the quads of every bay."""
    lines: list[Array] = []
    for bay in channel_map.bays:
        sides = np.sort(np.stack([bay.quads, np.roll(bay.quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        lines += list(bay.xy_m[np.unique(sides, axis=0)])
    return lines


def unbroken(lines: list[Array]) -> list[Array]:
    """Lines (n, 2) cut where a node is missing (nan)."""
    whole: list[Array] = []
    for line in lines:
        there = ~np.isnan(line[:, 0])
        parts = np.split(line, np.flatnonzero(np.diff(there)) + 1)
        whole += [part for part in parts if len(part) > 1 and not np.isnan(part[0, 0])]
    return whole


def _triangulate(ring: Array) -> NDArray[np.int64]:
    """Counter-clockwise triangles (T, 3) of a simple ring, as indices into it."""
    lookup = {point: index for index, point in enumerate(map(tuple, ring.tolist()))}
    triangles = [
        [lookup[point] for point in corners]
        for corners in _corners(shapely.constrained_delaunay_triangles(shapely.Polygon(ring)))
    ]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _corners(triangles: shapely.GeometryCollection) -> Iterator[list[tuple[float, ...]]]:
    for triangle in triangles.geoms:
        yield list(shapely.geometry.polygon.orient(triangle).exterior.coords)[:3]  # type: ignore[arg-type]


def _entity(update: SceneUpdate, name: str, t_ns: int) -> SceneEntity:
    entity = update.entities.add(frame_id=MAP_FRAME, id=name, frame_locked=False)
    set_timestamp(entity, t_ns)
    entity.lifetime.SetInParent()
    return entity


def _line(entity: SceneEntity, xyz: Array, colour: Rgba, *, closed: bool) -> None:
    kind = LinePrimitive.LINE_LOOP if closed else LinePrimitive.LINE_STRIP
    line = entity.lines.add(type=kind, thickness=1.5, scale_invariant=True)
    _identity(line)
    _colour(line, colour)
    for x, y, z in xyz.tolist():
        line.points.add(x=x, y=y, z=z)


def _identity(primitive: object) -> None:
    pose = primitive.pose  # type: ignore[attr-defined]
    pose.position.SetInParent()
    pose.orientation.w = 1.0


def _colour(primitive: object, rgba: Rgba) -> None:
    colour = primitive.color  # type: ignore[attr-defined]
    colour.r, colour.g, colour.b, colour.a = rgba
