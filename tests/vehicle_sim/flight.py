"""A vehicle flown in OFFBOARD without a protocol round it."""

from collections.abc import Callable

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.setpoints import SetpointMessage
from vehicle_sim.config import VehicleConfig
from vehicle_sim.vehicle import Vehicle

STILL = (0.0, 0.0, 0.0)


class Flight:
    """OFFBOARD at 3 m, set-points every 20 ms."""

    def __init__(self, seed: int = 1, **config: object) -> None:
        self.vehicle = Vehicle(VehicleConfig(**config), seed)  # type: ignore[arg-type]

    def run(
        self,
        seconds: float,
        place: tuple[float, float, float] = (0.0, 0.0, -3.0),
        each: Callable[[], object] | None = None,
    ) -> None:
        vehicle = self.vehicle
        for _ in range(round(seconds / 0.02)):
            vehicle.autopilot.receive_setpoint(SetpointMessage(1, 0, place, STILL, STILL, 0.0, 0.0), vehicle.estimate)
            vehicle.advance(8)
            if each is not None:
                each()

    def take_off(self) -> "Flight":
        self.run(4.6)
        self.vehicle.autopilot.request_mode(Mode.OFFBOARD)
        self.vehicle.autopilot.request_arm()
        self.run(7.0)
        assert self.vehicle.state.d < -2.5
        return self
