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


def random_shapes(seed: int, *, over_border: bool = True) -> list[Polygon]:
    """Up to 25 obstacles, a third of them concave, 1.5 m apart or more once grown; some reach over the border."""
    rng = np.random.default_rng(seed)
    shapes: list[Polygon] = []
    for _ in range(20 * (seed % 26)):
        x, y, size = rng.uniform(0, 80), rng.uniform(0, 50), rng.uniform(3, 9)
        kind, turn = rng.integers(0, 6), rng.uniform(0, 360)
        shape = ell(x, y, size, turn) if kind == 0 else horseshoe(x, y, size, turn) if kind == 1 else None
        shape = convex(rng, x, y, size) if shape is None else shape
        gap = shape.distance(box(*BOUNDS).exterior)
        roomy = all(shape.distance(other) > 2 * REACH_M + 1.5 for other in shapes)
        fits = over_border or shape.within(box(*BOUNDS))
        if fits and shape.area > 1.0 and roomy and (gap == 0 or gap > REACH_M + 1.5) and len(shapes) < seed % 26:
            shapes.append(shape)
    return shapes
