"""A function in a process of its own: its peak memory is its own, and it can be ended when it takes too long."""

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")


class ChildFailedError(Exception):
    """The process gave no answer; the text says why in a few words."""


def in_child(function: Callable[..., Result], *arguments: Any, timeout_s: float) -> Result:
    """`function(*arguments)`, both to be pickled, in a new interpreter. Raises `ChildFailedError`."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(there, function, arguments), daemon=True)
    process.start()
    there.close()
    try:
        if not here.poll(timeout_s):
            raise ChildFailedError(f"longer than {timeout_s:g} s")
        done, value = here.recv()
    except EOFError as error:
        raise ChildFailedError("ended by the system, as it does when memory is short") from error
    finally:
        process.kill()
        process.join()
        here.close()
    if not done:
        raise ChildFailedError(value)
    result: Result = value
    return result


def peak_memory_mib(pid: int | str = "self") -> float:
    """Most memory a process has held at once (VmHWM), its interpreter and libraries included."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024.0


def _answer(there: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        answer = (True, function(*arguments))
    except MemoryError:
        answer = (False, "out of memory")
    except Exception as error:  # noqa: BLE001 - whatever it is, the parent is told
        answer = (False, f"{type(error).__name__}: {error}")
    there.send(answer)
