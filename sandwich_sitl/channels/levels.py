"""Levels: which group each barrier belongs to (notes N6).

"Lies below at some x" on disjoint vertical hulls has no cycle. The longest chain below a barrier is its least level,
so the number of levels is the longest chain of the world, the least possible. Barriers with slack then move to the
level whose chain they fit best: the sum of the height steps along all chains is lowered one barrier at a time until
no move helps.
"""

import numpy as np

from sandwich_sitl.channels.barrier import Barrier

_MOST_SWEEPS = 20


def assign_levels(barriers: list[Barrier], y_min: float, y_max: float) -> tuple[tuple[Barrier, ...], ...]:
    """Chains of barriers, left to right, bottom level first."""
    n = len(barriers)
    below = [[k for k in range(n) if k != m and _lies_below(barriers[k], barriers[m])] for m in range(n)]
    above = [[m for m in range(n) if k in below[m]] for k in range(n)]
    least, headroom = _longest(below), _longest(above)
    levels = max(least, default=-1) + 1
    level = list(least)
    heights = np.array([(b.ring_m[:, 1].min() + b.ring_m[:, 1].max()) / 2 for b in barriers])
    order = sorted(range(n), key=lambda k: barriers[k].hull.x_min)
    for _ in range(_MOST_SWEEPS):
        moved = False
        for k in order:
            lowest = max((level[m] + 1 for m in below[k]), default=0)
            highest = min((level[m] - 1 for m in above[k]), default=levels - 1 - headroom[k])
            costs = {}
            for candidate in range(lowest, highest + 1):
                level[k], kept = candidate, level[k]
                costs[candidate] = _roughness(level, order, heights, levels, y_min, y_max)
                level[k] = kept
            best = min(costs, key=lambda candidate: (costs[candidate], candidate))
            if costs[best] < costs[level[k]] - 1e-9:
                level[k], moved = best, True
        if not moved:
            break
    return tuple(tuple(barriers[k] for k in order if level[k] == d) for d in range(levels))


def _roughness(
    level: list[int], order: list[int], heights: np.ndarray, levels: int, y_min: float, y_max: float
) -> float:
    """Sum over the chains of |height step|, each chain starting and ending near its even height."""
    last = [y_min + (d + 1) / (levels + 1) * (y_max - y_min) for d in range(levels)]
    even, total = list(last), 0.0
    started = [False] * levels
    for k in order:
        d = level[k]
        weight = 1.0 if started[d] else 0.5
        total += weight * abs(float(heights[k]) - last[d])
        last[d], started[d] = float(heights[k]), True
    return total + sum(0.5 * abs(a - b) for a, b in zip(last, even, strict=True))


def _lies_below(a: Barrier, b: Barrier) -> bool:
    left, right = max(a.hull.x_min, b.hull.x_min), min(a.hull.x_max, b.hull.x_max)
    if left > right:
        return False
    middle = np.array([(left + right) / 2])
    (a_low,), (a_high,) = a.hull.extent(middle)
    (b_low,), (b_high,) = b.hull.extent(middle)
    return bool(a_low + a_high < b_low + b_high)


def _longest(predecessors: list[list[int]]) -> list[int]:
    """Length of the longest chain that ends in each element of an acyclic relation."""
    length: dict[int, int] = {}
    for start in range(len(predecessors)):
        stack = [start]
        while stack:
            k = stack[-1]
            pending = [m for m in predecessors[k] if m not in length]
            if pending:
                stack.extend(pending)
            else:
                length[k] = max((length[m] + 1 for m in predecessors[k]), default=0)
                stack.pop()
    return [length[k] for k in range(len(predecessors))]
