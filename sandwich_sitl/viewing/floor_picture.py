"""What floors add to the plan's picture: heights of obstacles in plan, and altitude along the way.

Input: a `FlightPlan` with floors, ENU metres. Obstacles that the route's floor flies over are drawn lighter.
"""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from sandwich_sitl.planning.flight_plan import FlightPlan

Array = NDArray[np.float64]

_LOW = "#c9a66b"
_TALL = "#8b8f98"
_WAY = "#8e44ad"
_BAND = "#1d9a52"


def draw_obstacles(axes: Axes, plan: FlightPlan) -> None:
    """The obstacles below the route's floor, lighter, with the higher over the lower; and every known height."""
    order = np.argsort(plan.blocking_heights_m, kind="stable").tolist()
    colours = [_LOW if plan.blocking_heights_m[number] < plan.map_altitude_m else _TALL for number in order]
    patches = [Polygon(plan.obstacles_m[number]) for number in order]
    axes.add_collection(PatchCollection(patches, facecolor=colours, zorder=2.6))
    for ring, height in zip(plan.obstacles_m, plan.obstacle_heights_m, strict=True):
        if np.isfinite(height):
            place = shapely.Polygon(ring).representative_point()
            axes.annotate(f"{height:g} m", (place.x, place.y), ha="center", va="center", fontsize=6, zorder=6)


def draw_profile(axes: Axes, plan: FlightPlan) -> None:
    """Altitude of the reference and of its regions over the way over ground, and the obstacles under it."""
    assert plan.floors is not None
    xyz, region = plan.reference.xyz_m, plan.reference.region
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xyz[:, :2], axis=0).T))])
    low, high = plan.corridor.z_m[region].T
    ceiling = 1.25 * float(high.max())
    axes.fill_between(way, low, high, color=_BAND, alpha=0.25, linewidth=0, label="regions' altitudes")
    for number, ring in enumerate(plan.obstacles_m):
        _draw_silhouette(axes, plan, number, shapely.Polygon(ring), way, ceiling)
    for floor in plan.floors.figures:
        axes.axhline(floor.altitude_m, color="#6f737b", linewidth=0.6, linestyle=":")
    axes.plot(way, xyz[:, 2], color=_WAY, linewidth=2.0, label="reference")
    axes.set(xlim=(0.0, way[-1]), ylim=(0.0, ceiling), xlabel="way over ground [m]", ylabel="altitude [m]")
    axes.set_title(
        f"Altitude along the way: {plan.floors.length_m:.1f} m in space, {plan.floors.climbed_m:.1f} m up and "
        f"{plan.floors.descended_m:.1f} m down between floors",
        fontsize=10,
    )
    axes.legend(loc="upper right", fontsize=8, frameon=False)


def _draw_silhouette(
    axes: Axes, plan: FlightPlan, number: int, outline: shapely.Polygon, way: Array, ceiling: float
) -> None:
    """The obstacle where the reference is above it (solid) or within five radii of it (pale)."""
    distance = shapely.distance(outline, shapely.points(plan.reference.xyz_m[:, :2]))
    top = min(float(plan.blocking_heights_m[number]), ceiling)
    for near, alpha in ((5 * plan.vehicle_radius_m, 0.25), (1e-9, 0.8)):
        axes.fill_between(way, 0.0, top, where=(distance <= near).tolist(), color=_TALL if top >= ceiling else _LOW,
                          alpha=alpha, linewidth=0)  # fmt: skip
