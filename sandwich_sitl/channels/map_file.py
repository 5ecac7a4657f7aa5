"""A `ChannelMap` as one `.npz` file, and back."""

import hashlib
import json
import zipfile
from pathlib import Path

import numpy as np

from sandwich_sitl.channels.channel_map import ChannelMap, Flow
from sandwich_sitl.channels.map_arrays import map_from_arrays, map_to_arrays
from sandwich_sitl.errors import InputError
from sandwich_sitl.world.grow import GrownWorld

_FORMAT = 7  # of the file and of the way maps are made: a change of either makes kept maps void


def map_key(grown: GrownWorld, cell_m: float, min_rows: int, flow: Flow) -> str:
    """Hash of all that a map depends on."""
    parts = [repr((_FORMAT, grown.bounds_m, grown.names, cell_m, min_rows, flow)).encode()]
    parts += [np.ascontiguousarray(ring).tobytes() for ring in grown.rings_m()]
    return hashlib.sha256(b"|".join(parts)).hexdigest()[:32]


def save_map(channel_map: ChannelMap, path: Path) -> None:
    """Write the map. Raises `InputError` when the file cannot be written."""
    arrays, header = map_to_arrays(channel_map)
    try:
        with path.open("wb") as file:
            np.savez(file, allow_pickle=False, header=np.array(json.dumps({"format": _FORMAT} | header)), **arrays)
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
            return map_from_arrays({name: data[name] for name in data.files if name != "header"}, header)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: is not a channel map ({error}); write one with `sandwich-sitl plan`") from error
