"""The plan as one picture: motion space on the left, planning space on the right (paper, Figs. of section IV).

Above the routes on the mapped grid; below the corridor's regions and the way that is flown, coloured by its speed: the
reference's, or that of a flown track. Input: a `FlightPlan`, ENU metres; the planning space has phi across and psi
upwards, both in the map's own units. The figure is drawn with matplotlib's objects on an Agg canvas, so that no global
state is touched.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.summary import route_lengths
from sandwich_sitl.viewing.floor_picture import draw_profile
from sandwich_sitl.viewing.plan_panels import draw_barred, draw_ends, draw_motion_grid, draw_planning_grid, draw_world
from sandwich_sitl.viewing.planning_space import PlanningSpace

Array = NDArray[np.float64]

_PROFILE_HEIGHT = 2.6
DPI = 160
_SANDWICH = "#0b6fd6"
_GRID_ASTAR = "#e07b00"
_TIGHT = "#8e44ad"
_EXACT = "#1d9a52"
_REGION = "#0f9aa8"
_SPEEDS = "plasma"
_STEP_M = 0.1  # between the points of a line that are carried into the planning space
_REACH_M = 1.0
_PIECE_M = 0.3  # of a track that has one colour


@dataclass(frozen=True)
class Track:
    """A way flown: times `t_s` (K,), horizontal positions `xy_m` (K, 2), and what to call it."""

    name: str
    t_s: Array
    xy_m: Array


def draw_plan(plan: FlightPlan, path: Path, flown: Track | None = None) -> None:
    """Write the picture as PNG. Raises `InputError` when `path` cannot be written."""
    x_min, y_min, x_max, y_max = plan.bounds_m
    panel_height = float(np.clip(7.0 * (y_max - y_min) / (x_max - x_min), 2.5, 8.0))
    heights = [panel_height, panel_height] + ([] if plan.floors is None else [_PROFILE_HEIGHT])
    figure = Figure(figsize=(15.0, sum(heights) + 2.8), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    panels = [[figure.add_subplot(grid[row, column]) for column in range(2)] for row in range(2)]
    space = PlanningSpace(plan.channel_map)
    _draw_routes(panels[0][0], panels[0][1], plan, space)
    _draw_flight(figure, panels[1][0], panels[1][1], plan, space, flown or _reference(plan))
    if plan.floors is not None:
        draw_profile(figure.add_subplot(grid[2, :]), plan)
    quality = plan.channel_map.quality
    figure.suptitle(
        f"{plan.name}: {plan.channel_map.channels} channels, {plan.channel_map.nodes} nodes, "
        f"{quality.folded_cells} folded cells, smallest Jacobian ratio {quality.min_jacobian_ratio:.2f}",
        fontsize=11,
    )
    try:
        figure.savefig(path, dpi=DPI, format="png")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); give a directory that can be written"
        ) from error


def _reference(plan: FlightPlan) -> Track:
    return Track("reference", plan.reference.t_s, plan.reference.xyz_m[:, :2])


def _draw_routes(motion: Axes, planning: Axes, plan: FlightPlan, space: PlanningSpace) -> None:
    draw_world(motion, plan)
    draw_motion_grid(motion, plan.channel_map)
    draw_planning_grid(planning, plan.channel_map)
    draw_barred(planning, plan.channel_map)
    for xy, colour, style, width, label in _routes(plan):
        if not len(xy):
            continue
        motion.plot(*xy.T, color=colour, linestyle=style, linewidth=width, label=label, zorder=4)
        carried = space.pieces(xy, _STEP_M, _REACH_M)
        planning.add_collection(LineCollection(carried, colors=colour, linestyles=[style], linewidths=width, zorder=4))
    draw_ends(motion, planning, plan, space)
    motion.set_title("Motion space: channels and routes", fontsize=10)
    planning.set_title("Planning space: the same routes", fontsize=10)
    for axes, columns in ((motion, 3), (planning, 1)):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=columns, fontsize=8.5, frameon=False)


def _routes(plan: FlightPlan) -> tuple[tuple[Array, str, str | tuple[int, tuple[int, int]], float, str], ...]:
    """Points, colour, line style, width and label of each."""
    lengths = route_lengths(plan)
    reduction = lengths["reduction_percent"]
    shorter = "" if reduction is None else f" ({-reduction:+.1f} % to existing A*)"
    return (
        (plan.grid_astar_m, _GRID_ASTAR, "-", 1.6, f"existing A*  {lengths['grid_astar_m']:.2f} m"),
        (plan.sandwich_m, _SANDWICH, "-", 2.2, f"Sandwich A*  {lengths['sandwich_m']:.2f} m{shorter}"),
        (plan.tight_m, _TIGHT, "-", 1.8, f"tight  {path_length(plan.tight_m):.2f} m"),
        (plan.exact_m, _EXACT, (0, (4, 3)), 1.6, f"exact  {lengths['exact_m']:.2f} m"),
    )


def _draw_flight(
    figure: Figure, motion: Axes, planning: Axes, plan: FlightPlan, space: PlanningSpace, track: Track
) -> None:
    draw_world(motion, plan)
    draw_planning_grid(planning, plan.channel_map)
    draw_barred(planning, plan.channel_map)
    rings = [np.concatenate([ring, ring[:1]]) for ring in plan.corridor.polygons_m]
    carried = [piece for ring in rings for piece in space.pieces(ring, _STEP_M, _REACH_M)]
    style: dict[str, Any] = {"colors": _REGION, "linewidths": 0.5, "alpha": 0.5, "zorder": 3}
    motion.add_collection(LineCollection(rings, label=f"{len(rings)} regions", **style))
    planning.add_collection(LineCollection(carried, **style))
    lines, speeds = _coloured(track)
    norm = Normalize(0.0, max(float(speeds.max(initial=0.0)), 0.1))
    motion.add_collection(
        LineCollection(lines, array=speeds, cmap=_SPEEDS, norm=norm, linewidths=2.8, zorder=4, label=track.name)
    )
    pieces = [(piece, speed) for line, speed in zip(lines, speeds, strict=True)
              for piece in space.pieces(line, _STEP_M, _REACH_M)]  # fmt: skip
    drawn = LineCollection(
        [piece for piece, _ in pieces], array=np.array([speed for _, speed in pieces]), cmap=_SPEEDS, norm=norm,
        linewidths=2.8, zorder=4,
    )  # fmt: skip
    planning.add_collection(drawn)
    figure.colorbar(drawn, ax=[motion, planning], label=f"speed of the {track.name} [m/s]", shrink=0.8, pad=0.01)
    draw_ends(motion, planning, plan, space)
    motion.set_title(f"Motion space: {len(rings)} regions of the corridor, {track.name} by speed", fontsize=10)
    planning.set_title("Planning space: the same", fontsize=10)


def _coloured(track: Track) -> tuple[list[Array], Array]:
    """Stretches of a track of about `_PIECE_M`, and the speed (n,) over each; where it stands there is none."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track.xy_m, axis=0).T))])
    count = max(1, int(travelled[-1] / _PIECE_M))
    cuts = np.unique(np.searchsorted(travelled, np.linspace(0.0, travelled[-1], count + 1)))
    lines = [track.xy_m[a : b + 1] for a, b in itertools.pairwise(cuts.tolist())]
    return lines, np.diff(travelled[cuts]) / np.maximum(np.diff(track.t_s[cuts]), 1e-9)
