"""What is recorded of the vehicle's state: taken at its instant, encoded later, when nobody waits for the vehicle.

`Sample` holds numbers only. `SampleEncoder` keeps one protobuf message of each kind and overwrites it, which costs a fraction of building
one anew; fields that are zero are left out by protobuf in either case.
"""

from typing import Any, NamedTuple

from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from vehicle_sim.autopilot.setpoints import TrajectorySetpoint
from vehicle_sim.battery import BatteryState
from vehicle_sim.dynamics import State
from vehicle_sim.proto.vehicle_telemetry_pb2 import VehicleTelemetry
from vehicle_sim.rotation import enu_flu_from_ned_frd, euler_from_quaternion
from vehicle_sim.vehicle import Vehicle


class Controls(NamedTuple):
    """Estimate (13, layout of `State`), what is asked for, rotors (4,), wind (3,), battery, and where the autopilot's states stand."""

    estimate: list[float]
    setpoint: TrajectorySetpoint
    thrust_demand: float
    rotors_radps: list[float]
    wind_ned_mps: list[float]
    battery: BatteryState
    mode: str
    armed: bool
    landed: bool
    failsafe: bool


class Sample(NamedTuple):
    """One instant: microseconds since boot, the truth and, every second time, the rest."""

    t_us: int
    truth: State
    controls: Controls | None

    @classmethod
    def of(cls, vehicle: Vehicle, with_controls: bool) -> "Sample":
        """The vehicle now."""
        return cls(vehicle.t_us, vehicle.state, _controls(vehicle) if with_controls else None)


def _controls(vehicle: Vehicle) -> Controls:
    flight, pilot = vehicle.flight, vehicle.autopilot
    return Controls(
        flight.estimate.tolist(),
        pilot.setpoint,
        float(flight.demand[0]),
        flight.rotors.tolist(),
        flight.wind.tolist(),
        vehicle.battery,
        pilot.commander.flown_mode.name,
        pilot.commander.armed,
        pilot.landed,
        pilot.commander.decision.reason is not None,
    )


def set_stamp(timestamp: Any, t_us: int) -> None:
    """A protobuf Timestamp of microseconds since boot."""
    timestamp.seconds, timestamp.nanos = t_us // 1_000_000, t_us % 1_000_000 * 1000


class SampleEncoder:
    """Protobuf payloads of samples; the world's ENU origin lies `start_m` (x, y) before the vehicle's."""

    def __init__(self, start_m: tuple[float, float]) -> None:
        self._start_m = start_m
        self._pose = PoseInFrame(frame_id="map")
        self._telemetry = VehicleTelemetry()

    def pose(self, sample: Sample) -> bytes:
        """The truth as PoseInFrame: world ENU, start_m + local, z up; body FLU."""
        x, message = sample.truth, self._pose
        set_stamp(message.timestamp, sample.t_us)
        place, turn = message.pose.position, message.pose.orientation
        place.x, place.y, place.z = self._start_m[0] + x.e, self._start_m[1] + x.n, -x.d
        turn.w, turn.x, turn.y, turn.z = enu_flu_from_ned_frd(x.q_wb_wxyz)
        data: bytes = message.SerializeToString()
        return data

    def telemetry(self, t_us: int, x: State, controls: Controls) -> bytes:
        """VehicleTelemetry, NED/FRD."""
        m = self._telemetry
        m.time_s = t_us * 1e-6
        m.position_north_m, m.position_east_m, m.position_down_m = x.position_ned_m
        m.velocity_north_mps, m.velocity_east_mps, m.velocity_down_mps = x.velocity_ned_mps
        m.roll_rad, m.pitch_rad, m.yaw_rad = euler_from_quaternion(x.q_wb_wxyz)
        m.rate_roll_radps, m.rate_pitch_radps, m.rate_yaw_radps = x.omega_wb_b_radps
        e = controls.estimate
        m.estimate_north_m, m.estimate_east_m, m.estimate_down_m = e[0:3]
        m.estimate_velocity_north_mps, m.estimate_velocity_east_mps, m.estimate_velocity_down_mps = e[3:6]
        m.setpoint_north_m, m.setpoint_east_m, m.setpoint_down_m = controls.setpoint.position_ned_m
        m.setpoint_yaw_rad, m.thrust_demand = controls.setpoint.yaw_rad, controls.thrust_demand
        m.rotor_1_radps, m.rotor_2_radps, m.rotor_3_radps, m.rotor_4_radps = controls.rotors_radps
        m.wind_north_mps, m.wind_east_mps, m.wind_down_mps = controls.wind_ned_mps
        battery = controls.battery
        m.battery_voltage_v, m.battery_current_a, m.battery_charge = (
            battery.voltage_v,
            battery.current_a,
            battery.charge,
        )
        m.mode, m.armed, m.landed, m.failsafe = controls.mode, controls.armed, controls.landed, controls.failsafe
        return m.SerializeToString()
