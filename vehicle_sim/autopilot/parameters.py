"""The parameter table: PX4's names, types, units and ranges, with defaults of this airframe.

Defaults that differ from PX4's generic ones are what its airframe files set too: the position and velocity gains and the
attitude gains are tuned to an x500-class vehicle. `MPC_THR_HOVER` is set from the airframe at boot.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite

Number = float | int


@dataclass(frozen=True)
class ParameterSpec:
    """One row: an `int` default makes an INT32, a `float` default a REAL32."""

    name: str
    default: Number
    low: Number
    high: Number
    unit: str

    @property
    def is_integer(self) -> bool:
        """INT32 on the wire."""
        return isinstance(self.default, int)


def _row(name: str, default: Number, low: Number, high: Number, unit: str = "") -> ParameterSpec:
    return ParameterSpec(name, default, low, high, unit)


_ROWS = (
    _row("BAT1_CAPACITY", 5000.0, -1.0, 100000.0, "mAh"),
    _row("BAT1_N_CELLS", 4, 0, 16),
    _row("BAT_CRIT_THR", 0.07, 0.05, 0.5, "norm"),
    _row("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "norm"),
    _row("BAT_LOW_THR", 0.15, 0.12, 0.5, "norm"),
    _row("COM_ARM_WO_GPS", 1, 0, 2),
    _row("COM_DISARM_LAND", 2.0, -1.0, 20.0, "s"),
    _row("COM_DISARM_PRFLT", 10.0, -1.0, 300.0, "s"),
    _row("COM_DL_LOSS_T", 10, 5, 300, "s"),
    _row("COM_LOW_BAT_ACT", 0, 0, 3),
    _row("COM_OBL_RC_ACT", 0, 0, 7),
    _row("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "s"),
    _row("COM_RCL_EXCEPT", 0, 0, 31),
    _row("COM_RC_IN_MODE", 3, 0, 4),
    _row("COM_RC_LOSS_T", 0.5, 0.0, 35.0, "s"),
    _row("COM_RC_OVERRIDE", 1, 0, 3),
    _row("COM_RC_STICK_OV", 30.0, 5.0, 80.0, "%"),
    _row("COM_SPOOLUP_TIME", 1.0, 0.0, 30.0, "s"),
    _row("GF_ACTION", 2, 0, 5),
    _row("GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "m"),
    _row("GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "m"),
    _row("LNDMC_TRIG_TIME", 1.0, 0.1, 10.0, "s"),
    _row("LNDMC_XY_VEL_MAX", 1.5, 0.0, 10.0, "m/s"),
    _row("LNDMC_Z_VEL_MAX", 0.25, 0.0, 5.0, "m/s"),
    _row("MAV_COMP_ID", 1, 1, 250),
    _row("MAV_SYS_ID", 1, 1, 250),
    _row("MAV_TYPE", 2, 0, 22),
    _row("MC_ACRO_P_MAX", 100.0, 0.0, 1800.0, "deg/s"),
    _row("MC_ACRO_R_MAX", 100.0, 0.0, 1800.0, "deg/s"),
    _row("MC_ACRO_Y_MAX", 100.0, 0.0, 1800.0, "deg/s"),
    _row("MC_PITCHRATE_D", 0.003, 0.0, 0.1),
    _row("MC_PITCHRATE_FF", 0.0, 0.0, 1.0),
    _row("MC_PITCHRATE_I", 0.2, 0.0, 2.0),
    _row("MC_PITCHRATE_K", 1.0, 0.01, 5.0),
    _row("MC_PITCHRATE_MAX", 220.0, 0.0, 1800.0, "deg/s"),
    _row("MC_PITCHRATE_P", 0.15, 0.01, 0.6),
    _row("MC_PITCH_P", 9.0, 0.0, 12.0, "1/s"),
    _row("MC_PR_INT_LIM", 0.3, 0.0, 1.0),
    _row("MC_ROLLRATE_D", 0.003, 0.0, 0.1),
    _row("MC_ROLLRATE_FF", 0.0, 0.0, 1.0),
    _row("MC_ROLLRATE_I", 0.2, 0.0, 2.0),
    _row("MC_ROLLRATE_K", 1.0, 0.01, 5.0),
    _row("MC_ROLLRATE_MAX", 220.0, 0.0, 1800.0, "deg/s"),
    _row("MC_ROLLRATE_P", 0.15, 0.01, 0.5),
    _row("MC_ROLL_P", 9.0, 0.0, 12.0, "1/s"),
    _row("MC_RR_INT_LIM", 0.3, 0.0, 1.0),
    _row("MC_YAWRATE_D", 0.0, 0.0, 0.1),
    _row("MC_YAWRATE_FF", 0.0, 0.0, 1.0),
    _row("MC_YAWRATE_I", 0.1, 0.0, 2.0),
    _row("MC_YAWRATE_K", 1.0, 0.0, 5.0),
    _row("MC_YAWRATE_MAX", 200.0, 0.0, 1800.0, "deg/s"),
    _row("MC_YAWRATE_P", 0.4, 0.0, 0.6),
    _row("MC_YAW_P", 2.0, 0.0, 5.0, "1/s"),
    _row("MC_YAW_WEIGHT", 0.4, 0.0, 1.0),
    _row("MC_YR_INT_LIM", 0.3, 0.0, 1.0),
    _row("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "m"),
    _row("MPC_ACC_DOWN_MAX", 3.0, 2.0, 15.0, "m/s^2"),
    _row("MPC_ACC_HOR", 3.0, 2.0, 15.0, "m/s^2"),
    _row("MPC_ACC_UP_MAX", 4.0, 2.0, 15.0, "m/s^2"),
    _row("MPC_LAND_ALT1", 10.0, 0.0, 122.0, "m"),
    _row("MPC_LAND_ALT2", 5.0, 0.0, 122.0, "m"),
    _row("MPC_LAND_SPEED", 0.7, 0.6, 5.0, "m/s"),
    _row("MPC_MAN_Y_MAX", 150.0, 0.0, 400.0, "deg/s"),
    _row("MPC_THR_HOVER", 0.5, 0.1, 0.8, "norm"),
    _row("MPC_THR_MAX", 1.0, 0.0, 1.0, "norm"),
    _row("MPC_THR_MIN", 0.06, 0.01, 0.5, "norm"),
    _row("MPC_THR_XY_MARG", 0.3, 0.0, 0.5, "norm"),
    _row("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "deg"),
    _row("MPC_TILTMAX_LND", 12.0, 10.0, 89.0, "deg"),
    _row("MPC_TKO_RAMP_T", 1.0, 0.0, 5.0, "s"),
    _row("MPC_TKO_SPEED", 1.5, 1.0, 5.0, "m/s"),
    _row("MPC_VEL_MANUAL", 10.0, 3.0, 20.0, "m/s"),
    _row("MPC_XY_CRUISE", 5.0, 3.0, 20.0, "m/s"),
    _row("MPC_XY_P", 1.8, 0.0, 2.0, "1/s"),
    _row("MPC_XY_VEL_D_ACC", 0.2, 0.1, 2.0),
    _row("MPC_XY_VEL_I_ACC", 2.0, 0.0, 60.0),
    _row("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "m/s"),
    _row("MPC_XY_VEL_P_ACC", 4.0, 1.2, 5.0),
    _row("MPC_Z_P", 1.5, 0.1, 1.5, "1/s"),
    _row("MPC_Z_VEL_D_ACC", 0.0, 0.0, 2.0),
    _row("MPC_Z_VEL_I_ACC", 2.0, 0.2, 3.0),
    _row("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "m/s"),
    _row("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "m/s"),
    _row("MPC_Z_VEL_P_ACC", 5.0, 2.0, 15.0),
    _row("MPC_Z_V_AUTO_DN", 1.5, 0.5, 4.0, "m/s"),
    _row("MPC_Z_V_AUTO_UP", 3.0, 0.5, 8.0, "m/s"),
    _row("NAV_ACC_RAD", 2.0, 0.05, 200.0, "m"),
    _row("NAV_DLL_ACT", 0, 0, 6),
    _row("NAV_MC_ALT_RAD", 0.8, 0.05, 200.0, "m"),
    _row("NAV_RCL_ACT", 2, 1, 6),
    _row("RTL_DESCEND_ALT", 30.0, 0.0, 100.0, "m"),
    _row("RTL_LAND_DELAY", 0.0, -1.0, 600.0, "s"),
    _row("RTL_MIN_DIST", 10.0, 0.5, 100.0, "m"),
    _row("RTL_RETURN_ALT", 30.0, 0.0, 150.0, "m"),
    _row("SYS_AUTOSTART", 4001, 0, 9999999),
    _row("SYS_FAILURE_EN", 0, 0, 1),
    _row("SYS_HITL", 2, -1, 2),
)

TABLE: Mapping[str, ParameterSpec] = {row.name: row for row in _ROWS}


def find_parameter_problem(overrides: Mapping[str, Number]) -> tuple[str, str] | None:
    """The first override that cannot be used, as (name, advice); None when all are fine."""
    for name, value in overrides.items():
        spec = TABLE.get(name)
        if spec is None:
            return name, "is not a known parameter; the vehicle's PARAM_REQUEST_LIST names them all"
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
