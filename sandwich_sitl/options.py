"""Options that several command lines share: `--set KEY=VALUE`, numbers within bounds, files that are written at the end.

What is wrong with an option is said before the work begins.
"""

import argparse
import math
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml

from sandwich_sitl.errors import InputError


def overrides_of(items: Sequence[str]) -> dict[str, Any]:
    """Dotted key paths and values of each `--set KEY=VALUE`. Raises `InputError`."""
    overrides: dict[str, Any] = {}
    for item in items:
        key, separator, text = item.partition("=")
        if not separator or not key:
            raise InputError(f"--set {item}: must be KEY=VALUE, such as planner.cell_m=0.5")
        try:
            overrides[key] = yaml.safe_load(text)
        except (yaml.YAMLError, ValueError) as error:
            raise InputError(f"--set {item}: the value is not valid YAML") from error
    return overrides


def whole(least: int) -> Callable[[str], int]:
    """An argparse type: a whole number of at least `least`."""

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"{text} is not a whole number") from error
        if number < least:
            raise argparse.ArgumentTypeError(f"{text} is less than {least}")
        return number

    return read


def positive(text: str) -> float:
    """An argparse type: a number greater than 0."""
    try:
        number = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is not a number") from error
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text} must be greater than 0")
    return number


def check_writable(option: str, path: Path | None) -> None:
    """Raise `InputError` when the file of an option cannot be written; one that is there keeps what it holds."""
    if path is None:
        return
    is_new = not path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        raise InputError(
            f"{option} {path}: cannot be written ({error.strerror}); give a file in a folder that is there"
        ) from error
    if is_new:
        path.unlink()


def check_program(option: str, name: str | None) -> None:
    """Raise `InputError` when the program of an option cannot be run."""
    if name is not None and shutil.which(name) is None:
        raise InputError(f"{option} {name}: is not a program; give the path of a Python interpreter")
