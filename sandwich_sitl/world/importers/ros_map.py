"""ROS `map_server` maps (wiki.ros.org/map_server, nav2_map_server): a YAML file and a grey image.

p = (255 - grey) / 255, or grey / 255 with `negate`; p > occupied_thresh is an obstacle, p < free_thresh is free, all
else is unknown. `origin` is [x, y, yaw] of the image's lower left corner in metres and radians. Mode `scale` grades the
cells between the thresholds; a world knows no grades, so they stay unknown in both modes. Transparent pixels are
unknown.
"""

import io
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.grid import Grid, check_size
from sandwich_sitl.world.importers.limits import MAX_YAML_BYTES, MAX_YAML_DEPTH, MIN_CELL_M, read_bytes, read_text

_FORMATS = ("PNG", "PPM", "BMP")
_MODES = ("trinary", "scale")


def read_ros_map(path: Path) -> Grid:
    """The grid with its unknown cells apart. Raises `InputError` naming the key or the image."""
    data = _yaml(path)
    resolution = _number(path, data, "resolution", None)
    if resolution < MIN_CELL_M:
        raise InputError(f"{path}: resolution: must be a number of metres, at least {MIN_CELL_M:g}, got {resolution:g}")
    x, y, yaw = _origin(path, data.get("origin", [0.0, 0.0, 0.0]))
    occupied = _number(path, data, "occupied_thresh", 0.65)
    free = _number(path, data, "free_thresh", 0.196)
    if not 0 <= free <= occupied <= 1:
        raise InputError(f"{path}: free_thresh {free} and occupied_thresh {occupied} must be ordered within 0..1")
    negate = data.get("negate", 0)
    if negate not in (0, 1, False, True):
        raise InputError(f"{path}: negate: must be 0 or 1, got {str(negate)[:40]!r}")
    mode = data.get("mode", "trinary")
    if mode not in _MODES:
        raise InputError(f"{path}: mode: must be one of {', '.join(_MODES)}, got {str(mode)[:40]!r}")
    image, remark = _image_path(path, data.get("image"))
    grey, seen = _pixels(image)
    p = grey if negate else 255.0 - grey
    solid = seen & (p > 255.0 * occupied)
    unknown = ~solid & ~(seen & (p < 255.0 * free))
    remarks = (remark,) if remark else ()
    return Grid(str(path), solid[::-1], unknown[::-1], resolution, (x, y), yaw, remarks)


def _yaml(path: Path) -> dict[str, Any]:
    """The mapping. Aliases and deep nesting, which let a small file grow, are refused before anything is built."""
    text = read_text(path, MAX_YAML_BYTES)
    depth = 0
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                raise InputError(f"{path}: uses an alias (*{event.anchor}); write the value out")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_YAML_DEPTH:
                raise InputError(f"{path}: nests deeper than {MAX_YAML_DEPTH}; give the keys of a map_server file")
        data = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise InputError(f"{path}: is not YAML ({reason}); give the keys of a map_server file") from error
    if not isinstance(data, dict) or "image" not in data:
        raise InputError(f"{path}: is not a map_server file; it needs image, resolution and origin")
    return data


def _finite(value: object) -> float | None:
    """The number; text such as 5e-2 is one to YAML 1.2, which map_server reads."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _number(path: Path, data: dict[str, Any], key: str, default: float | None) -> float:
    value = data.get(key, default)
    number = _finite(value)
    if number is None:
        raise InputError(f"{path}: {key}: must be a number, got {str(value)[:40]!r}")
    return number


def _origin(path: Path, given: object) -> tuple[float, float, float]:
    values = [_finite(value) for value in given] if isinstance(given, list) else []
    numbers = [value for value in values if value is not None]
    if len(values) != 3 or len(numbers) != 3:
        raise InputError(f"{path}: origin: must be [x, y, yaw] in metres and radians, got {str(given)[:40]!r}")
    return numbers[0], numbers[1], numbers[2]


def _image_path(path: Path, image: object) -> tuple[Path, str | None]:
    if not isinstance(image, str) or not image or "\0" in image:
        raise InputError(f"{path}: image: must name an image file, got {str(image)[:40]!r}")
    named = path.parent / image
    beside = path.with_suffix(named.suffix)
    if not named.exists() and beside.is_file() and beside != path:
        return beside, f"image {image[:60]} is missing; took {beside.name}, which has the name of the YAML file"
    return named, None


def _pixels(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Grey values 0..255, the mean of the colours, and which pixels are not transparent."""
    # From memory: a read from disk takes as much memory as a damaged file asks for.
    data = io.BytesIO(read_bytes(path))
    try:
        with warnings.catch_warnings(action="error"), Image.open(data, formats=_FORMATS) as image:
            check_size(path, *image.size)
            if image.mode == "I" or image.mode.startswith("I;16"):
                return np.asarray(image, dtype=np.float32) / np.float32(257), np.ones(image.size[::-1], dtype=bool)
            has_alpha = "A" in image.mode or "transparency" in image.info
            channels = np.asarray(image.convert("RGBA" if has_alpha else "RGB"))
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image; give one of {', '.join(_FORMATS)}") from error
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise InputError(f"{path}: cannot be read as an image ({error}); export the map again") from error
    grey = channels[..., :3].sum(axis=2, dtype=np.uint16).astype(np.float32) / 3
    opaque = channels[..., 3] == 255 if has_alpha else np.ones(grey.shape, dtype=bool)
    return grey, opaque
