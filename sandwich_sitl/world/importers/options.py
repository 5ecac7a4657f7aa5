"""`ImportOptions`: what a map file does not say itself. Lengths in metres, angles in degrees where the name says so."""

import math
from dataclasses import dataclass

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.world import GeoOrigin

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class ImportOptions:
    """Every field has a default that suits most files. Raises `InputError` for values that make no sense.

    bounds_m: (x_min, y_min, x_max, y_max) of the world; by default what the map holds.
    origin: where (0, 0) lies on WGS84, for maps in degrees; by default the middle of the shapes.
    window_deg: (west, south, east, north); shapes outside are skipped; for maps in degrees.
    where: (key, value) pairs that a feature's properties or tags must all equal.
    storey_m: height of a storey, where a map gives `building:levels` and no height.
    repair: cover what a self-crossing outline encloses and drop one without area, instead of refusing the file;
        always so for OpenStreetMap, where a user cannot mend the source.
    cell_m: edge of a cell, for grid maps whose file does not say (MovingAI).
    passable: characters of a MovingAI map that are free ground.
    unknown_is_free: unknown cells of a grid are ground to fly over, not obstacles.
    inside_m: a point of the free ground that is meant; by default the largest connected free ground of a grid.
    clearance_m: bounds of a grid map enclose only where a vehicle keeping this distance can be: its radius, its
        margin and the planner's detail.
    simplify_m: outlines may cover this much free ground beside them; by default less than a cell of a grid, else 0.
    gap_m: no passage up to this width is narrowed by simplifying.
    """

    bounds_m: Box | None = None
    origin: GeoOrigin | None = None
    window_deg: Box | None = None
    where: tuple[tuple[str, str], ...] = ()
    storey_m: float = 3.0
    repair: bool = False
    cell_m: float = 1.0
    passable: str = ".GS"
    unknown_is_free: bool = False
    inside_m: tuple[float, float] | None = None
    clearance_m: float = 0.0
    simplify_m: float | None = None
    gap_m: float = 2.0

    def __post_init__(self) -> None:
        for name, box in (("bounds_m", self.bounds_m), ("window_deg", self.window_deg)):
            if box is not None and not (all(map(math.isfinite, box)) and box[2] > box[0] and box[3] > box[1]):
                raise InputError(f"{name}: {list(box)} has no area; give [west, south, east, north]")
        for name in ("storey_m", "cell_m"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"{name}: must be positive, got {getattr(self, name)}")
        for name in ("clearance_m", "simplify_m", "gap_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise InputError(f"{name}: must be zero or more, got {value}")
        if not self.passable:
            raise InputError("passable: names no character; give those that are free ground, such as '.GS'")
