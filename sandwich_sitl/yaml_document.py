"""A YAML mapping that knows its lines, and pydantic's complaints about it as one line for people."""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from sandwich_sitl.errors import InputError

_MAX_BYTES = 4 * 2**20  # about half a minute of reading; larger worlds belong into map files
_MAX_VALUES = 1_000_000  # after aliases and merges are written out: a small file can name very many
_KEY_TAGS = ("tag:yaml.org,2002:str", "tag:yaml.org,2002:merge")


class _UniqueKeyLoader(yaml.SafeLoader):
    """YAML keeps the last of two equal keys without a word and allows keys that are no text; here both are errors."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if key_node.tag not in _KEY_TAGS:
                raise yaml.MarkedYAMLError(problem="a key must be text", problem_mark=key_node.start_mark)
            if key_node.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"key '{key_node.value}' stands twice", problem_mark=key_node.start_mark
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)


def is_run_file(path: Path) -> bool:
    """Whether the file looks like a run's configuration rather than a map: YAML with a section `world`."""
    try:
        if path.suffix.lower() not in (".yaml", ".yml") or path.stat().st_size > _MAX_BYTES:
            return False
        return re.search(rb"^world[ \t]*:", path.read_bytes(), re.MULTILINE) is not None
    except OSError:
        return False


@dataclass
class YamlDocument:
    """A YAML mapping with the lines its keys came from, so that an error can point at them."""

    path: Path
    data: dict[str, Any]
    root: yaml.Node
    overridden: list[str] = field(default_factory=list)

    @classmethod
    def read(cls, path: Path) -> "YamlDocument":
        """Raises `InputError` when the file is missing, not UTF-8, not YAML, or not a mapping."""
        try:
            if path.stat().st_size > _MAX_BYTES:
                raise InputError(
                    f"{path}: has more than {_MAX_BYTES} bytes; put its world into a map file (world.file)"
                )
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(
                f"{path}: cannot be read ({error.strerror}); give the path of a run's YAML file"
            ) from error
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: is not UTF-8 text; save it as UTF-8") from error
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
            if root is not None and _written_out(root, {}) > _MAX_VALUES:
                raise InputError(f"{path}: its aliases (*name) stand for more than {_MAX_VALUES} values; write fewer")
            data = yaml.load(text, Loader=_UniqueKeyLoader)
        except RecursionError as error:
            raise InputError(f"{path}: nests too deep; give keys such as world, start_m, goal_m") from error
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            raise InputError(f"{path}:{line}: is not valid YAML: {error.problem}") from error
        except (yaml.YAMLError, ValueError) as error:
            raise InputError(f"{path}: is not valid YAML: {' '.join(str(error).split())}") from error
        if not isinstance(data, dict) or root is None:
            raise InputError(f"{path}: must be a mapping of keys such as world, start_m, goal_m")
        return cls(path, data, root)

    def set(self, key_path: str, value: Any) -> None:
        """Override one value, creating sections on the way."""
        try:
            put(self.data, key_path, value)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error
        self.overridden.append(key_path)

    def describe(self, error: ValidationError) -> str:
        """One line for the first problem: file, line, key path, what is wrong, what would be right."""
        loc, text = first_problem(error)
        key = dotted(loc)
        if any(key == path or key.startswith((f"{path}.", f"{path}[")) for path in self.overridden):
            return f"{self.path}, overridden on the command line: {key}: {text}"
        return f"{self.path}:{self.line(loc)}: {key}: {text}"

    def line(self, loc: Sequence[int | str]) -> int:
        """Line of a key, or of the innermost section round it that is there."""
        node = self.root
        for part in loc:
            child = _child(node, part)
            if child is None:
                break
            node = child
        return int(node.start_mark.line) + 1


def place(path: Path, loc: Sequence[int | str], value: object) -> str:
    """`FILE:LINE` of a key that has this value in the file; `FILE` where it has another, by override or default.

    A key that is missing has the value None.
    """
    try:
        document = YamlDocument.read(path)
    except InputError:
        return str(path)
    return f"{path}:{document.line(loc)}" if value_at(document.data, loc) == value else str(path)


