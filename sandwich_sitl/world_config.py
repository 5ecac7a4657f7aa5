"""The `world` section of a run, and the options with which a map file is read: one set of keys for both.

Keys carry their units: `_m` metres, ENU in the world's frame, `_deg` degrees on WGS84. Every rule that needs no file is
checked here, so that a mistake is named with its line.
"""

import dataclasses
from dataclasses import field
from typing import Annotated, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator
from pydantic.dataclasses import dataclass
from shapely import Polygon
from shapely.validation import explain_validity

from sandwich_sitl.yaml_document import wrong

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

_MAX_COORDINATE_M = 1e7
_GAP_M = 2.0
_GROWN_MARGINS = 1.25  # smoothing grows obstacles by a little more than the margin

Box = tuple[float, float, float, float]
Positive = Annotated[float, Field(gt=0)]
Length = Annotated[float, Field(ge=0, le=_MAX_COORDINATE_M)]
Coordinate = Annotated[float, Field(ge=-_MAX_COORDINATE_M, le=_MAX_COORDINATE_M)]
PointM = tuple[Coordinate, Coordinate]
Radius = Annotated[float, Field(gt=0, le=_MAX_COORDINATE_M)]
Corners = tuple[Coordinate, Coordinate, Coordinate, Coordinate]


def _with_area(box: Box) -> Box:
    if not (box[2] > box[0] and box[3] > box[1]):
        raise ValueError(f"{list(box)} has no area; give [x_min, y_min, x_max, y_max], or [west, south, east, north]")
    return box


def _as_text(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("YAML reads yes, no, on and off as true and false; write the value in quotes, as 'yes'")
    return value


BoundsM = Annotated[Corners, AfterValidator(_with_area), Field(description="x_min, y_min, x_max, y_max in metres")]
WindowDeg = Annotated[Corners, AfterValidator(_with_area), Field(description="west, south, east, north in degrees")]
Text = Annotated[str, BeforeValidator(_as_text)]


@dataclass(frozen=True, config=STRICT)
class ObstacleConfig:
    """One obstacle of an inline world: exactly one of `polygon_m` and `circle_m`."""

    name: str | None = None
    polygon_m: Annotated[tuple[PointM, ...], Field(min_length=3)] | None = None
    circle_m: (
        Annotated[tuple[Coordinate, Coordinate, Radius], Field(description="centre x, centre y, radius")] | None
    ) = None
    height_m: Positive | None = None

    @model_validator(mode="after")
    def _one_simple_shape(self) -> Self:
        if (self.polygon_m is None) == (self.circle_m is None):
            raise ValueError("needs exactly one of polygon_m and circle_m")
        if self.polygon_m is not None:
            label = f"'{self.name}' " if self.name else ""
            polygon = Polygon(self.polygon_m)
            if not polygon.is_valid:
                reason = explain_validity(polygon)
                raise wrong("polygon_m", f"{label}is not a simple polygon ({reason}); list its corners in order")
            if polygon.area <= 0:
                raise wrong("polygon_m", f"{label}has no area; give at least three corners not on one line")
        return self


@dataclass(frozen=True, config=STRICT)
class GeoOriginConfig:
    """Where the ENU frame of a map in degrees has its origin (WGS84)."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]


@dataclass(frozen=True, config=STRICT)
class ImportOptions:
    """What a map file does not say itself. Every field has a default that suits most files.

    bounds_m: (x_min, y_min, x_max, y_max) of the world; by default what the map holds.
    origin: where (0, 0) lies on WGS84, for maps in degrees; by default the middle of the shapes.
    window_deg: (west, south, east, north); shapes outside are skipped; for maps in degrees.
    where: properties or tags that a feature must all have; "*" stands for any value.
    storey_m: height of a storey, where a map gives `building:levels` and no height.
    repair: cover what a self-crossing outline encloses and drop one without area, instead of refusing the file;
        always so for OpenStreetMap, where a user cannot mend the source.
    cell_m: edge of a cell, for grid maps whose file does not say (MovingAI).
    passable: characters of a MovingAI map that are free ground.
    unknown_is_free: unknown cells of a grid are ground to fly over, not obstacles.
    inside_m: a point of the free ground that is meant; by default the largest connected free ground of a grid.
    clearance_m: bounds of a grid map enclose only where a vehicle keeping this distance can be; by default 0, in a run
        what its planner keeps.
    simplify_m: outlines may cover this much free ground beside them; by default less than a cell of a grid, else 0.
    gap_m: no passage up to this width is narrowed by simplifying; by default 2, in a run the width that the vehicle
        needs.
    """

    bounds_m: BoundsM | None = None
    origin: GeoOriginConfig | None = None
    window_deg: WindowDeg | None = None
    where: dict[str, Text] = field(default_factory=dict)
    storey_m: Radius = 3.0
    repair: bool = False
    cell_m: Annotated[float, Field(ge=1e-4, le=1e4)] = 1.0
    passable: Annotated[str, Field(min_length=1, description="characters of a MovingAI map")] = ".GS"
    unknown_is_free: bool = False
    inside_m: PointM | None = None
    clearance_m: Length | None = None
    simplify_m: Length | None = None
    gap_m: Length | None = None

    @property
    def kept_gap_m(self) -> float:
        """`gap_m`, or its default where no vehicle is known."""
        return _GAP_M if self.gap_m is None else self.gap_m


@dataclass(frozen=True, config=STRICT)
class WorldConfig(ImportOptions):
    """Inline (`bounds_m` and `obstacles`), or a map file (`file`) of any format that is read, with its options."""

    obstacles: tuple[ObstacleConfig, ...] = ()
    file: Annotated[str, Field(min_length=1, description="path, relative to the configuration file")] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.file is not None:
            if self.obstacles:
                raise ValueError("has both file and obstacles; keep one of them")
            return self
        given = next((name for name, value in _file_options() if getattr(self, name) != value), None)
        if given is not None:
            raise wrong(given, "belongs to the map of a file; remove it, or name the map with world.file")
        if self.bounds_m is None:
            raise ValueError(
                "has neither bounds_m nor file; give bounds_m: [x_min, y_min, x_max, y_max], or file: MAP of a map"
            )
        return self


def for_vehicle(world: WorldConfig, radius_m: float, margin_m: float) -> WorldConfig:
    """The section with the defaults of a map file that depend on the vehicle's radius and margin (m) filled in."""
    if world.file is None:
        return world
    gap, clearance = world.gap_m, world.clearance_m
    return dataclasses.replace(
        world,
        gap_m=2 * (radius_m + margin_m) if gap is None else gap,
        clearance_m=radius_m + _GROWN_MARGINS * margin_m if clearance is None else clearance,
    )


def _file_options() -> list[tuple[str, object]]:
    return [
        (item.name, {} if item.default is dataclasses.MISSING else item.default)
        for item in dataclasses.fields(ImportOptions)
        if item.name != "bounds_m"
    ]
