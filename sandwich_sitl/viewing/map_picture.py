"""A channel map as one picture to show: obstacles, channels with their grid, dividing streamlines, bays.

Input: a `ChannelMap` and the obstacles before growing, ENU metres. Grid lines are thinned to a readable pitch, whatever
the map's resolution. The PNG's palette holds the colours of the drawing and the middle of each two: it stays small.
"""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from PIL import Image

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.scene import unbroken

Array = NDArray[np.float64]

_WIDTH_PX = 2000  # of a wide map; others have as many pixels
_PX = 2_400_000
_DPI = 200
_LEAST_WIDTH_IN = 6.0
_TITLE_IN = 0.62
_LEGEND_IN = 0.38
_PAD_IN = 0.12
_LINES = 90  # grid lines along the longer side
_FINE_PX = 7.0  # cells of bays smaller than this are filled without their sides
_PAPER = "#ffffff"
_INK = "#22313f"
_SOFT_INK = "#6b7a88"
_CHANNELS = ("#edf3f8", "#d5e3ef")
_GRID = "#a9c0d3"
_DIVIDE = "#1f5f99"
_BAY = "#f6e7c8"
_BAY_LINE = "#dcc08a"
_GROWN = "#c3c9cf"
_OBSTACLE = "#46525e"
_COLOURS = (_PAPER, _INK, _SOFT_INK, *_CHANNELS, _GRID, _DIVIDE, _BAY, _BAY_LINE, _GROWN, _OBSTACLE)


def draw_map(channel_map: ChannelMap, obstacles_m: Sequence[Array], path: Path, title: str) -> None:
    """Write the picture as PNG; `obstacles_m` are rings (V, 2). Raises `InputError` when `path` cannot be written."""
    x_min, y_min, x_max, y_max = channel_map.bounds_m
    width, height = x_max - x_min, y_max - y_min
    m_per_in = _DPI * max(width / _WIDTH_PX, float(np.sqrt(width * height / _PX)))
    width_in, height_in = width / m_per_in, height / m_per_in
    figure = Figure(
        figsize=(max(width_in, _LEAST_WIDTH_IN) + 2 * _PAD_IN, height_in + _TITLE_IN + _LEGEND_IN), facecolor=_PAPER
    )
    FigureCanvasAgg(figure)
    whole_width, whole_height = figure.get_size_inches()
    axes = figure.add_axes(
        (_PAD_IN / whole_width, _LEGEND_IN / whole_height, width_in / whole_width, height_in / whole_height)
    )
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max))
    axes.axis("off")
    _draw_ground(axes, channel_map, _DPI / m_per_in)
    _draw_lines(axes, channel_map)
    _fill(axes, list(channel_map.grown.rings_m()), _GROWN, zorder=4)
    _fill(axes, list(obstacles_m), _OBSTACLE, zorder=5)
    frame = Rectangle((x_min, y_min), width, height, fill=False, edgecolor=_INK, linewidth=2, zorder=7)
    axes.add_patch(frame)
    _draw_caption(_strip(figure, height_in + _LEGEND_IN, _TITLE_IN), channel_map, title, m_per_in)
    _draw_legend(_strip(figure, 0.0, _LEGEND_IN), channel_map)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=_DPI, format="png")
    small = Image.open(buffer).convert("RGB").quantize(palette=_palette(), dither=Image.Dither.NONE)
    try:
        small.save(path, format="PNG", optimize=True)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); give a directory that can be written"
        ) from error


def _palette() -> Image.Image:
    """An image whose palette is the drawing's colours and the middle of each two, for smooth edges."""
    colours = np.array([to_rgb(colour) for colour in _COLOURS])
    a, b = np.triu_indices(len(colours))
    image = Image.new("P", (1, 1))
    image.putpalette((255 * (colours[a] + colours[b]) / 2).round().astype(np.uint8).tobytes())
    return image


def _draw_ground(axes: Axes, channel_map: ChannelMap, px_per_m: float) -> None:
    """Channels in two tints in turn, bays in a third."""
    for d, (xy, gridded) in enumerate(zip(channel_map.xy_m, channel_map.gridded, strict=True)):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], gridded, [False]]).astype(int)))
        parts = [
            np.concatenate([xy[a : b + 1, 0], xy[b, 1:-1], xy[a : b + 1, -1][::-1], xy[a, 1:-1][::-1]])
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]
        _fill(axes, parts, _CHANNELS[d % 2], zorder=1)
    corners = np.concatenate([np.empty((0, 4, 2)), *(bay.corners_m() for bay in channel_map.bays)])
    if len(corners):
        side_px = px_per_m * float(np.median(np.hypot(*(np.roll(corners, -1, axis=1) - corners).T)))
        line, width = (_BAY_LINE, 0.3) if side_px > _FINE_PX else (_BAY, 0.4)
        axes.add_collection(PolyCollection(list(corners), facecolor=_BAY, edgecolor=line, linewidths=width, zorder=2))


