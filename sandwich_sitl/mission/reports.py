"""Obstacles as others report them: `ObstacleReport`, and the JSON that says one (pure).

    {"name": "crane", "polygon": [[30, 12], [34, 12], [34, 18]], "height_m": 20}

`polygon` are the corners (x east, y north, metres in the world's frame), either way round, without closing point; it
may be concave but not cross itself. `height_m` may be left out. Anything else is malformed and said so.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import shapely
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sandwich_sitl.errors import InputError, printable
from sandwich_sitl.world.world import Obstacle

_MOST_BYTES = 64 * 1024
_LEAST_AREA_M2 = 1e-4
_MOST_CORNERS = 500
_FARTHEST_M = 1e6

Metres = Annotated[float, Field(ge=-_FARTHEST_M, le=_FARTHEST_M)]


class Source(StrEnum):
    """Who reported an obstacle: somebody by name and outline, or the range sensor by what it sees of it."""

    MESSAGE = "message"
    SENSOR = "sensor"


@dataclass(frozen=True)
class ObstacleReport:
    """An obstacle and when it was heard of, seconds of the run's clock."""

    obstacle: Obstacle
    source: Source
    heard_s: float


class _Payload(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    name: Annotated[str, Field(min_length=1, max_length=64)]
    polygon: Annotated[list[tuple[Metres, Metres]], Field(min_length=3, max_length=_MOST_CORNERS)]
    height_m: Annotated[float, Field(gt=0, le=_FARTHEST_M)] | None = None


def parse_obstacle(payload: bytes) -> Obstacle:
    """The obstacle that a payload describes. Raises `InputError` that says what is wrong and where."""
    if len(payload) > _MOST_BYTES:
        raise InputError(f"obstacle report: {len(payload)} bytes are too many, at most {_MOST_BYTES}")
    try:
        said = _Payload.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "payload"
        raise InputError(f"obstacle report: {where}: {first['msg']}") from error
    polygon = shapely.Polygon(said.polygon)
    name = printable(said.name)
    if not polygon.is_valid or polygon.area < _LEAST_AREA_M2:
        raise InputError(
            f"obstacle report '{name}': polygon: crosses itself or has no area; give a simple outline's corners in order"
        )
    return Obstacle(name, shapely.orient_polygons(polygon), said.height_m)
