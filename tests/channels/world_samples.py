"""Hand-made and random worlds for the tests of the channel map."""

import numpy as np
from shapely import Polygon, box
from shapely.affinity import rotate, translate

from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.world import Obstacle, World

BOUNDS = (0.0, 0.0, 80.0, 50.0)
REACH_M = 1.0


def grown_world(*shapes: Polygon, bounds: tuple[float, float, float, float] = BOUNDS) -> GrownWorld:
    """Obstacles o0, o1, ... grown by `REACH_M`."""
    return grow(World(bounds, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes))), REACH_M, 0.1)


def ell(x: float, y: float, size: float, turn_deg: float) -> Polygon:
    """An L of two arms as long as `size`."""
    s = size
    corners = [(0, 0), (s, 0), (s, 0.35 * s), (0.4 * s, 0.35 * s), (0.4 * s, s), (0, s)]
    return translate(rotate(Polygon(corners), turn_deg, origin=(s / 2, s / 2)), x - s / 2, y - s / 2)


def horseshoe(x: float, y: float, size: float, turn_deg: float) -> Polygon:
    """A U whose inside is 0.5 `size` wide and 0.6 `size` deep."""
    s = size
    shape = box(0, 0, s, s).difference(box(0.25 * s, 0.4 * s, 0.75 * s, 1.1 * s))
    return translate(rotate(shape, turn_deg, origin=(s / 2, s / 2)), x - s / 2, y - s / 2)


def convex(rng: np.random.Generator, x: float, y: float, size: float) -> Polygon:
    """Convex polygon of 3 to 8 corners on an ellipse."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
    points = np.column_stack([x + 0.6 * size * np.cos(angles), y + 0.6 * size * rng.uniform(0.5, 1) * np.sin(angles)])
    return Polygon(points).convex_hull


def random_shapes(seed: int) -> list[Polygon]:
    """0 to 25 obstacles, about a third of them concave; some reach over the border, some overlap."""
    rng = np.random.default_rng(seed)
    shapes: list[Polygon] = []
    for _ in range(seed % 26):
        x, y, size = rng.uniform(2, 78), rng.uniform(2, 48), rng.uniform(2, 8)
        kind = rng.integers(0, 6)
        if kind == 0:
            shapes.append(ell(x, y, size, rng.uniform(0, 360)))
        elif kind == 1:
            shapes.append(horseshoe(x, y, size, rng.uniform(0, 360)))
        else:
            shape = convex(rng, x, y, size)
            if shape.area > 0.5:
                shapes.append(shape)
    return shapes