def _draw_lines(axes: Axes, channel_map: ChannelMap) -> None:
    """Some lines phi = const and psi = const of each channel, and the dividing streamlines where they are free."""
    x_min, y_min, x_max, y_max = channel_map.bounds_m
    pitch = max(x_max - x_min, y_max - y_min) / _LINES
    lines: list[Array] = []
    for xy in channel_map.xy_m:
        whole = xy[~np.isnan(xy).any(axis=(1, 2))]
        if len(whole) < 2:
            continue
        across = float(np.median(np.hypot(*(whole[:, -1] - whole[:, 0]).T)))
        rows = np.unique(np.linspace(0, xy.shape[1] - 1, max(2, min(xy.shape[1], round(across / pitch) + 1))).round())
        lines += [xy[:, int(j)] for j in rows[1:-1]]
        lines += [xy[i] for i in range(0, len(xy), _column_step(channel_map, pitch))]
    axes.add_collection(LineCollection(unbroken(lines), colors=_GRID, linewidths=0.45, zorder=3))
    free = [
        np.where(channel_map.barred[d][:, None], np.nan, channel_map.xy_m[d][:, -1])
        for d in range(len(channel_map.barred))
    ]
    axes.add_collection(
        LineCollection(unbroken(free), colors=_DIVIDE, linewidths=1.5, zorder=6, capstyle="round", joinstyle="round")
    )


def _column_step(channel_map: ChannelMap, pitch: float) -> int:
    columns = float(channel_map.phi[-1] - channel_map.phi[0]) / pitch
    return max(1, round((len(channel_map.phi) - 1) / columns))


def _draw_caption(axes: Axes, channel_map: ChannelMap, title: str, m_per_in: float) -> None:
    """Title and figures, and a bar of a round length on the right; the axes are in inches."""
    width_in = axes.get_xlim()[1]
    axes.text(0.0, _TITLE_IN - 0.06, title, fontsize=13, color=_INK, va="top", weight="bold")
    axes.text(0.0, _TITLE_IN - 0.34, _facts(channel_map), fontsize=9.5, color=_SOFT_INK, va="top")
    bar_m = _round_length(width_in * m_per_in / 6)
    start, end = width_in - bar_m / m_per_in - 0.02, width_in - 0.02
    bar = [[(start, 0.14), (end, 0.14)], [(start, 0.09), (start, 0.19)], [(end, 0.09), (end, 0.19)]]
    axes.add_collection(LineCollection(bar, colors=_INK, linewidths=1.2))
    axes.text((start + end) / 2, 0.22, f"{bar_m:g} m", fontsize=9.5, color=_INK, ha="center", va="bottom")


def _draw_legend(axes: Axes, channel_map: ChannelMap) -> None:
    """What the colours mean, in one line; the axes are in inches."""
    entries = [("obstacle", _OBSTACLE), ("kept clear", _GROWN), ("channel", _CHANNELS[1])]
    entries += [("bay", _BAY)] if channel_map.bays else []
    x, y = 0.02, _LEGEND_IN / 2
    for name, colour in entries:
        axes.add_patch(Rectangle((x, y - 0.07), 0.2, 0.14, facecolor=colour, edgecolor=_SOFT_INK, linewidth=0.4))
        axes.text(x + 0.27, y, name, fontsize=9, color=_INK, va="center_baseline")
        x += 0.55 + 0.075 * len(name)
    axes.add_collection(LineCollection([[(x, y), (x + 0.3, y)]], colors=_DIVIDE, linewidths=1.8))
    axes.text(x + 0.37, y, "dividing streamline", fontsize=9, color=_INK, va="center_baseline")


def _strip(figure: Figure, bottom_in: float, height_in: float) -> Axes:
    """Axes in inches across the figure, inside its margins."""
    width, height = figure.get_size_inches()
    axes = figure.add_axes((_PAD_IN / width, bottom_in / height, 1.0 - 2 * _PAD_IN / width, height_in / height))
    axes.set(xlim=(0.0, width - 2 * _PAD_IN), ylim=(0.0, height_in))
    axes.axis("off")
    return axes


def _facts(channel_map: ChannelMap) -> str:
    quality = channel_map.quality
    counts = ((channel_map.channels, "channel"), (len(channel_map.bays), "bay"), (quality.cells, "cell"))
    named = [f"{count:,} {name}{'' if count == 1 else 's'}" for count, name in counts if count]
    folded = "none folded" if quality.folded_cells == 0 else f"{quality.folded_cells} folded"
    return f"{', '.join(named)}, {folded}; {100 * quality.coverage:.2f} % of the free ground"


def _round_length(length: float) -> float:
    """The largest 1, 2 or 5 times a power of ten up to `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length))


def _fill(axes: Axes, rings: list[Array], colour: str, zorder: float) -> None:
    axes.add_collection(PolyCollection(rings, facecolor=colour, edgecolor=colour, linewidths=0.3, zorder=zorder))
