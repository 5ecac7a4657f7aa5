"""What an import may cost at most, and the one way a file's bytes are read.

Every limit is checked on what a file declares before memory is taken for it, so that a small file cannot ask for much.
Measured worst cases: 13 s and 0.5 GB for a grid of noise, 7 s and 0.3 GB for shapes, 30 s when those are simplified.
"""

import stat
from pathlib import Path

from sandwich_sitl.errors import InputError

MAX_TEXT_BYTES = 64 * 2**20  # GeoJSON, WKT, CSV, MovingAI and the image of a grid
MAX_OSM_BYTES = 64 * 2**20
MAX_OSM_OBJECTS = 5_000_000  # nodes, ways and relations: a small file can unpack to very many
MAX_OSM_S = 120.0
MAX_YAML_BYTES = 64 * 2**10
MAX_YAML_DEPTH = 8
MAX_WKT_DEPTH = 8
MAX_SHAPES = 100_000
MAX_VERTICES = 500_000
MAX_SIMPLIFIED_VERTICES = 100_000  # of shapes drawn freely, whose notches may be long
MAX_GRID_CELLS = 16_000_000
MAX_GRID_CORNERS = 500_000  # corners of all outlines; noise has more than any drawn or measured map
MIN_CELL_M = 1e-4
MAX_COORDINATE_M = 1e7
MAX_SPAN_M = 100_000.0  # of a map in degrees; beyond it the tangent plane is not a map any more

_ARCHIVES = {b"PK\x03\x04": "zip", b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"\x28\xb5\x2f\xfd": "zstd"}


def file_size(path: Path, most_bytes: int) -> int:
    """Size of a regular file. Raises `InputError` when it is missing, no regular file, or larger than `most_bytes`."""
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of a map file") from error
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: is not a regular file; give the path of a map file")
    if status.st_size > most_bytes:
        raise InputError(f"{path}: has {status.st_size} bytes, more than {most_bytes}; cut out the part that is flown")
    return status.st_size


def head(path: Path, count: int = 512) -> bytes:
    """First bytes of the file. Raises `InputError` as `file_size` does, and for a packed file."""
    file_size(path, MAX_OSM_BYTES)
    try:
        with path.open("rb") as stream:
            start = stream.read(count)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a file that can be read") from error
    for magic, name in _ARCHIVES.items():
        if start.startswith(magic):
            raise InputError(f"{path}: is packed with {name}; unpack it first")
    return start


def read_text(path: Path, most_bytes: int = MAX_TEXT_BYTES) -> str:
    """The file as UTF-8 text without byte order mark. Raises `InputError` as `file_size` does, or if it is no text."""
    try:
        return read_bytes(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8") from error


def read_bytes(path: Path, most_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """The file's bytes. Raises `InputError` as `file_size` does."""
    file_size(path, most_bytes)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a file that can be read") from error
