"""A client of a `Node`, without a socket: sends messages, collects what comes back."""

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.config import VehicleConfig
from vehicle_sim.parts import SensorsConfig
from vehicle_sim.protocol.codec import Codec
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

CLIENT, OTHER = "client", "other"
#: custom_mode
LOITER, TAKEOFF, RTL, LAND, OFFBOARD = 0x03040000, 0x02040000, 0x05040000, 0x06040000, 0x00060000
EXACT = SensorsConfig(
    estimator="error_model",
    estimate_position_std_m=0,
    estimate_velocity_std_mps=0,
    estimate_attitude_std_rad=0,
    gyroscope_std_radps=0,
)


class Client:
    """Talks to a node as one client would."""

    def __init__(self, node: Node, name: str = CLIENT, system: int = 245, component: int = 190) -> None:
        self.node, self.name = node, name
        self.mav = mavlink.MAVLink(None, system, component)
        self.codec = Codec(1)
        node.session(name)

    def send(self, message: Any) -> list[Any]:
        """Send, and return what comes back at once."""
        self.post(message)
        return self.receive()

    def post(self, message: Any) -> None:
        for received in self.codec.decode(message.pack(self.mav)):
            self.node.handle(self.name, received)

    def take(self) -> list[bytes]:
        """The frames that wait."""
        return self.node.take(self.node.session(self.name))

    def receive(self) -> list[Any]:
        return [received.message for frame in self.take() for received in self.codec.decode(frame)]

    def run(self, seconds: float) -> list[Any]:
        self.node.advance_to(self.node.vehicle.t_us + round(seconds * 1e6))
        return self.receive()

    def command(self, number: int, *parameters: float, system: int = 1) -> list[Any]:
        padded = [*parameters, *([0.0] * (7 - len(parameters)))]
        return self.send(mavlink.MAVLink_command_long_message(system, 1, number, 0, *padded))

    def results(self, number: int, *parameters: float) -> list[int]:
        return [m.result for m in self.command(number, *parameters) if m.get_type() == "COMMAND_ACK"]


def named(messages: list[Any], name: str) -> list[Any]:
    return [m for m in messages if m.get_type() == name]


def setpoint(
    position: tuple[float, float, float] = (0.0, 0.0, -3.0), mask: int = 0, frame: int = 1, system: int = 1
) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED with nothing but a position."""
    return mavlink.MAVLink_set_position_target_local_ned_message(0, system, 1, frame, mask, *position, *([0.0] * 8))


def gcs_heartbeat(kind: int = 6) -> Any:
    """HEARTBEAT of a ground station, or of something else."""
    return mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)


def stream(client: Client, seconds: float, message: Any = None, every_s: float = 0.05) -> list[Any]:
    """Time passes under a stream of set-points; what came back."""
    heard: list[Any] = []
    for _ in range(round(seconds / every_s)):
        heard += client.send(message or setpoint())
        heard += client.run(every_s)
    return heard


def in_offboard(client: Client) -> Client:
    """In the air under OFFBOARD at 3 m, as a ground station."""
    client.send(gcs_heartbeat())
    stream(client, 4.6)
    assert client.results(176, 1, 6, 0) == [0, 0]
    assert client.results(400, 1) == [0]
    client.send(gcs_heartbeat())
    stream(client, 7.0)
    assert client.node.vehicle.state.d < -2.5
    return client


def new_client(**config: Any) -> Client:
    return Client(Node(Vehicle(VehicleConfig(**{"sensors": EXACT, **config}), 1), lockstep=False))


def texts(messages: list[Any]) -> list[str]:
    joined: list[str] = []
    for m in named(messages, "STATUSTEXT"):
        if m.chunk_seq:
            joined[-1] += m.text
        else:
            joined.append(m.text)
    return joined


def beat(messages: list[Any]) -> tuple[int, int, int]:
    """(custom_mode, base_mode, system_status) of the last HEARTBEAT."""
    last = named(messages, "HEARTBEAT")[-1]
    return last.custom_mode, last.base_mode, last.system_status
