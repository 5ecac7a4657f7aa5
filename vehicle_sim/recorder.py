"""`vehicle.mcap`: the truth, the vehicle's own telemetry, its texts and every frame, on the vehicle's clock.

log_time is nanoseconds since boot. Frames are one message each, encoding "mavlink". The file is chunked and flushed after its first
message and then every `flush_s` of wall time, so that a killed process leaves a readable log.
"""

import json
from pathlib import Path
from time import monotonic
from typing import Any, BinaryIO

from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from vehicle_sim.autopilot.results import Severity, Text
from vehicle_sim.config import RunConfig, run_as_dict
from vehicle_sim.errors import VehicleError
from vehicle_sim.proto.vehicle_telemetry_pb2 import VehicleTelemetry
from vehicle_sim.protocol.node import Journal
from vehicle_sim.rotation import enu_flu_from_ned_frd, euler_from_quaternion
from vehicle_sim.vehicle import Vehicle

_LEVELS = {
    Severity.EMERGENCY: Log.FATAL,
    Severity.CRITICAL: Log.ERROR,
    Severity.WARNING: Log.WARNING,
    Severity.INFO: Log.INFO,
}
_CHUNK_BYTES = 256 * 1024


class Recorder:
    """Writes one file; `close` completes it."""

    def __init__(self, path: Path, config: RunConfig) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = path.open("wb")
        except OSError as error:
            raise VehicleError(f"--log {path}: cannot be written ({error.strerror}); give a path that can") from error
        self._start_m = config.start_m
        self._flush_s = config.logging.flush_s
        self._flushed_s: float | None = None
        self._samples: list[tuple[int, int, bytes]] = []
        writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="", library="vehicle-sim")
        self._writer = writer
        pose, log, own = (register_schema(writer, kind) for kind in (PoseInFrame, Log, VehicleTelemetry))
        frame = writer.register_schema("mavlink", "mavlink", b"")
        dialect = {"dialect": "common", "mavlink": "2"}
        self._truth = writer.register_channel("/state/truth", "protobuf", pose)
        self._telemetry = writer.register_channel("/vehicle/telemetry", "protobuf", own)
        self._log = writer.register_channel("/vehicle/log", "protobuf", log)
        self._sent = writer.register_channel("/vehicle/mavlink/tx", "mavlink", frame, dialect)
        self._received = writer.register_channel("/vehicle/mavlink/rx", "mavlink", frame, dialect)
        writer.add_metadata("vehicle", {"seed": str(config.seed), "configuration": json.dumps(run_as_dict(config))})

    def sample(self, vehicle: Vehicle, telemetry_too: bool) -> None:
        """The truth now, and with it the vehicle's telemetry every second time."""
        t_us = vehicle.t_us
        self._samples.append((t_us, self._truth, _pose(vehicle, self._start_m)))
        if telemetry_too:
            self._samples.append((t_us, self._telemetry, _telemetry(vehicle)))

    def write(self, journal: Journal) -> None:
        """Empty the journal and the samples into the file, in order of time."""
        entries = [(t_us, self._received, frame) for t_us, frame in journal.received]
        entries += self._samples
        entries += [(t_us, self._log, _log_entry(t_us, text)) for t_us, text in journal.texts]
        entries += [(t_us, self._sent, frame) for t_us, frame in journal.sent]
        entries.sort(key=lambda entry: entry[0])
        for t_us, channel, data in entries:
            self._writer.add_message(channel, t_us * 1000, data, t_us * 1000)
        self._samples.clear()
        journal.clear()
        if entries:
            self._flush_when_due()

    def close(self) -> None:
        """Write the summary and close."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _flush_when_due(self) -> None:
        now_s = monotonic()
        if self._flushed_s is None or now_s - self._flushed_s >= self._flush_s:
            self._flushed_s = now_s
            self._writer.flush()  # type: ignore[no-untyped-call]


def _log_entry(t_us: int, text: Text) -> bytes:
    entry = Log(level=_LEVELS[text.severity], message=text.text, name="vehicle", file="", line=0)
    _stamp(entry.timestamp, t_us)
    data: bytes = entry.SerializeToString()
    return data


def _pose(vehicle: Vehicle, start_m: tuple[float, float]) -> bytes:
    """World ENU: start_m + local, z up; body FLU."""
    x = vehicle.state
    w, i, j, k = enu_flu_from_ned_frd(x.q_wb_wxyz)
    message = PoseInFrame(frame_id="map")
    _stamp(message.timestamp, vehicle.t_us)
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = start_m[0] + x.e, start_m[1] + x.n, -x.d
    orientation.w, orientation.x, orientation.y, orientation.z = w, i, j, k
    data: bytes = message.SerializeToString()
    return data


def _telemetry(vehicle: Vehicle) -> bytes:
    x, estimate, pilot = vehicle.state, vehicle.estimate, vehicle.autopilot
    angles = euler_from_quaternion(x.q_wb_wxyz)
    setpoint, speeds, wind, battery = pilot.setpoint, vehicle.speeds_radps, vehicle.wind_ned_mps, vehicle.battery
    return VehicleTelemetry(
        time_s=vehicle.t_s,
        position_north_m=x.n,
        position_east_m=x.e,
        position_down_m=x.d,
        velocity_north_mps=x.vn,
        velocity_east_mps=x.ve,
        velocity_down_mps=x.vd,
        roll_rad=angles.roll_rad,
        pitch_rad=angles.pitch_rad,
        yaw_rad=angles.yaw_rad,
        rate_roll_radps=x.p,
        rate_pitch_radps=x.q,
        rate_yaw_radps=x.r,
        estimate_north_m=estimate.position_ned_m[0],
        estimate_east_m=estimate.position_ned_m[1],
        estimate_down_m=estimate.position_ned_m[2],
        estimate_velocity_north_mps=estimate.velocity_ned_mps[0],
        estimate_velocity_east_mps=estimate.velocity_ned_mps[1],
        estimate_velocity_down_mps=estimate.velocity_ned_mps[2],
        setpoint_north_m=setpoint.position_ned_m[0],
        setpoint_east_m=setpoint.position_ned_m[1],
        setpoint_down_m=setpoint.position_ned_m[2],
        setpoint_yaw_rad=setpoint.yaw_rad,
        thrust_demand=float(vehicle.flight.demand[0]),
        rotor_1_radps=speeds[0],
        rotor_2_radps=speeds[1],
        rotor_3_radps=speeds[2],
        rotor_4_radps=speeds[3],
        wind_north_mps=wind[0],
        wind_east_mps=wind[1],
        wind_down_mps=wind[2],
        battery_voltage_v=battery.voltage_v,
        battery_current_a=battery.current_a,
        battery_charge=battery.charge,
        mode=pilot.commander.flown_mode.name,
        armed=pilot.commander.armed,
        landed=pilot.landed,
        failsafe=pilot.commander.decision.reason is not None,
    ).SerializeToString()


def _stamp(timestamp: Any, t_us: int) -> None:
    timestamp.seconds, timestamp.nanos = t_us // 1_000_000, t_us % 1_000_000 * 1000
