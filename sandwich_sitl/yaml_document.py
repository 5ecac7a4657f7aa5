"""A YAML mapping that knows its lines, and pydantic's complaints about it as one line for people."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from sandwich_sitl.errors import InputError

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
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(
                f"{path}: cannot be read ({error.strerror}); give the path of a run's YAML file"
            ) from error
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: is not UTF-8 text; save it as UTF-8") from error
        try:
            data = yaml.load(text, Loader=_UniqueKeyLoader)
            root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            raise InputError(f"{path}:{line}: is not valid YAML: {error.problem}") from error
        except yaml.YAMLError as error:
            raise InputError(f"{path}: is not valid YAML: {' '.join(str(error).split())}") from error
        if not isinstance(data, dict) or root is None:
            raise InputError(f"{path}: must be a mapping of keys such as world, start_m, goal_m")
        return cls(path, data, root)

    def set(self, key_path: str, value: Any) -> None:
        """Override one value, creating sections on the way."""
        *sections, last = key_path.split(".")
        target = self.data
        for section in sections:
            target = target.setdefault(section, {})
            if not isinstance(target, dict):
                raise InputError(f"{self.path}: {key_path}: '{section}' is not a section")
        target[last] = value
        self.overridden.append(key_path)

    def describe(self, error: ValidationError) -> str:
        """One line for the first problem: file, line, key path, what is wrong, what would be right."""
        problems = error.errors(include_url=False)
        first = problems[0]
        loc = tuple(part for part in first["loc"] if not _is_union_label(part))
        key = _dotted(loc)
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        if any(key.startswith(path) for path in self.overridden):
            return f"{self.path}, overridden on the command line: {key}: {_advice(first)}{more}"
        return f"{self.path}:{self._line(loc)}: {key}: {_advice(first)}{more}"

    def _line(self, loc: Sequence[int | str]) -> int:
        node = self.root
        for part in loc:
            child = _child(node, part)
            if child is None:
                break
            node = child
        return int(node.start_mark.line) + 1


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


def _dotted(loc: Sequence[int | str]) -> str:
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "(file)"


def _advice(problem: Any) -> str:
    kind, given = problem["type"], problem.get("input")
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        return "is not a known key; `sandwich-sitl config --schema` lists the keys"
    if kind in ("missing", "missing_argument"):
        return "is missing; add it (its unit is the end of its name)"
    shown = json.dumps(given, default=str)
    return f"{problem['msg']}, got {shown if len(shown) <= 60 else shown[:57] + '...'}"
