"""A world as one picture: its bounds, its obstacles as given, coloured by height where heights are known. ENU metres."""

from pathlib import Path

import numpy as np
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.world import World

DPI = 160
_WIDTH_IN = 10.0
_UNKNOWN_HEIGHT = "#8b8f98"
_BOUNDS = "#d62f2f"
_ENDS = "#12519c"
_FREE = "#fbfbf8"


def draw_world(world: World, path: Path, ends: tuple[tuple[float, float], ...] = ()) -> None:
    """Write the picture as PNG, with a mark at each of `ends` (start and goal). Raises `InputError` when `path` cannot be written."""
    x_min, y_min, x_max, y_max = world.bounds_m
    width, height = x_max - x_min, y_max - y_min
    figure = Figure(
        figsize=(_WIDTH_IN, float(np.clip(_WIDTH_IN * height / width, 2.5, 14.0)) + 0.6), layout="constrained"
    )
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.add_patch(Rectangle((x_min, y_min), width, height, facecolor=_FREE, zorder=0))
    known = [o for o in world.obstacles if o.height_m is not None]
    unknown = [o for o in world.obstacles if o.height_m is None]
    for obstacles in (unknown, known):
        patches = [Polygon(shapely.get_coordinates(o.polygon.exterior)) for o in obstacles]
        collection = PatchCollection(patches, facecolor=_UNKNOWN_HEIGHT, edgecolor="face", linewidth=0.3)
        axes.add_collection(collection)
        if obstacles and obstacles is known:
            collection.set(array=np.array([o.height_m for o in known]), cmap="viridis_r")
            figure.colorbar(collection, ax=axes, label="height [m]", shrink=0.7)
    axes.add_patch(Rectangle((x_min, y_min), width, height, fill=False, edgecolor=_BOUNDS, linewidth=1.2, zorder=3))
    if ends:
        axes.plot(*zip(*ends, strict=True), "o", color=_ENDS, markersize=7, zorder=4)
        for name, point in zip(("start", "goal"), ends, strict=True):
            axes.annotate(name, point, xytext=(7, 7), textcoords="offset points", color=_ENDS, zorder=4)
    pad = 0.03 * max(width, height)
    axes.set(
        xlim=(x_min - pad, x_max + pad),
        ylim=(y_min - pad, y_max + pad),
        aspect="equal",
        xlabel="x east [m]",
        ylabel="y north [m]",
        title=f"{len(world.obstacles)} obstacles, {width:.1f} x {height:.1f} m",
    )
    try:
        figure.savefig(path, dpi=DPI, format="png")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); give a directory that can be written"
        ) from error
