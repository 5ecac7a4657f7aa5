"""Lithium-polymer pack: state of charge, open-circuit voltage and sag.

d charge / dt = -I / (3600 capacity)        V = cells OCV(charge) - R I        I = I_base + sum c k omega^3 / (efficiency V)
"""

from typing import NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.parts import BatteryConfig
from vehicle_sim.rotors import Four, RotorModel

_CHARGE = (0.0, 0.05, 0.15, 0.5, 0.85, 1.0)
_CELL_V = (3.0, 3.45, 3.6, 3.78, 4.0, 4.18)
#: Cell voltage above which the rotors reach their full speed; below it their top speed falls in proportion.
_FULL_SPEED_CELL_V = 3.5


class BatteryState(NamedTuple):
    """Charge 0..1, terminal voltage and current, and what has been drawn since boot."""

    charge: float
    voltage_v: float
    current_a: float
    consumed_ah: float


class Pack(NamedTuple):
    """Numbers of the pack, taken from the configuration once."""

    cells: float
    capacity_ah: float
    resistance_ohm: float
    base_current_a: float
    efficiency: float

    @classmethod
    def of(cls, config: BatteryConfig) -> "Pack":
        """The pack of a configuration."""
        return cls(
            float(config.cells),
            config.capacity_ah,
            config.internal_resistance_ohm,
            config.base_current_a,
            config.efficiency,
        )


@inlined
def open_circuit_cell_v(charge: float) -> float:
    """Resting voltage of a cell, piecewise linear in the state of charge."""
    charge = max(0.0, min(1.0, charge))
    i = 1
    while i < 5 and charge >= _CHARGE[i]:
        i += 1
    share = (charge - _CHARGE[i - 1]) / (_CHARGE[i] - _CHARGE[i - 1])
    return _CELL_V[i - 1] + share * (_CELL_V[i] - _CELL_V[i - 1])


def fresh_battery(config: BatteryConfig) -> BatteryState:
    """At rest, at the configured charge."""
    return BatteryState(config.initial_charge, config.cells * open_circuit_cell_v(config.initial_charge), 0.0, 0.0)


@inlined
def step_battery(state: BatteryState, speeds_radps: Four, rotors: RotorModel, pack: Pack, dt_s: float) -> BatteryState:
    """Draw the current of the turning rotors for `dt_s`; an empty pack stays at zero charge."""
    a, b, c, d = speeds_radps
    cubes = a * a * a + b * b * b + c * c * c + d * d * d
    shaft_w = rotors.torque_coefficient_m * rotors.thrust_coefficient * cubes
    current_a = pack.base_current_a + shaft_w / (pack.efficiency * max(1.0, state.voltage_v))
    drawn_ah = current_a * dt_s / 3600.0
    charge = max(0.0, state.charge - drawn_ah / pack.capacity_ah)
    voltage_v = pack.cells * open_circuit_cell_v(charge) - pack.resistance_ohm * current_a
    return BatteryState(charge, max(0.0, voltage_v), current_a, state.consumed_ah + drawn_ah)


@inlined
def top_speed_fraction(voltage_v: float, cells: float) -> float:
    """Rotor top speed at this voltage over that of a full pack."""
    return min(1.0, voltage_v / (cells * _FULL_SPEED_CELL_V))
