"""A plan and a flight as Rerun entities; the replay and the live view show the same ones.

Positions are ENU metres. Rerun's 2-D views have y downwards, so entities under `/motion` and `/planning` hold (x, -y)
and (phi, -psi). The timeline `time` is the vehicle's boot time. Rerun is imported inside functions only: it costs a
second.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.scene import (
    bay_lines,
    dividing_streamlines,
    grid_lines,
    lift,
    obstacle_heights,
    prism,
    region_lines,
    unbroken,
)

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

APPLICATION = "sandwich-sitl"
TIMELINE = "time"
GRID_LINES = 40  # at most this many lines of each family
DARK, RED, GREY = (225, 225, 225), (120, 50, 50), (120, 125, 135)
BLUE, ORANGE, GREEN, YELLOW, VIOLET = (60, 140, 245), (240, 140, 30), (60, 190, 110), (245, 200, 0), (200, 110, 240)
CRIMSON = (235, 70, 80)
DOWN = np.array([1.0, -1.0])
_ONE_ALTITUDE = np.empty((0, 2))


class EntityLog:
    """Writes entities to one Rerun recording; a wrong value raises instead of being dropped."""

    def __init__(self, recording: Any) -> None:
        self.recording = recording

    def static(self, entity: str, *archetypes: Any) -> None:
        """Log what holds for all time."""
        self.recording.log(entity, *archetypes, static=True, strict=True)

    def columns(self, entity: str, t_s: Array, columns: Any) -> None:
        """Log one row a time (K,), all at once."""
        import rerun as rr

        if t_s.size:
            indexes = [rr.TimeColumn(TIMELINE, duration=np.rint(t_s * 1e9).astype("timedelta64[ns]"))]
            rr.send_columns(entity, indexes, columns, recording=self.recording, strict=True)

    def vehicle(self, t_s: Array, r_m: Array, q_wxyz: Array) -> None:
        """Pose of the vehicle over time in the scene and in the motion space: (K, 3), (K, 4)."""
        import rerun as rr

        pose = rr.Transform3D.columns(translation=r_m, quaternion=q_wxyz[:, [1, 2, 3, 0]])
        self.columns("/world/vehicle", t_s, pose)
        self.columns("/motion/vehicle", t_s, rr.Points2D.columns(positions=r_m[:, :2] * DOWN))

    def vehicle_in_planning_space(self, t_s: Array, phi_psi: Array) -> None:
        """(phi, psi) of the vehicle over time (K, 2)."""
        import rerun as rr

        self.columns("/planning/vehicle", t_s, rr.Points2D.columns(positions=phi_psi * DOWN))

    def horizon(self, t_s: Array, strips_m: Sequence[Array]) -> None:
        """The MPC's plan ahead, one strip (N, 3) a time."""
        import rerun as rr

        flat = [strip[:, :2] * DOWN for strip in strips_m]
        self.columns("/world/horizon", t_s, rr.LineStrips3D.columns(strips=list(strips_m)))
        self.columns("/motion/horizon", t_s, rr.LineStrips2D.columns(strips=flat))

    def region(self, t_s: Array, rings_m: Sequence[Array], altitude_m: float, z_m: Array = _ONE_ALTITUDE) -> None:
        """The convex region in force, one ring (F, 2) a time; a prism where regions have altitudes, `z_m` (K, 2)."""
        import rerun as rr

        edges = [region_lines(ring, altitude_m, z_m[number : number + 1]) for number, ring in enumerate(rings_m)]
        strips = rr.LineStrips3D.columns(strips=[line for lines in edges for line in lines])
        self.columns("/world/region", t_s, strips.partition([len(lines) for lines in edges]))
        rings = [close_ring(ring) * DOWN for ring in rings_m]
        self.columns("/motion/region", t_s, rr.LineStrips2D.columns(strips=rings))

    def obstacle(self, t_s: float, name: str, ring: Array, height_m: float) -> None:
        """An obstacle that is there from a time on."""
        import rerun as rr

        self.at(t_s)
        part = rr.escape_entity_path_part(name)
        points, triangles = prism(ring, height_m)
        mesh = rr.Mesh3D(vertex_positions=points, triangle_indices=triangles, albedo_factor=CRIMSON)
        self.recording.log(f"/world/appeared/{part}", mesh, strict=True)
        self._outline(f"appeared/{part}", ring, CRIMSON, 2.5)

    def sighting(self, t_s: float, name: str, ring: Array) -> None:
        """The outline that a range sensor's returns were given."""
        import rerun as rr

        self.at(t_s)
        self._outline(f"seen/{rr.escape_entity_path_part(name)}", ring, YELLOW, 1.0)

    def new_route(self, t_s: float, number: int, xyz_m: Array) -> None:
        """The reference of a plan that was adopted at a time."""
        import rerun as rr

        self.at(t_s)
        style = {"colors": [CRIMSON], "radii": [rr.Radius.ui_points(1.5)]}
        self.recording.log(f"/world/route/new-{number}", rr.LineStrips3D([xyz_m], **style), strict=True)
        self.recording.log(f"/motion/route/new-{number}", rr.LineStrips2D([xyz_m[:, :2] * DOWN], **style), strict=True)

    def at(self, t_s: float) -> None:
        """What is logged next holds from this time on."""
        self.recording.set_time(TIMELINE, duration=np.timedelta64(round(t_s * 1e9), "ns"))

    def _outline(self, name: str, ring: Array, colour: Colour, width: float) -> None:
        import rerun as rr

        style = {"colors": [colour], "radii": [rr.Radius.ui_points(width)]}
        closed = close_ring(ring)
        self.recording.log(f"/motion/{name}", rr.LineStrips2D([closed * DOWN], **style), strict=True)
        self.recording.log(f"/world/{name}/outline", rr.LineStrips3D([lift(closed, 0.06)], **style), strict=True)

    def scalars(self, entity: str, t_s: Array, values: Array) -> None:
        """A time series (K,)."""
        import rerun as rr

        self.columns(entity, t_s, rr.Scalars.columns(scalars=values))

    def states(self, entity: str, t_s: Array, states: Sequence[str]) -> None:
        """A state that holds from its time on."""
        import rerun as rr

        self.columns(entity, t_s, rr.StateChange.columns(state=list(states)))

    def lines_of_text(self, t_s: Array, texts: Sequence[str], levels: Sequence[str]) -> None:
        """Log lines with levels as `LogLine` names them."""
        import rerun as rr

        names = {"warning": "WARN", "fatal": "CRITICAL"}
        shown = [names.get(level, level.upper()) for level in levels]
        self.columns("/log", t_s, rr.TextLog.columns(text=list(texts), level=shown))


