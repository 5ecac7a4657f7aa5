"""Obstacles into groups R_1 .. R_{p-1}, automatically (the paper draws them by hand); R_j lies between S_j and S_{j+1}.

Barriers that touch the bottom or top border become part of that border. The others are ordered by "lies below at some
x"; a level is the longest chain below, so no two barriers of a level share an x, each level is a left-to-right chain,
and the number of levels is the least possible. A barrier with slack takes the level nearest its height.
"""

from dataclasses import dataclass

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.levels import assign_levels
from sandwich_sitl.channels.tips import place_tips


@dataclass(frozen=True)
class Classification:
    """`bottom` and `top` touch those borders; `groups[d]` (d = 0 .. p - 2) are the chains R_{d+1}, left to right."""

    bottom: tuple[Barrier, ...]
    top: tuple[Barrier, ...]
    groups: tuple[tuple[Barrier, ...], ...]


def classify(barriers: tuple[Barrier, ...], y_min: float, y_max: float, cell_m: float) -> Classification:
    """Group disjoint vertically convex barriers, none of which touches both the bottom and the top border."""
    inner = assign_levels(
        sorted((b for b in barriers if not b.on_bottom and not b.on_top), key=lambda b: b.x_min), y_min, y_max, cell_m
    )
    ordered = sorted(barriers, key=lambda barrier: barrier.x_min)
    return Classification(
        bottom=tuple(b for b in ordered if b.on_bottom),
        top=tuple(b for b in ordered if b.on_top),
        groups=place_tips(inner, barriers),
    )
