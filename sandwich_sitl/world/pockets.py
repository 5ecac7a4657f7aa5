"""Dead ends: free ground that leads nowhere, behind a mouth narrower than a given width.

Free ground is opened with a disc (erode, dilate). What the opening removes are necks. A piece of opened ground that
hangs on a single neck, or a neck with a single mouth, is a dead end; a neck with two mouths is a passage and stays.
"""

from dataclasses import replace

import shapely
from shapely import Polygon, box
from shapely.geometry.polygon import orient

from sandwich_sitl.world.grow import GrownWorld, mitred

_SEAM_M = 0.002  # pockets overlap their walls by this much, so that no crack is left


def dead_ends(grown: GrownWorld, mouth_m: float, keep: tuple[tuple[float, float], ...]) -> list[Polygon]:
    """Dead ends of the free ground behind mouths narrower than `mouth_m`; none holds one of the points `keep`."""
    free = box(*grown.bounds_m).difference(shapely.union_all(list(grown.polygons)))
    opened = free.buffer(-mouth_m / 2, join_style="mitre").buffer(
        mouth_m / 2 * 1.001, join_style="mitre", mitre_limit=2.0
    )
    rooms = sorted(_polygons(opened & free), key=lambda room: room.area)
    necks = [neck for neck in _polygons(free - opened) if neck.area > 1e-6 * mouth_m**2]
    touches = [[k for k, room in enumerate(rooms) if shapely.intersects(neck, room)] for neck in necks]
    mouths = [sum(_mouths(neck, rooms[k]) for k in touched) for neck, touched in zip(necks, touches, strict=True)]
    wanted = [shapely.Point(point) for point in keep]
    dead: set[int] = set()
    alive = set(range(len(necks)))
    ended: list[Polygon] = []
    while True:
        before = len(ended)
        for k in sorted(alive):
            open_mouths = mouths[k] - sum(1 for room in touches[k] if room in dead)
            if open_mouths <= 1 and not any(necks[k].distance(point) < mouth_m for point in wanted):
                alive.discard(k)
                ended.append(necks[k])
        for k, room in enumerate(rooms):
            hanging = [n for n in alive if k in touches[n]]
            exits = sum(_mouths(necks[n], room) for n in hanging)
            if (
                k not in dead
                and len(rooms) - len(dead) > 1
                and exits <= 1
                and not any(room.intersects(p) for p in wanted)
            ):
                dead.add(k)
                ended.append(room)
        if len(ended) == before:
            return ended


def fill(grown: GrownWorld, pockets: list[Polygon]) -> GrownWorld:
    """The grown world with the pockets made part of the obstacles round them; no obstacle loses ground."""
    if not pockets:
        return grown
    seams = [mitred(pocket, _SEAM_M) for pocket in pockets]
    # Grown by as much as simplifying may take away.
    solid = mitred(shapely.union_all([*grown.polygons, *seams]), _SEAM_M).simplify(_SEAM_M) & box(*grown.bounds_m)
    parts = [orient(Polygon(part.exterior)) for part in _polygons(solid)]
    names = tuple(
        "+".join(name for polygon, name in zip(grown.polygons, grown.names, strict=True) if polygon.intersects(part))
        or "pocket"
        for part in parts
    )
    return replace(grown, polygons=tuple(parts), names=names)


def _mouths(neck: Polygon, room: Polygon) -> int:
    """In how many separate places the neck opens into the room."""
    shared = shapely.intersection(neck.buffer(1e-6), room)
    return sum(1 for part in shapely.get_parts(shared) if part.length > 1e-3)


def _polygons(geometry: shapely.Geometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
