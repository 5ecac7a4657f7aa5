"""The plan as one picture: motion space on the left, planning space on the right (paper, Figs. of section IV).

Input: a `FlightPlan`, ENU metres; the planning space has phi across and psi upwards, both in the map's own units. The
figure is drawn with matplotlib's objects on an Agg canvas, so that no global state is touched.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.scene import bay_lines, dividing_streamlines
from sandwich_sitl.recording.summary import route_lengths
from sandwich_sitl.viewing.floor_picture import draw_low_obstacles, draw_profile

Array = NDArray[np.float64]

PHI_LINES = 80  # at most this many lines phi = const are drawn
PSI_LINES = 90  # and lines psi = const
_NAMED = 8  # with more channels their names would overlap: numbers
_PROFILE_HEIGHT = 2.6
DPI = 160
_OBSTACLE = "#8b8f98"
_GROWN = "#c4c7cd"
_STREAMLINE = "#1a1a1a"
_PHI_LINE = "#d62f2f"
_BARRED = "#f4c400"
_BAY = "#3a7d44"
_SANDWICH = "#0b6fd6"
_GRID_ASTAR = "#e07b00"
_TIGHT = "#8e44ad"
_EXACT = "#1d9a52"


def draw_plan(plan: FlightPlan, path: Path) -> None:
    """Write the picture as PNG. Raises `InputError` when `path` cannot be written."""
    x_min, y_min, x_max, y_max = plan.bounds_m
    panel_height = np.clip(7.0 * (y_max - y_min) / (x_max - x_min), 2.5, 8.0)
    profile_height = 0.0 if plan.floors is None else _PROFILE_HEIGHT
    figure = Figure(figsize=(15.0, panel_height + profile_height + 1.9), layout="constrained")
    FigureCanvasAgg(figure)
    if plan.floors is None:
        motion, planning = figure.subplots(1, 2)
    else:
        grid = figure.add_gridspec(2, 2, height_ratios=(panel_height, profile_height))
        motion, planning = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
        draw_profile(figure.add_subplot(grid[1, :]), plan)
    _draw_motion_space(motion, plan)
    _draw_planning_space(planning, plan)
    quality = plan.channel_map.quality
    figure.suptitle(
        f"{plan.name}: {plan.channel_map.channels} channels, {plan.channel_map.nodes} nodes, "
        f"{quality.folded_cells} folded cells, smallest Jacobian ratio {quality.min_jacobian_ratio:.2f}",
        fontsize=11,
    )
    handles, labels = motion.get_legend_handles_labels()
    barred = planning.get_legend_handles_labels()
    figure.legend(
        handles + barred[0], labels + barred[1], loc="outside lower center", ncols=5, fontsize=8.5, frameon=False
    )
    try:
        figure.savefig(path, dpi=DPI, format="png")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); give a directory that can be written"
        ) from error


def _draw_motion_space(axes: Axes, plan: FlightPlan) -> None:
    for ring in plan.grown_m:
        axes.add_patch(Polygon(ring, facecolor=_GROWN, edgecolor="#6f737b", linewidth=0.6, linestyle="--", zorder=1))
    axes.add_collection(PatchCollection([Polygon(r) for r in plan.obstacles_m], facecolor=_OBSTACLE, zorder=2.5))
    if plan.floors is not None:
        draw_low_obstacles(axes, plan)
    _draw_grid(axes, plan.channel_map)
    _draw_routes(axes, plan)
    x_min, y_min, x_max, y_max = plan.bounds_m
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max), aspect="equal", xlabel="x east [m]", ylabel="y north [m]")
    axes.set_title("Motion space", fontsize=10)


def _draw_grid(axes: Axes, channel_map: ChannelMap) -> None:
    step = max(1, -(-len(channel_map.phi) // PHI_LINES))
    rows = [xy[:, j] for xy in channel_map.xy_m for j in range(1, xy.shape[1] - 1)]
    rows = rows[:: max(1, -(-len(rows) // PSI_LINES))]
    columns = [xy[i] for xy in channel_map.xy_m for i in range(0, len(channel_map.phi), step)]
    divides = dividing_streamlines(channel_map)
    axes.add_collection(
        LineCollection(columns, colors=_PHI_LINE, linewidths=0.25, alpha=0.7, zorder=2, label="φ const")
    )
    axes.add_collection(
        LineCollection(rows, colors=_STREAMLINE, linewidths=0.35, zorder=2, label="ψ const (streamlines)")
    )
    axes.add_collection(
        LineCollection(bay_lines(channel_map), colors=_BAY, linewidths=0.25, alpha=0.8, zorder=2, label="bays")
    )
    axes.add_collection(
        LineCollection(divides, colors=_STREAMLINE, linewidths=1.3, zorder=3, label="dividing streamlines")
    )


def _draw_routes(axes: Axes, plan: FlightPlan) -> None:
    lengths = route_lengths(plan)
    reduction = lengths["reduction_percent"]
    shorter = "" if reduction is None else f" ({-reduction:+.1f} % to grid A*)"
    routes = (
        (plan.grid_astar_m, _GRID_ASTAR, "-", 1.6, f"grid A*  {lengths['grid_astar_m']:.2f} m"),
        (plan.sandwich_m, _SANDWICH, "-", 2.4, f"Sandwich  {path_length(plan.sandwich_m):.2f} m{shorter}"),
        (plan.tight_m, _TIGHT, "-", 2.0, f"tight  {path_length(plan.tight_m):.2f} m"),
        (plan.exact_m, _EXACT, (0, (4, 2)), 1.6, f"exact shortest  {lengths['exact_m']:.2f} m"),
    )
    for xy, colour, style, width, label in routes:
        if not len(xy):
            continue
        axes.plot(*xy.T, color=colour, linestyle=style, linewidth=width, label=label, zorder=4, solid_joinstyle="round")
    for point, marker, label in ((plan.start_m, "o", "start"), (plan.goal_m, "*", "goal")):
        size = 8 if marker == "o" else 14
        axes.plot(*point, marker, color="white", markeredgecolor="black", markersize=size, label=label, zorder=5)


def _draw_planning_space(axes: Axes, plan: FlightPlan) -> None:
    channel_map = plan.channel_map
    phi, Psi = channel_map.phi, channel_map.Psi
    step = max(1, -(-len(phi) // PHI_LINES))
    rows = np.concatenate([np.empty(0), *(channel_map.psi_rows(d) for d in range(channel_map.channels))])
    ends = np.array([phi[0], phi[-1]])
    rows = rows[:: max(1, -(-len(rows) // PSI_LINES))]
    axes.add_collection(LineCollection(_across(ends, rows), colors=_STREAMLINE, linewidths=0.35, zorder=1))
    axes.add_collection(
        LineCollection(_upwards(phi[::step], Psi), colors=_PHI_LINE, linewidths=0.25, alpha=0.7, zorder=1)
    )
    axes.add_collection(LineCollection(_across(ends, Psi), colors=_STREAMLINE, linewidths=1.3, zorder=2))
    line, column = np.nonzero(channel_map.barred)
    if line.size:
        axes.plot(
            phi[column], Psi[1:-1][line], "s", color=_BARRED, markeredgecolor="#8a6d00", markeredgewidth=0.3,
            markersize=4, zorder=3, label="barred nodes",
        )  # fmt: skip
    axes.plot(*plan.sandwich_phi_psi.T, color=_SANDWICH, linewidth=2.4, zorder=4)
    for point, marker in ((plan.sandwich_phi_psi[0], "o"), (plan.sandwich_phi_psi[-1], "*")):
        axes.plot(
            *point, marker, color="white", markeredgecolor="black", markersize=8 if marker == "o" else 14, zorder=5
        )
    named = channel_map.channels <= _NAMED
    for d in range(channel_map.channels):
        axes.annotate(
            f"channel {d + 1}" if named else f"{d + 1}", (1.005, (Psi[d] + Psi[d + 1]) / 2),
            xycoords=("axes fraction", "data"), rotation=90 if named else 0, va="center", fontsize=7,
        )  # fmt: skip
    axes.set(xlim=(phi[0], phi[-1]), ylim=(Psi[0], Psi[-1]), xlabel="φ", ylabel="ψ")
    axes.set_box_aspect(float((Psi[-1] - Psi[0]) / (phi[-1] - phi[0])))
    axes.set_title("Planning space", fontsize=10)


def _across(ends: Array, levels: Array) -> list[Array]:
    return [np.column_stack([ends, [level, level]]) for level in levels]


def _upwards(positions: Array, levels: Array) -> list[Array]:
    return [np.column_stack([[position, position], levels[[0, -1]]]) for position in positions]
