"""What is wrong with a YAML file, as one line for people: where, which key, and what would be right."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

Loc = Sequence[int | str]


@dataclass(frozen=True)
class Source:
    """A YAML file, and the dotted key paths that the command line put in the place of its own values."""

    path: Path
    root: yaml.Node
    overridden: tuple[str, ...]

    def place(self, loc: Loc) -> str:
        """`FILE:LINE` of a key, or of the innermost section round it; or that the value is not the file's."""
        key = dotted(loc)
        if any(key == path or key.startswith((f"{path}.", f"{path}[")) for path in self.overridden):
            return f"{self.path}, overridden on the command line"
        return f"{self.path}:{_line_of(self.root, loc)}"


def explain(error: ValidationError, prefix: tuple[str, ...]) -> tuple[tuple[int | str, ...], str]:
    """The first problem's place and the whole text with its key; further ones are counted."""
    problems = error.errors(include_url=False)
    first = problems[0]
    loc = (*prefix, *(part for part in first["loc"] if part not in ("float", "int")))
    distinct = {tuple(part for part in problem["loc"] if part not in ("float", "int")) for problem in problems}
    more = f" (and {len(distinct) - 1} more)" if len(distinct) > 1 else ""
    return loc, f"{dotted(loc)}: {_advice(first, loc)}{more}"


def dotted(loc: Loc) -> str:
    """A key path as people write it."""
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "(file)"


def _line_of(root: yaml.Node, loc: Loc) -> int:
    node, line = root, root.start_mark.line
    for part in loc:
        if isinstance(node, yaml.MappingNode):
            pairs = [(key, value) for key, value in node.value if key.value == str(part)]
            if not pairs:
                break
            line, node = pairs[-1][0].start_mark.line, pairs[-1][1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line
        else:
            break
    return int(line) + 1


def _advice(problem: Any, loc: Loc) -> str:
    if problem["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        return "is not a known key; remove it or mend its spelling"
    if problem["type"] in ("missing", "missing_argument"):
        return "is missing; the list is too short" if loc and isinstance(loc[-1], int) else "is missing; add it"
    context = problem.get("ctx", {})
    if problem["type"] == "too_short":
        return f"must have at least {context['min_length']} elements, has {context['actual_length']}"
    if problem["type"] in ("dataclass_type", "dict_type"):
        wanted = "must be a section of keys"
    else:
        wanted = problem["msg"].replace("Input should be", "must be").replace("a valid integer", "a whole number")
        wanted = wanted.replace("a valid ", "a ")
    shown = json.dumps(problem.get("input"), default=str)
    return f"{wanted}, got {shown if len(shown) <= 60 else shown[:57] + '...'}"
