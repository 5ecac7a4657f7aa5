"""Parameters: PX4's names, types, units and ranges (the table itself is in `parameter_table`), and their current values."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite

from vehicle_sim.autopilot.parameter_table import ROWS

Number = float | int


@dataclass(frozen=True)
class ParameterSpec:
    """One row: an `int` default makes an INT32, a `float` default a REAL32."""

    name: str
    default: Number
    low: Number
    high: Number
    unit: str
    meaning: str

    @property
    def is_integer(self) -> bool:
        """INT32 on the wire."""
        return isinstance(self.default, int)


def _specs() -> dict[str, ParameterSpec]:
    specs: dict[str, ParameterSpec] = {}
    for line in ROWS.strip().splitlines():
        name, kind, default, low, high, unit, meaning = line.split(maxsplit=6)
        number = int if kind == "i" else float
        limits = (number(default), number(low), number(high))
        specs[name] = ParameterSpec(name, *limits, "" if unit == "-" else unit, meaning)
    return specs


TABLE: Mapping[str, ParameterSpec] = _specs()


def find_parameter_problem(overrides: Mapping[str, Number]) -> tuple[str, str] | None:
    """The first override that cannot be used, as (name, advice); None when all are fine."""
    for name, value in overrides.items():
        spec = TABLE.get(name)
        if spec is None:
            return name, "is not a known parameter; `vehicle-sim --parameters` lists them all"
        if spec.is_integer and not isinstance(value, int):
            return name, f"must be a whole number, got {value}"
        if not isfinite(value) or not spec.low <= value <= spec.high:
            return name, f"must be between {spec.low} and {spec.high} {spec.unit}".rstrip() + f", got {value}"
    return None


class ParameterStore:
    """Current values by name, in the table's (alphabetical) order."""

    def __init__(self, overrides: Mapping[str, Number], hover_thrust: float) -> None:
        self._values: dict[str, Number] = {name: spec.default for name, spec in TABLE.items()}
        self._values["MPC_THR_HOVER"] = min(0.8, max(0.1, hover_thrust))
        for name, value in overrides.items():
            self._values[name] = int(value) if TABLE[name].is_integer else float(value)
        self.revision = 0

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def integer(self, name: str) -> int:
        """Value of an INT32 parameter."""
        return int(self._values[name])

    def value(self, name: str) -> Number:
        """Value with its own type."""
        return self._values[name]

    def set(self, name: str, value: Number) -> None:
        """Store a value of the right type; `revision` tells the controllers to read again."""
        self._values[name] = value
        self.revision += 1