def log_styles(log: EntityLog, vehicle_radius_m: float) -> None:
    """Colours and sizes of everything that moves."""
    import rerun as rr

    size = [vehicle_radius_m, vehicle_radius_m, 0.3 * vehicle_radius_m]
    log.static("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log.static("/world/vehicle", rr.Boxes3D(half_sizes=[size], colors=[BLUE], fill_mode="solid"))
    log.static("/world/vehicle/nose", rr.Arrows3D(vectors=[[3 * vehicle_radius_m, 0, 0]], colors=[ORANGE]))
    for entity in ("/motion/vehicle", "/planning/vehicle"):
        log.static(entity, rr.Points2D.from_fields(colors=[BLUE], radii=[rr.Radius.ui_points(6.0)], draw_order=30.0))
    for entity, colour in (("horizon", ORANGE), ("region", GREEN)):
        style = {"colors": [colour], "radii": [rr.Radius.ui_points(1.5)]}
        log.static(f"/world/{entity}", rr.LineStrips3D.from_fields(**style))
        log.static(f"/motion/{entity}", rr.LineStrips2D.from_fields(**style, draw_order=20.0))


def log_plan(log: EntityLog, plan: FlightPlan) -> None:
    """Obstacles, map, routes and reference in the scene, the motion space and the planning space."""
    import rerun as rr

    for name, ring, height_m in zip(plan.obstacle_names, plan.obstacles_m, obstacle_heights(plan), strict=True):
        points, triangles = prism(ring, height_m)
        mesh = rr.Mesh3D(vertex_positions=points, triangle_indices=triangles, albedo_factor=GREY)
        log.static(f"/world/obstacles/{rr.escape_entity_path_part(name)}", mesh)
    _lines(log, "obstacles", plan.obstacles_m, GREY, 2.0, z_m=None, closed=True)
    _lines(log, "grown", plan.grown_m, ORANGE, 0.7, z_m=0.05, closed=True)
    _lines(log, "map/grid", grid_lines(plan.channel_map, GRID_LINES), RED, 0.3, z_m=0.02)
    _lines(log, "map/bays", bay_lines(plan.channel_map), RED, 0.3, z_m=0.02)
    _lines(log, "map/dividing_streamlines", dividing_streamlines(plan.channel_map), DARK, 1.2, z_m=0.04)
    for name, xy, colour in (
        ("grid_astar", plan.grid_astar_m, ORANGE),
        ("exact", plan.exact_m, GREEN),
        ("tight", plan.tight_m, VIOLET),
        ("sandwich", plan.sandwich_m, BLUE),
    ):
        _lines(log, f"route/{name}", [xy], colour, 1.5, z_m=plan.map_altitude_m)
    if plan.floors is not None:
        style = {"colors": [VIOLET], "radii": [rr.Radius.ui_points(1.5)]}
        log.static("/world/route/reference", rr.LineStrips3D([plan.path_m], **style))
    _log_planning_space(log, plan)


def log_flown_path(log: EntityLog, r_m: Array, phi_psi: Array | None) -> None:
    """The whole flown path (K, 3), and the same in planning space."""
    import rerun as rr

    style = {"colors": [VIOLET], "radii": [rr.Radius.ui_points(1.5)]}
    log.static("/world/flown", rr.LineStrips3D([r_m], **style))
    log.static("/motion/flown", rr.LineStrips2D([r_m[:, :2] * DOWN], **style, draw_order=15.0))
    if phi_psi is not None:
        log.static("/planning/flown", rr.LineStrips2D([phi_psi * DOWN], **style, draw_order=15.0))


def _log_planning_space(log: EntityLog, plan: FlightPlan) -> None:
    import rerun as rr

    channel_map = plan.channel_map
    phi, Psi = channel_map.phi, channel_map.Psi
    step = max(1, -(-len(phi) // GRID_LINES))
    rows = np.concatenate([np.empty(0), *(channel_map.psi_rows(d) for d in range(channel_map.channels))])
    grid = [np.array([[phi[0], psi], [phi[-1], psi]]) for psi in rows]
    grid += [np.array([[x, Psi[0]], [x, Psi[-1]]]) for x in phi[::step]]
    divides = [np.array([[phi[0], psi], [phi[-1], psi]]) for psi in Psi]
    for name, strips, colour, width in (
        ("grid", grid, RED, 0.3),
        ("dividing_streamlines", divides, DARK, 1.2),
        ("route", unbroken([plan.sandwich_phi_psi]), BLUE, 1.5),
    ):
        radii = [rr.Radius.ui_points(width)]
        log.static(f"/planning/{name}", rr.LineStrips2D([s * DOWN for s in strips], colors=[colour], radii=radii))
    line, column = np.nonzero(channel_map.barred)
    barred = np.column_stack([phi[column], Psi[1:-1][line]]) * DOWN
    log.static("/planning/barred", rr.Points2D(barred, colors=[YELLOW], radii=[rr.Radius.ui_points(2.5)]))


def _lines(
    log: EntityLog,
    name: str,
    lines: Sequence[Array],
    colour: Colour,
    width: float,
    *,
    z_m: float | None,
    closed: bool = False,
) -> None:
    """Lines in the motion space and, unless `z_m` is None, at that height in the scene."""
    import rerun as rr

    strips = [close_ring(line) for line in lines] if closed else list(lines)
    style = {"colors": [colour], "radii": [rr.Radius.ui_points(width)]}
    log.static(f"/motion/{name}", rr.LineStrips2D([strip * DOWN for strip in strips], **style))
    if z_m is not None:
        log.static(f"/world/{name}", rr.LineStrips3D([lift(strip, z_m) for strip in strips], **style))


def close_ring(ring: Array) -> Array:
    """The ring with its first point repeated at the end."""
    return np.vstack([ring, ring[:1]])
