"""The plane as OMPL has it, for the benches in which OMPL is a peer. OMPL is optional: imported when asked for."""

from typing import Any


def plane(bounds_m: tuple[float, float, float, float]) -> Any:
    """OMPL's state space of the points within bounds."""
    from ompl import base

    x_min, y_min, x_max, y_max = bounds_m
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis, (low, high) in enumerate(((x_min, x_max), (y_min, y_max))):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)
    return space