def value_at(data: Any, loc: Sequence[int | str]) -> Any:
    """The value of a key in nested mappings and lists; None where it is missing."""
    for part in loc:
        if isinstance(data, dict):
            data = data.get(part)
        elif isinstance(data, list | tuple) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            return None
    return data


def put(data: dict[str, Any], key_path: str, value: Any) -> None:
    """Set one value of nested mappings, creating them on the way. Raises `InputError` where one is no mapping."""
    *sections, last = key_path.split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise InputError(f"{key_path}: '{section}' is not a section")
    data[last] = value


def wrong(key: str, text: str) -> PydanticCustomError:
    """An error for a validator of a whole section to raise, when the fault lies in one of its keys."""
    return PydanticCustomError("wrong_key", "{text}", {"key": key, "text": text})


def first_problem(error: ValidationError) -> tuple[tuple[int | str, ...], str]:
    """Place of the first problem, and what is wrong and what would be right; further ones are counted."""
    problems = error.errors(include_url=False)
    first = problems[0]
    loc = tuple(part for part in first["loc"] if not _is_union_label(part))
    if first["type"] == "wrong_key":
        loc = (*loc, *first["ctx"]["key"].split("."))
    return loc, _advice(first, loc) + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else "")


def _written_out(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Number of nodes that the node stands for; one that holds itself counts once."""
    if id(node) not in sizes:
        sizes[id(node)] = 1
        values = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        if isinstance(node, yaml.CollectionNode):
            sizes[id(node)] += sum(_written_out(value, sizes) for value in values)
    return sizes[id(node)]


def _child(node: yaml.Node, part: int | str) -> yaml.Node | None:
    if isinstance(node, yaml.MappingNode):
        for key_node, value_node in node.value:
            if key_node.value == str(part):
                return value_node if isinstance(value_node, yaml.ScalarNode) else _placed_at_key(key_node, value_node)
    if isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        item: yaml.Node = node.value[part]
        return item
    return None


def _placed_at_key(key_node: yaml.Node, value_node: yaml.Node) -> yaml.Node:
    """The value's node, placed at the line of its key (a block's own mark is the line after it)."""
    value_node.start_mark = key_node.start_mark
    return value_node


def _is_union_label(part: int | str) -> bool:
    """Pydantic puts the tried branch of a union into the path, e.g. 'constrained-tuple'."""
    return isinstance(part, str) and ("[" in part or part.startswith("constrained-"))


def dotted(loc: Sequence[int | str]) -> str:
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "(file)"


def _advice(problem: Any, loc: Sequence[int | str]) -> str:
    kind, given = problem["type"], problem.get("input")
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        return "is not a known key; `sandwich-sitl config --schema` lists the keys"
    if kind in ("missing", "missing_argument"):
        return "is missing; the list is too short" if loc and isinstance(loc[-1], int) else "is missing; add it"
    if kind == "too_short":
        return f"must have at least {problem['ctx']['min_length']} elements, has {problem['ctx']['actual_length']}"
    message = "must be a section of keys" if kind in ("dataclass_type", "dict_type") else _plain(problem["msg"])
    if kind in ("wrong_key", "value_error") and isinstance(given, dict | list | tuple):
        return str(message)
    shown = json.dumps(given, default=str)
    hint = _as_yaml_number(given) if kind in ("float_type", "int_type") else ""
    return f"{message}, got {shown if len(shown) <= 60 else shown[:57] + '...'}{hint}"


def _plain(message: str) -> str:
    """Pydantic's words as ours."""
    message = message.removeprefix("Value error, ").replace("Input should be", "must be")
    return message.replace("a valid integer", "a whole number").replace("a valid ", "a ")


def _as_yaml_number(given: object) -> str:
    """YAML 1.1 takes 1e9 for text: it asks for a dot and for a sign of the exponent."""
    try:
        value = float(given) if isinstance(given, str) else math.nan
    except ValueError:
        return ""
    if not math.isfinite(value):
        return ""
    text = repr(value)
    digits, exponent, power = text.partition("e")
    number = text if not exponent or "." in digits else f"{digits}.0e{power}"
    return f", which YAML 1.1 reads as text; write {number}"
