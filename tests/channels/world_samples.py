"""Hand-made and random worlds for the tests of the channel map: one seed, one world.

`sample_world(seed)` draws from `FAMILIES` in turn, so that any run of consecutive seeds covers all of them. Shapes are
drawn in a rectangle of 100 m x 60 m and grown as a run grows them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np
import shapely
from shapely import LineString, Polygon, box
from shapely.affinity import rotate, translate

from sandwich_sitl.channels.channel_map import Flow
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.world import Obstacle, World

Bounds = tuple[float, float, float, float]
Shapes = list[Polygon]
Generator = np.random.Generator

BOUNDS: Bounds = (0.0, 0.0, 80.0, 50.0)
WIDE: Bounds = (0.0, 0.0, 100.0, 60.0)
REACH_M = 1.0
MOST_COVER = 0.35


@dataclass(frozen=True)
class SampleWorld:
    """A grown world and how to map it: `build_channel_map(grown, cell_m, 5, flow)`."""

    family: str
    seed: int
    grown: GrownWorld
    shapes: int  # obstacles before growing
    cell_m: float
    flow: Flow


def grown_world(*shapes: Polygon, bounds: Bounds = BOUNDS, reach_m: float = REACH_M) -> GrownWorld:
    """Obstacles o0, o1, ... grown by `reach_m`."""
    return grow(World(bounds, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes))), reach_m, 0.1)


def ell(x: float, y: float, size: float, turn_deg: float) -> Polygon:
    """An L of two arms as long as `size`."""
    s = size
    corners = [(0, 0), (s, 0), (s, 0.35 * s), (0.4 * s, 0.35 * s), (0.4 * s, s), (0, s)]
    return _placed(Polygon(corners), (s / 2, s / 2), x, y, turn_deg)


def horseshoe(x: float, y: float, size: float, turn_deg: float) -> Polygon:
    """A U whose inside is 0.5 `size` wide and 0.6 `size` deep."""
    s = size
    shape = box(0, 0, s, s).difference(box(0.25 * s, 0.4 * s, 0.75 * s, 1.1 * s))
    return _placed(shape, (s / 2, s / 2), x, y, turn_deg)


def yard(x: float, y: float, size: float, wall: float, mouth: float, turn_deg: float) -> Polygon:
    """A square room with one opening `mouth` wide in the middle of a side."""
    s = size
    hollow = box(0, 0, s, s).difference(box(wall, wall, s - wall, s - wall))
    shape = hollow.difference(box(s / 2 - mouth / 2, s / 2, s / 2 + mouth / 2, s + 1))
    return _placed(shape, (s / 2, s / 2), x, y, turn_deg)


def spiral(x: float, y: float, lane: float, wall: float, arms: int, turn_deg: float) -> Polygon:
    """A square spiral of `arms` straight arms with `lane` of free ground between them."""
    pitch = lane + wall
    at, heading, points = np.zeros(2), np.array([1.0, 0.0]), [np.zeros(2)]
    for k in range(arms):
        at = at + heading * pitch * (k // 2 + 1)
        heading = np.array([-heading[1], heading[0]])
        points.append(at)
    shape = LineString(points).buffer(wall / 2, cap_style="square", join_style="mitre")
    centre = shape.envelope.centroid
    return _placed(shape, (centre.x, centre.y), x, y, turn_deg)


def comb(x: float, y: float, teeth: int, lane: float, tooth: float, depth: float, turn_deg: float) -> Polygon:
    """A bar with teeth `depth` long, `lane` apart."""
    bar = box(0, 0, teeth * (tooth + lane) - lane, tooth)
    spikes = [box(k * (tooth + lane), 0, k * (tooth + lane) + tooth, depth) for k in range(teeth)]
    shape = shapely.union_all([bar, *spikes])
    return _placed(shape, (bar.bounds[2] / 2, depth / 2), x, y, turn_deg)


def needle(x: float, y: float, length: float, width: float, turn_deg: float) -> Polygon:
    """A thin triangle."""
    return _placed(Polygon([(0, 0), (length, width / 2), (0, width)]), (length / 2, width / 2), x, y, turn_deg)


def disc(x: float, y: float, radius: float, vertices: int) -> Polygon:
    """A circle with that many vertices."""
    angle = np.linspace(0, 2 * np.pi, vertices, endpoint=False)
    return Polygon(np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)]))


def convex(rng: Generator, x: float, y: float, size: float) -> Polygon:
    """Convex polygon of 3 to 8 corners on an ellipse, never without area."""
    while True:
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
        heights = y + 0.6 * size * rng.uniform(0.5, 1) * np.sin(angles)
        hull = Polygon(np.column_stack([x + 0.6 * size * np.cos(angles), heights])).convex_hull
        if isinstance(hull, Polygon) and hull.area > 1e-3 * size**2:
            return hull


def random_shapes(seed: int, *, over_border: bool = True) -> Shapes:
    """Up to 25 obstacles, a third of them concave, 1.5 m apart or more once grown; some reach over the border."""
    rng = np.random.default_rng(seed)
    shapes: Shapes = []
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


def _placed(shape: Polygon, centre: tuple[float, float], x: float, y: float, turn_deg: float) -> Polygon:
    return translate(rotate(shape, turn_deg, origin=centre), x - centre[0], y - centre[1])


def _somewhere(rng: Generator) -> tuple[float, float]:
    return float(rng.uniform(WIDE[0], WIDE[2])), float(rng.uniform(WIDE[1], WIDE[3]))


def _turn(rng: Generator) -> float:
    """A turn in degrees: upright as often as not."""
    return float(rng.choice([0.0, 90.0, 180.0, 270.0])) if rng.random() < 0.5 else float(rng.uniform(0, 360))


def _any_shape(rng: Generator, size: float) -> Polygon:
    x, y = _somewhere(rng)
    kind, turn = int(rng.integers(0, 9)), _turn(rng)
    if kind == 0:
        return ell(x, y, size, turn)
    if kind == 1:
        return horseshoe(x, y, size, turn)
    if kind == 2:
        return needle(x, y, 1.5 * size, 0.1 * size, turn)
    if kind == 3:
        return disc(x, y, 0.5 * size, int(rng.integers(6, 200)))
    if kind == 4:
        return rotate(box(x - 0.5 * size, y - 0.3 * size, x + 0.5 * size, y + 0.3 * size), turn)
    return convex(rng, x, y, size)


def _scattered(rng: Generator, count: int, cover: float, gap_m: float, draw: Callable[[float], Polygon]) -> Shapes:
    """Up to `count` shapes at about the cover, none nearer to another than `gap_m`; a negative gap lets them overlap."""
    area = (WIDE[2] - WIDE[0]) * (WIDE[3] - WIDE[1])
    size = float(np.sqrt(cover * area / count / 0.6))
    shapes: Shapes = []
    covered = 0.0
    for _ in range(6 * count):
        shape = draw(size * float(rng.uniform(0.5, 1.5)))
        near = gap_m < 0 or all(shape.distance(other) >= gap_m for other in shapes)
        if near and covered + shape.area <= MOST_COVER * area and len(shapes) < count:
            shapes.append(shape)
            covered += shape.area
    return shapes


def _mixed(rng: Generator) -> tuple[Shapes, float]:
    count, cover = int(rng.integers(1, 201)), float(rng.uniform(0.02, MOST_COVER))
    reach = min(1.0, 0.15 * float(np.sqrt(6000 * cover / count)))
    return _scattered(rng, count, cover, 2 * reach + 0.5, lambda size: _any_shape(rng, size)), reach


def _crowded(rng: Generator) -> tuple[Shapes, float]:
    """Shapes overlap and touch once grown, and leave gaps of any width."""
    count, cover = int(rng.integers(1, 201)), float(rng.uniform(0.02, MOST_COVER))
    reach = min(1.0, 0.1 * float(np.sqrt(6000 * cover / count)))
    return _scattered(rng, count, cover, -1.0, lambda size: _any_shape(rng, size)), reach


def _convex_only(rng: Generator) -> tuple[Shapes, float]:
    count = int(rng.integers(1, 61))
    return _scattered(rng, count, 0.25, 2.5, lambda size: convex(rng, *_somewhere(rng), size)), 0.5


def _ells(rng: Generator) -> tuple[Shapes, float]:
    count = int(rng.integers(1, 31))
    return _scattered(rng, count, 0.25, 2.5, lambda size: ell(*_somewhere(rng), size, _turn(rng))), 0.7


def _horseshoes(rng: Generator) -> tuple[Shapes, float]:
    count = int(rng.integers(1, 21))
    return _scattered(rng, count, 0.25, 2.5, lambda size: horseshoe(*_somewhere(rng), size, _turn(rng))), 0.7


def _spirals(rng: Generator) -> tuple[Shapes, float]:
    def draw(size: float) -> Polygon:
        arms = int(rng.integers(4, 11))
        return spiral(*_somewhere(rng), 0.16 * size, 0.06 * size, arms, _turn(rng))

    return _scattered(rng, int(rng.integers(1, 5)), 0.3, 3.0, draw), 0.4


def _combs(rng: Generator) -> tuple[Shapes, float]:
    def draw(size: float) -> Polygon:
        teeth, lane = int(rng.integers(2, 8)), 0.12 * size + 1.2
        return comb(*_somewhere(rng), teeth, lane, 0.06 * size, float(rng.uniform(0.4, 1.2)) * size, _turn(rng))

    return _scattered(rng, int(rng.integers(1, 6)), 0.25, 3.0, draw), 0.5


def _needles(rng: Generator) -> tuple[Shapes, float]:
    def draw(size: float) -> Polygon:
        return needle(*_somewhere(rng), 3 * size, float(rng.uniform(0.002, 0.1)) * size, _turn(rng))

    return _scattered(rng, int(rng.integers(1, 41)), 0.15, float(rng.uniform(0.0, 2.0)), draw), 0.3


def _round(rng: Generator) -> tuple[Shapes, float]:
    def draw(size: float) -> Polygon:
        return disc(*_somewhere(rng), 0.5 * size, int(rng.integers(1000, 5000)))

    return _scattered(rng, int(rng.integers(1, 21)), 0.3, 2.0, draw), 0.5


def _nested(rng: Generator) -> tuple[Shapes, float]:
    """Yards and horseshoes with things in them, and a thing in those."""
    x, y = float(rng.uniform(30, 70)), float(rng.uniform(25, 35))
    size, turn = float(rng.uniform(30, 48)), _turn(rng)
    mouth = float(rng.uniform(2.5, 12))
    outer = yard(x, y, size, 1.5, mouth, turn) if rng.random() < 0.5 else horseshoe(x, y, size, turn)
    inner_turn = _turn(rng)
    inner = horseshoe(x, y, 0.4 * size, inner_turn)
    core = convex(rng, x, y, 0.08 * size)
    shapes = [outer, *(shape for shape in (inner, core) if rng.random() < 0.8)]
    kept: Shapes = []
    for shape in shapes:
        if all(shape.distance(other) > 2.2 for other in kept):
            kept.append(shape)
    around = _scattered(rng, int(rng.integers(1, 15)), 0.08, 2.0, lambda s: _any_shape(rng, s))
    return [*kept, *(shape for shape in around if all(shape.distance(other) > 1.5 for other in kept))], 0.5


def _over_border(rng: Generator) -> tuple[Shapes, float]:
    """Shapes on, across and just off all four borders and corners."""
    shapes: Shapes = []
    for _ in range(int(rng.integers(2, 15))):
        x, y = _somewhere(rng)
        side = int(rng.integers(0, 5))
        off = float(rng.choice([-1.0, 0.0, 1.0])) * float(rng.uniform(0, 6))
        x = WIDE[0] + off if side == 0 else WIDE[2] + off if side == 1 else x
        y = WIDE[1] + off if side == 2 else WIDE[3] + off if side == 3 else y
        if side == 4:
            x, y = float(rng.choice([WIDE[0], WIDE[2]])), float(rng.choice([WIDE[1], WIDE[3]]))
        size, turn = float(rng.uniform(3, 14)), _turn(rng)
        shapes.append(rng.choice(np.array([ell, horseshoe], dtype=object))(x, y, size, turn))
    return shapes, float(rng.uniform(0.2, 1.0))


def _border_walls(rng: Generator) -> tuple[Shapes, float]:
    """Walls from the borders to about the middle, a labyrinth to pass."""
    shapes: Shapes = []
    for k, x in enumerate(np.arange(8.0, 95.0, float(rng.uniform(7, 20)))):
        reach = float(rng.uniform(0.3, 0.85)) * 60
        low, high = (-3.0, reach) if k % 2 else (60 - reach, 63.0)
        lean = float(rng.choice([0.0, rng.uniform(-3, 3)]))
        width = float(rng.uniform(0.1, 2.0))
        shapes.append(Polygon([(x, low), (x + width, low), (x + width + lean, high), (x + lean, high)]))
    if rng.random() < 0.5:
        shapes = [rotate(shapely.transform(s, lambda xy: xy * (0.6, 1 / 0.6)), 90, origin=(30, 50)) for s in shapes]
        shapes = [translate(s, 20, -20) for s in shapes]
    return shapes, 0.5


def _chains(rng: Generator) -> tuple[Shapes, float]:
    """Strings of shapes that overlap, touch at a point or an edge, or leave a hair between them."""
    shapes: Shapes = []
    for _ in range(int(rng.integers(1, 5))):
        x, y = _somewhere(rng)
        heading = float(rng.uniform(0, 2 * np.pi))
        for _ in range(int(rng.integers(2, 12))):
            size = float(rng.uniform(1.5, 5))
            shapes.append(box(x, y, x + size, y + size) if rng.random() < 0.5 else disc(x, y, size / 2, 24))
            step = size * float(rng.choice([0.7, 1.0, 1.0 + 1e-9, 1.2]))
            heading += float(rng.uniform(-0.7, 0.7))
            x, y = x + step * np.cos(heading), y + step * np.sin(heading)
    return shapes, float(rng.choice([0.05, 0.3, 0.8]))


def _gaps(rng: Generator) -> tuple[Shapes, float]:
    """Walls with gaps just wider and just narrower than what the vehicle needs."""
    reach = float(rng.uniform(0.3, 1.0))
    shapes: Shapes = []
    for x in np.arange(15.0, 90.0, float(rng.uniform(10, 25))):
        spare = float(rng.choice([-1.0, 1.0])) * float(10 ** rng.uniform(-4, -0.3))
        middle, width = float(rng.uniform(10, 50)), float(rng.uniform(0.2, 5))
        gap = 2 * reach + spare
        lean = float(rng.choice([0.0, 0.0, rng.uniform(-8, 8)]))
        shapes.append(rotate(box(x, 3, x + width, middle - gap / 2), lean, origin=(x, middle)))
        shapes.append(rotate(box(x, middle + gap / 2, x + width, 57), lean, origin=(x, middle)))
    return shapes, reach


def _split(rng: Generator) -> tuple[Shapes, float]:
    """A bar, bent or straight, across the whole world, with scattered shapes on both sides."""
    if rng.random() < 0.5:
        path = [(x, float(rng.uniform(20, 40))) for x in (-5.0, 30.0, 65.0, 105.0)]
    else:
        path = [(float(rng.uniform(40, 60)), y) for y in (-5.0, 15.0, 40.0, 65.0)]
    bar = LineString(path).buffer(float(rng.uniform(0.3, 3)), cap_style="flat", join_style="mitre")
    around = _scattered(rng, int(rng.integers(1, 20)), 0.1, 2.0, lambda size: _any_shape(rng, size))
    return [bar, *around], 0.5


def _one(rng: Generator) -> tuple[Shapes, float]:
    return [_any_shape(rng, float(10 ** rng.uniform(-1, 1.6)))], float(rng.choice([0.1, 1.0]))


def _none(_: Generator) -> tuple[Shapes, float]:
    return [], 1.0


def _tiles(rng: Generator) -> tuple[Shapes, float]:
    """Blocks in rows and columns: equal coordinates everywhere."""
    columns, rows = int(rng.integers(2, 14)), int(rng.integers(2, 9))
    street = float(rng.uniform(1.5, 4))
    width, height = (100 - street) / columns - street, (60 - street) / rows - street
    corners = [
        (street + i * (width + street), street + j * (height + street)) for i in range(columns) for j in range(rows)
    ]
    turn = float(rng.choice([0.0, 0.0, rng.uniform(-20, 20)]))
    blocks = [box(x, y, x + 0.55 * width, y + 0.6 * height) for x, y in corners if rng.random() < 0.8]
    return [rotate(block, turn, origin=(50, 30)) for block in blocks], 0.3


FAMILIES: dict[str, Callable[[Generator], tuple[Shapes, float]]] = {
    "mixed": _mixed,
    "crowded": _crowded,
    "convex": _convex_only,
    "ells": _ells,
    "horseshoes": _horseshoes,
    "spirals": _spirals,
    "combs": _combs,
    "needles": _needles,
    "round": _round,
    "nested": _nested,
    "over_border": _over_border,
    "border_walls": _border_walls,
    "chains": _chains,
    "gaps": _gaps,
    "split": _split,
    "one": _one,
    "none": _none,
    "tiles": _tiles,
}


# One seed of each family whose world has few obstacles.
QUICK = {family: number for number, family in enumerate(FAMILIES)} | {"mixed": 342, "crowded": 271, "convex": 38}


def sample_world(seed: int) -> SampleWorld:
    """World number `seed` of the suite: its family, shapes, flow and cell size (0.5 to 2 % of the width)."""
    rng = np.random.default_rng([3, seed])
    family = list(FAMILIES)[seed % len(FAMILIES)]
    shapes, reach = FAMILIES[family](rng)
    cell_m = float(rng.uniform(0.5, 2.0))
    flow: Flow = get_args(Flow)[int(rng.integers(0, 2))]
    world = World(WIDE, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes)))
    return SampleWorld(family, seed, grow(world, reach, 0.15 * min(cell_m, 0.6 * reach)), len(shapes), cell_m, flow)


def thousand_obstacles(seed: int) -> SampleWorld:
    """1,000 small convex shapes at about 20 % cover."""
    rng = np.random.default_rng([4, seed])
    shapes: Shapes = []
    for i in range(40):
        for j in range(25):
            at = np.array([2.5 * i + 1.25, 2.4 * j + 1.2]) + rng.uniform(-0.35, 0.35, 2)
            shapes.append(convex(rng, float(at[0]), float(at[1]), float(rng.uniform(0.7, 1.3))))
    world = World(WIDE, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes)))
    return SampleWorld("thousand", seed, grow(world, 0.2, 0.02), len(shapes), 0.5, "x")
