"""What the vehicle promises, as tables for the terminal: `--contract` and `--parameters`."""

from collections.abc import Iterable, Sequence

from vehicle_sim.autopilot.contract import TABLE, Fact
from vehicle_sim.autopilot.failsafe import FAILSAFES
from vehicle_sim.autopilot.modes import MODE_TABLE, Mode, Need
from vehicle_sim.autopilot.parameters import TABLE as PARAMETERS


def contract_text() -> str:
    """Events and what they are answered with, modes, failsafes."""
    events = [
        (
            row.event.value,
            _names(row.needs) or "-",
            _names(row.without) or "-",
            row.result.name if row.result is not None else "-",
            row.effect.value,
            row.text or "-",
        )
        for row in TABLE
    ]
    modes = [
        (
            MODE_TABLE[mode].label,
            f"{mode.value[0]}/{mode.value[1]}",
            f"0x{mode.custom_mode:08X}",
            str(MODE_TABLE[mode].base_mode),
            _need_names(MODE_TABLE[mode].needs) or "-",
            "yes" if MODE_TABLE[mode].can_arm else "no",
        )
        for mode in Mode
    ]
    failsafes = [
        (
            row.reason.value,
            f"{row.parameter} = {row.value}",
            row.action.name if row.fallback is None else f"{MODE_TABLE[row.fallback].label}, else as NAV_RCL_ACT",
        )
        for row in FAILSAFES
    ]
    return "\n\n".join(
        (
            "Events: the first row of an event whose facts hold answers it\n"
            + table(("event", "needs", "without", "result", "effect", "text"), events),
            "Modes: numbers, HEARTBEAT fields (disarmed), what they need, whether arming is possible in them\n"
            + table(("mode", "main/sub", "custom_mode", "base_mode", "needs", "arm"), modes),
            "Failsafes: the most severe action wins; what cannot be flown gives way to Hold, Return, Land, Descend\n"
            + table(("cause", "parameter", "action"), failsafes),
        )
    )


def parameters_text() -> str:
    """Name, type, default, range, unit and meaning of every parameter."""
    rows = [
        (
            spec.name,
            "INT32" if spec.is_integer else "FLOAT",
            f"{spec.default:g}",
            f"{spec.low:g} .. {spec.high:g}",
            spec.unit or "-",
            spec.meaning,
        )
        for spec in PARAMETERS.values()
    ]
    return table(("name", "type", "default", "range", "unit", "meaning"), rows)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Columns aligned with spaces."""
    lines = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    texts = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines]
    return "\n".join([texts[0], "  ".join("-" * width for width in widths), *texts[1:]])


def _names(facts: Fact) -> str:
    return ", ".join(str(fact.name).lower().replace("_", " ") for fact in Fact if fact & facts)


def _need_names(needs: Need) -> str:
    return ", ".join(str(need.name).lower().replace("_", " ") for need in Need if need & needs)
