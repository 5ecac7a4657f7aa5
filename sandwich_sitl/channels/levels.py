"""Levels: which group each barrier belongs to.

"Lies below at some x" on disjoint vertically convex shapes has no cycle. A sweep from left to right finds the pairs
that are neighbours at some x; the longest chain of them below a barrier is its least level, so the number of levels is
the longest chain of the world, the least possible. Barriers with slack start at the level of their height and then
move, one at a time, while that lowers a cost: the detours of the streamlines between tips, and the crowding of
streamlines in gaps too narrow for them.
"""

from bisect import bisect_left, insort
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.barrier import Barrier

Array = NDArray[np.float64]

_MOST_SWEEPS = 20
_ROOM = 4.0  # cells that a channel should have across, at least
_CROWDING = 30.0  # metres of detour that a gap with no room at all is worth, per cell
_SAMPLES = 9  # positions at which the gap between two barriers is measured


@dataclass(frozen=True)
class _Gap:
    """Neighbours at some x: `below` and `above` are barriers' numbers, None for a border; the least height between."""

    below: int | None
    above: int | None
    height_m: float


def assign_levels(
    barriers: list[Barrier], y_min: float, y_max: float, cell_m: float
) -> tuple[tuple[Barrier, ...], ...]:
    """Chains of barriers, bottom level first, each left to right; `barriers` come sorted by `x_min`."""
    if not barriers:
        return ()
    above = _neighbours_above(barriers)
    below: list[list[int]] = [[] for _ in barriers]
    for k, uppers in enumerate(above):
        for m in uppers:
            below[m].append(k)
    least, headroom = _longest(below), _longest(above)
    levels = max(least) + 1
    level = _by_height(barriers, below, least, headroom, levels, (y_min, y_max))
    gaps = _gaps_round(barriers, above, below, (y_min, y_max))
    chains: list[list[int]] = [[k for k in range(len(barriers)) if level[k] == d] for d in range(levels)]
    even = [y_min + (d + 1) / (levels + 1) * (y_max - y_min) for d in range(levels)]

    def cost(k: int, d: int) -> float:
        crowding = sum(_crowding(gap, k, d, level, levels, cell_m) for gap in gaps[k])
        return _detour(barriers, chains[d], k, even[d]) + _CROWDING * cell_m * crowding

    for _ in range(_MOST_SWEEPS):
        moved = False
        for k in range(len(barriers)):
            lowest = max((level[m] + 1 for m in below[k]), default=0)
            highest = min((level[m] - 1 for m in above[k]), default=levels - 1)
            if lowest == highest:
                continue
            chains[level[k]].remove(k)
            costs = {d: cost(k, d) for d in range(lowest, highest + 1)}
            best = min(costs, key=lambda d: (costs[d], d))
            if costs[best] < costs[level[k]] - 1e-9:
                level[k], moved = best, True
            insort(chains[level[k]], k)
        if not moved:
            break
    return tuple(tuple(barriers[k] for k in chain) for chain in chains)


def _by_height(
    barriers: list[Barrier],
    below: list[list[int]],
    least: list[int],
    headroom: list[int],
    levels: int,
    y_range: tuple[float, float],
) -> list[int]:
    """Each barrier at the level its height calls for, as far as its neighbours allow."""
    y_min, y_max = y_range
    level = [0] * len(barriers)
    for k in sorted(range(len(barriers)), key=lambda k: least[k]):
        ring = barriers[k].ring_m
        share = ((ring[:, 1].min() + ring[:, 1].max()) / 2 - y_min) / (y_max - y_min)
        wanted = min(round(share * (levels + 1)) - 1, levels - 1 - headroom[k])
        level[k] = max([wanted, least[k], *(level[m] + 1 for m in below[k])])
    return level


def _neighbours_above(barriers: list[Barrier]) -> list[list[int]]:
    """For each barrier those that lie next above it at some x."""
    arrivals = [(barrier.x_min, 0, k) for k, barrier in enumerate(barriers)]
    departures = [(barrier.x_max, 1, k) for k, barrier in enumerate(barriers)]
    stack: list[int] = []  # barriers over the sweep's x, bottom first
    above: list[set[int]] = [set() for _ in barriers]
    for x, leaving, k in sorted(arrivals + departures):
        if leaving:
            place = stack.index(k)
            stack.pop(place)
            if 0 < place < len(stack):
                above[stack[place - 1]].add(stack[place])
            continue
        at = np.array([x])
        place = bisect_left(stack, _low(barriers[k], at), key=lambda m: _low(barriers[m], at))
        if place > 0:
            above[stack[place - 1]].add(k)
        if place < len(stack):
            above[k].add(stack[place])
        stack.insert(place, k)
    return [sorted(found) for found in above]


def _low(barrier: Barrier, x: Array) -> float:
    return float(barrier.extent(x)[0][0])


def _gaps_round(
    barriers: list[Barrier], above: list[list[int]], below: list[list[int]], y_range: tuple[float, float]
) -> list[list[_Gap]]:
    """For each barrier the gaps to its neighbours, and to the borders where it has none."""
    gaps: list[list[_Gap]] = [[] for _ in barriers]
    for k, uppers in enumerate(above):
        for m in uppers:
            left = max(barriers[k].x_min, barriers[m].x_min)
            right = min(barriers[k].x_max, barriers[m].x_max)
            x = np.linspace(left, right, _SAMPLES)
            gap = _Gap(k, m, float((barriers[m].extent(x)[0] - barriers[k].extent(x)[1]).min()))
            gaps[k].append(gap)
            gaps[m].append(gap)
        if not uppers:
            gaps[k].append(_Gap(k, None, y_range[1] - float(barriers[k].ring_m[:, 1].max())))
        if not below[k]:
            gaps[k].append(_Gap(None, k, float(barriers[k].ring_m[:, 1].min()) - y_range[0]))
    return gaps


def _crowding(gap: _Gap, k: int, d: int, level: list[int], levels: int, cell_m: float) -> float:
    """How much more room the channels through a gap want than it has, with barrier k at level d."""
    low = -1 if gap.below is None else d if gap.below == k else level[gap.below]
    high = levels if gap.above is None else d if gap.above == k else level[gap.above]
    channels = high - low
    wanted = channels * _ROOM * cell_m
    return 0.0 if channels <= 1 else max(0.0, wanted / max(gap.height_m, 1e-9) - 1.0)


def _detour(barriers: list[Barrier], chain: list[int], k: int, even_m: float) -> float:
    """What inserting barrier k costs a chain: the streamline's detours to and from its tips, less those it replaces."""
    place = bisect_left(chain, k)
    before = barriers[chain[place - 1]] if place > 0 else None
    after = barriers[chain[place]] if place < len(chain) else None
    own = barriers[k]
    return _step(before, own, even_m) + _step(own, after, even_m) - _step(before, after, even_m)


def _step(a: Barrier | None, b: Barrier | None, even_m: float) -> float:
    """dy^2 / (dx + |dy|) between the faces: about |dy| where the step is steep, little where it is gentle."""
    start = None if a is None or a.on_right else _middle(a.right_face())
    end = None if b is None or b.on_left else _middle(b.left_face())
    if start is None and end is None:
        return 0.0
    if start is None or end is None:
        tip = end if start is None else start
        return 0.5 * abs(float(tip[1]) - even_m) if tip is not None else 0.0
    dx, dy = abs(float(end[0] - start[0])), abs(float(end[1] - start[1]))
    return dy * dy / (dx + dy) if dy > 0 else 0.0


def _middle(face: Array) -> Array:
    return np.asarray((face[0] + face[-1]) / 2)


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
