"""Parts that fail on command or at a given time: motors, GPS, barometer, magnetometer, battery, and a step of wind.

Numbers are MAVLink's FAILURE_UNIT and FAILURE_TYPE; what they do to the vehicle is written into the kernel's constants.
"""

from typing import Literal, NamedTuple

from vehicle_sim.memory import Fields

OK, OFF, STUCK = 0, 1, 2
GYRO, ACCEL, MAG, BARO, GPS = 0, 1, 2, 3, 4
BATTERY, MOTOR = 100, 101
_SENSOR_BITS = {MAG: 1, BARO: 2, GPS: 4}
_STATUS_BITS = {MAG: 0x04, BARO: 0x08, GPS: 0x20}
Part = Literal["motor", "gps", "barometer", "magnetometer", "battery", "wind"]
_UNITS: dict[str, int] = {"motor": MOTOR, "gps": GPS, "barometer": BARO, "magnetometer": MAG, "battery": BATTERY}


class Failure(NamedTuple):
    """At `at_s` seconds since boot `part` fails (or is `ok` again). `instance`: motor 1 to 4, 0 for all."""

    at_s: float
    part: Part
    ok: bool = False
    instance: int = 0
    wind_enu_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)


class SensorsLost(NamedTuple):
    """From `t_s` on (seconds since boot) the sensors of these bits (`sensing`) are lost, and no others."""

    t_s: float
    bits: int


class Failures:
    """What has failed so far, and what is to fail. `history` has every change of the sensors that are there."""

    def __init__(self, plan: tuple[Failure, ...], flight: Fields, constants: Fields) -> None:
        self._due = sorted(plan, key=lambda failure: failure.at_s)
        self._flight, self._constants = flight, constants
        self._t_s = 0.0
        self.sensors_lost = 0
        self.history: list[SensorsLost] = []

    @property
    def health_bits_lost(self) -> int:
        """MAV_SYS_STATUS_SENSOR bits that are no longer healthy."""
        return sum(bit for unit, bit in _STATUS_BITS.items() if self.sensors_lost & _SENSOR_BITS[unit])

    @property
    def gps_lost(self) -> bool:
        """No position can be estimated any more."""
        return bool(self.sensors_lost & _SENSOR_BITS[GPS])

    @property
    def height_lost(self) -> bool:
        """Neither barometer nor GPS tell a height."""
        return not ~self.sensors_lost & (_SENSOR_BITS[BARO] | _SENSOR_BITS[GPS])

    def update(self, t_s: float) -> None:
        """Carry out what is due."""
        self._t_s = t_s
        while self._due and self._due[0].at_s <= t_s:
            failure = self._due.pop(0)
            if failure.part == "wind":
                east, north, up = failure.wind_enu_mps
                self._constants.wind_mean[:] = (north, east, -up)
            else:
                self.inject(_UNITS[failure.part], OK if failure.ok else OFF, failure.instance)

    def inject(self, unit: int | None, kind: int | None, instance: int) -> bool:
        """False when this vehicle cannot fail in that way."""
        if kind not in (OK, OFF):
            return False
        if unit == MOTOR and 0 <= instance <= 4:
            chosen = slice(None) if instance == 0 else slice(instance - 1, instance)
            self._constants.motor_health[chosen] = 1.0 if kind == OK else 0.0
            return True
        if unit == BATTERY and kind == OFF:
            self._flight.battery[0] = 0.0
            return True
        bit = _SENSOR_BITS.get(-1 if unit is None else unit)
        if bit is None:
            return False
        lost = self.sensors_lost | bit if kind == OFF else self.sensors_lost & ~bit
        if lost != self.sensors_lost:
            self.sensors_lost = lost
            self.history.append(SensorsLost(self._t_s, lost))
            self._constants.put("sensors_lost", lost)
        return True
