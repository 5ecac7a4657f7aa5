"""The tags that GeoJSON and OpenStreetMap share: the filter over them, and heights.

A height is `height` in metres, else `building:levels` storeys; one that cannot be understood is unknown and remarked.
"""

import math
import re
from collections.abc import Mapping

_METRES = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*m?\s*")
_FEET = re.compile(r"\s*(\d+)\s*'\s*(?:(\d+)\s*\"\s*)?")
_FOOT_M = 0.3048


def matches(tags: Mapping[str, object], where: Mapping[str, str]) -> bool:
    """Whether the tags have every key of the filter with its value; "*" is any value."""
    return all(tags.get(key) is not None and value in ("*", _text(tags[key])) for key, value in where.items())


def height_m(tags: Mapping[str, object], storey_m: float) -> tuple[float | None, str | None]:
    """Height and, where a tag is present but not understood, the remark that says so."""
    for key, unit_m in (("height", 1.0), ("building:height", 1.0), ("building:levels", storey_m)):
        value = tags.get(key)
        if value is None:
            continue
        number = _number(value)
        if number is not None and math.isfinite(number) and number > 0:
            return number * unit_m, None
        return (
            None,
            f"{key} {str(value)[:40]!r} is not a positive number of {'storeys' if 'levels' in key else 'metres'}",
        )
    return None, None


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _number(value: object) -> float | None:
    if type(value) in (int, float):
        return float(str(value))
    if not isinstance(value, str):
        return None
    if match := _METRES.fullmatch(value):
        return float(match[1].replace(",", "."))
    if match := _FEET.fullmatch(value):
        return _FOOT_M * (int(match[1]) + int(match[2] or 0) / 12)
    return None
