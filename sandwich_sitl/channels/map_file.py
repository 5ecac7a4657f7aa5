"""A `ChannelMap` as one `.npz` file, and back."""

import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sandwich_sitl.channels.channel_map import ChannelMap, MapQuality
from sandwich_sitl.errors import InputError

_FORMAT = 1


def save_map(channel_map: ChannelMap, path: Path) -> None:
    """Write the map; channels are stored one array each. Raises `InputError` when the file cannot be written."""
    arrays: dict[str, Any] = {f"channel{d}": xy for d, xy in enumerate(channel_map.xy_m)}
    header = {"format": _FORMAT, "bounds_m": channel_map.bounds_m, "quality": asdict(channel_map.quality)}
    try:
        np.savez(
            path,
            header=np.array(json.dumps(header)),
            barred=channel_map.barred,
            barrier=channel_map.barrier,
            Psi=channel_map.Psi,
            phi=channel_map.phi,
            **arrays,
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error


def load_map(path: Path) -> ChannelMap:
    """Read a map that `save_map` wrote. Raises `InputError` naming the file when it is missing or not such a map."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            header = json.loads(str(data["header"]))
            if header["format"] != _FORMAT:
                raise InputError(
                    f"{path}: is a map of format {header['format']}, this program reads {_FORMAT}; build it again"
                )
            barred = data["barred"]
            return ChannelMap(
                bounds_m=tuple(header["bounds_m"]),
                xy_m=tuple(data[f"channel{d}"] for d in range(len(barred) + 1)),
                barred=barred,
                barrier=data["barrier"],
                Psi=data["Psi"],
                phi=data["phi"],
                quality=MapQuality(**header["quality"]),
            )
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: is not a channel map ({error}); write one with `sandwich-sitl plan`") from error
