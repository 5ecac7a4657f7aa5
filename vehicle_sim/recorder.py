"""`vehicle.mcap`: the truth, the vehicle's own telemetry, its texts and every frame, on the vehicle's clock.

log_time is nanoseconds since boot. Frames are one message each, encoding "mavlink". The file is chunked and flushed after its first
message and then every `flush_s` of wall time, so that a killed process leaves a readable log.
"""

import json
from pathlib import Path
from time import monotonic
from typing import BinaryIO

from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from vehicle_sim.autopilot.results import Severity, Text
from vehicle_sim.config import RunConfig, run_as_dict
from vehicle_sim.errors import VehicleError
from vehicle_sim.proto.vehicle_telemetry_pb2 import VehicleTelemetry
from vehicle_sim.protocol.node import Journal
from vehicle_sim.samples import Sample, SampleEncoder, set_stamp
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
        self._encoder = SampleEncoder(config.start_m)
        self._flush_s = config.logging.flush_s
        self._flushed_s: float | None = None
        self._samples: list[Sample] = []
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
        """Take the truth now, and with it the vehicle's telemetry every second time; `write` encodes it."""
        self._samples.append(Sample.of(vehicle, telemetry_too))

    def write(self, journal: Journal) -> None:
        """Empty the journal and the samples into the file, in order of time."""
        entries = [(t_us, self._received, frame) for t_us, frame in journal.received]
        for sample in self._samples:
            entries.append((sample.t_us, self._truth, self._encoder.pose(sample)))
            if sample.controls is not None:
                data = self._encoder.telemetry(sample.t_us, sample.truth, sample.controls)
                entries.append((sample.t_us, self._telemetry, data))
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
    set_stamp(entry.timestamp, t_us)
    data: bytes = entry.SerializeToString()
    return data
