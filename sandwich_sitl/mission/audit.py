"""The PX4 parameters that decide what happens when this process dies. They are read and logged, never written.

Source: PX4's parameter reference (COM_OF_LOSS_T in seconds, COM_OBL_RC_ACT, NAV_RCL_ACT).
"""

from collections.abc import Mapping

_OFFBOARD_LOSS = {
    0: "Position",
    1: "Altitude",
    2: "Stabilized",
    3: "Return",
    4: "Land",
    5: "Hold",
    6: "Terminate",
    7: "Disarm",
}
_RC_LOSS = {0: "Disabled", 1: "Hold", 2: "Return", 3: "Land", 5: "Terminate", 6: "Disarm"}
_HARSH = ("Terminate", "Disarm")
_ACTIONS = {"COM_OBL_RC_ACT": _OFFBOARD_LOSS, "NAV_RCL_ACT": _RC_LOSS}

AUDITED = ("COM_OF_LOSS_T", *_ACTIONS)


def audit(parameters: Mapping[str, float]) -> tuple[str, ...]:
    """One line a parameter: its value and, where it is dangerous, what to do."""
    return tuple(_line(name, parameters.get(name)) for name in AUDITED)


def _line(name: str, value: float | None) -> str:
    if value is None:
        return f"{name} was not answered: what the autopilot does without this process is unknown"
    if name == "COM_OF_LOSS_T":
        advice = "" if 0.2 <= value <= 5.0 else "; set it between 0.2 and 5 s"
        return f"{name} = {value:g} s{advice}"
    action = _ACTIONS[name].get(int(value), "unknown action")
    advice = "; an aircraft that loses this process would fall, choose Return or Land" if action in _HARSH else ""
    return f"{name} = {int(value)} ({action}){advice}"
