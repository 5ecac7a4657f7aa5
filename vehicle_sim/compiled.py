"""One source, two ways: plain Python functions that the flight kernel also compiles to machine code.

`inlined` marks a pure function of floats and tuples: called from Python it is plain Python, called from a kernel it is compiled. `kernel`
compiles a loop and keeps the machine code on disk beside the package; the code of everything inlined is part of the cache's name, so an
edited equation is never met by old machine code.
"""

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., Any])
_sources: set[str] = set()


def inlined(function: F) -> F:
    """The function itself, known to the compiler."""
    _sources.add(function.__code__.co_filename)
    return cast(F, register_jitable(function))


def kernel(function: F) -> F:
    """The compiled function. Its first call ever takes seconds, its first call in a process about 0.2 s."""
    digest = 0
    for source in sorted(_sources | {function.__code__.co_filename}):
        digest = zlib.crc32(Path(source).read_bytes(), digest)
    function.__qualname__ = f"{function.__qualname__}_{digest:08x}"
    compiled: Any = numba.njit(cache=True, error_model="numpy")(function)
    return cast(F, compiled)


def plain(compiled: F) -> F:
    """The same function as plain Python: a hundred times slower, the same bits."""
    return cast(F, getattr(compiled, "py_func", compiled))


def is_cached(compiled: Callable[..., Any]) -> bool:
    """Whether machine code from an earlier run lies on disk, so that the first call is quick."""
    where = Path(cast(Any, compiled).stats.cache_path)
    return any(where.glob(f"*{compiled.__qualname__}-*.nbi"))
