"""Channel maps kept between runs, so that the second run of a configuration does not solve again.

One `.npz` file a map, named by the hash of all that the map depends on; the user's cache directory, or
`$SANDWICH_SITL_CACHE`. A file that cannot be read is built again; the oldest go when there are too many.
"""

import os
from pathlib import Path

import platformdirs

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.map_file import load_map, save_map
from sandwich_sitl.errors import InputError

_MOST_MAPS = 64


class MapStore:
    """A directory of maps."""

    def __init__(self, directory: Path | None = None) -> None:
        given = os.environ.get("SANDWICH_SITL_CACHE")
        self._directory = directory or Path(given or platformdirs.user_cache_dir("sandwich-sitl")) / "maps"

    def get(self, key: str) -> ChannelMap | None:
        """The map kept under a key, None when there is none that can be read."""
        try:
            return load_map(self._path(key))
        except InputError:
            return None

    def put(self, key: str, channel_map: ChannelMap) -> None:
        """Keep a map; a directory that cannot be written keeps none, which costs time only."""
        path = self._path(key)
        partial = path.with_suffix(f".{os.getpid()}.part")
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            save_map(channel_map, partial)
            partial.replace(path)
            self._forget_oldest()
        except (InputError, OSError):
            partial.unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self._directory / f"{key}.npz"

    def _forget_oldest(self) -> None:
        maps = sorted(self._directory.glob("*.npz"), key=lambda path: path.stat().st_mtime)
        for path in maps[:-_MOST_MAPS]:
            path.unlink(missing_ok=True)
