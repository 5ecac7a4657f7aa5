"""Parts of a plan's picture: the world, the mapped grid in both spaces, barred nodes, start and goal."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.scene import bay_lines, dividing_streamlines
from sandwich_sitl.viewing.floor_picture import draw_obstacles
from sandwich_sitl.viewing.planning_space import PlanningSpace

Array = NDArray[np.float64]

PHI_LINES = 80  # at most this many lines phi = const are drawn
PSI_LINES = 90  # and lines psi = const
_NAMED = 8  # with more channels their names would overlap: numbers
_OBSTACLE = "#8b8f98"
_GROWN = "#c4c7cd"
_STREAMLINE = "#1a1a1a"
_PHI_LINE = "#d62f2f"
_BARRED = "#f4c400"
_BAY = "#3a7d44"


def draw_world(axes: Axes, plan: FlightPlan) -> None:
    """Obstacles as given, and grown, within the bounds."""
    for ring in plan.grown_m:
        axes.add_patch(Polygon(ring, facecolor=_GROWN, edgecolor="#6f737b", linewidth=0.6, linestyle="--", zorder=1))
    axes.add_collection(PatchCollection([Polygon(r) for r in plan.obstacles_m], facecolor=_OBSTACLE, zorder=2.5))
    if plan.floors is not None:
        draw_obstacles(axes, plan)
    x_min, y_min, x_max, y_max = plan.bounds_m
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max), aspect="equal", xlabel="x east [m]", ylabel="y north [m]")


def draw_motion_grid(axes: Axes, channel_map: ChannelMap) -> None:
    """Lines of constant phi and psi, the bays' cells and the dividing streamlines."""
    step = max(1, -(-len(channel_map.phi) // PHI_LINES))
    rows = [xy[:, j] for xy in channel_map.xy_m for j in range(1, xy.shape[1] - 1)]
    rows = rows[:: max(1, -(-len(rows) // PSI_LINES))]
    columns = [xy[i] for xy in channel_map.xy_m for i in range(0, len(channel_map.phi), step)]
    families = (
        (columns, _PHI_LINE, 0.25, 2, "φ const"),
        (rows, _STREAMLINE, 0.3, 2, "ψ const (streamlines)"),
        (bay_lines(channel_map), _BAY, 0.25, 2, "bays"),
        (dividing_streamlines(channel_map), _STREAMLINE, 1.3, 3, "dividing streamlines"),
    )
    for lines, colour, width, order, label in families:
        if len(lines):
            axes.add_collection(
                LineCollection(lines, colors=colour, linewidths=width, alpha=0.8, zorder=order, label=label)
            )


def draw_planning_grid(axes: Axes, channel_map: ChannelMap) -> None:
    """The rectangle: lines of constant phi and psi, dividing streamlines, the channels' names."""
    phi, Psi = channel_map.phi, channel_map.Psi
    step = max(1, -(-len(phi) // PHI_LINES))
    rows = np.concatenate([np.empty(0), *(channel_map.psi_rows(d) for d in range(channel_map.channels))])
    ends = np.array([phi[0], phi[-1]])
    rows = rows[:: max(1, -(-len(rows) // PSI_LINES))]
    axes.add_collection(LineCollection(_across(ends, rows), colors=_STREAMLINE, linewidths=0.3, alpha=0.8, zorder=1))
    axes.add_collection(
        LineCollection(_upwards(phi[::step], Psi), colors=_PHI_LINE, linewidths=0.25, alpha=0.7, zorder=1)
    )
    axes.add_collection(LineCollection(_across(ends, Psi), colors=_STREAMLINE, linewidths=1.3, zorder=2))
    named = channel_map.channels <= _NAMED
    for d in range(channel_map.channels):
        axes.annotate(
            f"channel {d + 1}" if named else f"{d + 1}", (1.005, (Psi[d] + Psi[d + 1]) / 2),
            xycoords=("axes fraction", "data"), rotation=90 if named else 0, va="center", fontsize=7,
        )  # fmt: skip
    axes.set(xlim=(phi[0], phi[-1]), ylim=(Psi[0], Psi[-1]), xlabel="φ", ylabel="ψ")
    axes.set_box_aspect(float((Psi[-1] - Psi[0]) / (phi[-1] - phi[0])))


def draw_barred(axes: Axes, channel_map: ChannelMap) -> None:
    """The nodes at which a dividing streamline is an obstacle's wall."""
    line, column = np.nonzero(channel_map.barred)
    if line.size:
        axes.plot(
            channel_map.phi[column], channel_map.Psi[1:-1][line], "s", color=_BARRED, markeredgecolor="#8a6d00",
            markeredgewidth=0.3, markersize=4, zorder=3, label="barred nodes",
        )  # fmt: skip


def draw_ends(motion: Axes, planning: Axes, plan: FlightPlan, space: PlanningSpace) -> None:
    """Start and goal in both spaces."""
    places = space.locate(np.array([plan.start_m, plan.goal_m]))
    for point, place, marker, size, name in (
        (plan.start_m, places[0], "o", 8, "start"),
        (plan.goal_m, places[1], "*", 14, "goal"),
    ):
        style: dict[str, Any] = {"color": "white", "markeredgecolor": "black", "markersize": size, "zorder": 5}
        motion.plot(*point, marker, label=name, **style)
        planning.plot(*place, marker, **style)


def _across(ends: Array, levels: Array) -> list[Array]:
    return [np.column_stack([ends, [level, level]]) for level in levels]


def _upwards(positions: Array, levels: Array) -> list[Array]:
    return [np.column_stack([[position, position], levels[[0, -1]]]) for position in positions]
