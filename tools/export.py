"""Export a run's tracks: `python tools/export.py RUN.mcap --csv DIR | --parquet DIR | --tlog FILE`.

Each track becomes one table (`control`, `truth`, `estimate`, `mission`, `vehicle`, `wall_timing`, `log`); a vector
field becomes three columns `..._x_m`, `..._y_m`, `..._z_m`. Times are the vehicle's boot time in seconds.
"""

import argparse
import dataclasses
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from sandwich_sitl.errors import InputError, SandwichError
from sandwich_sitl.recording.messages import component_names
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.tlog import write_tlog


def main() -> int:
    """Returns the exit status: 0, or 2 on an unusable file or directory."""
    parser = argparse.ArgumentParser(description="Export a run as tables or as a MAVLink .tlog.")
    parser.add_argument("run", type=Path, metavar="RUN.mcap")
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument("--csv", type=Path, metavar="DIR")
    target.add_argument("--parquet", type=Path, metavar="DIR")
    target.add_argument("--tlog", type=Path, metavar="FILE")
    options = parser.parse_args()
    try:
        log = RunLog.read(options.run)
        if log.notice is not None:
            print(log.notice, file=sys.stderr)
        if options.tlog is not None:
            written = {options.tlog: write_tlog(log, options.tlog)}
        else:
            written = write_tables(log, options.csv or options.parquet, "csv" if options.csv else "parquet")
    except SandwichError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    except OSError as error:
        print(f"{error.filename}: cannot be written ({error.strerror})", file=sys.stderr)
        return InputError.exit_status
    for path, size in written.items():
        print(f"{path}: {size} {'bytes' if options.tlog else 'rows'}")
    return 0


def write_tables(log: RunLog, directory: Path, kind: str) -> dict[Path, int]:
    """Write every track that has rows; returns the number of rows of each file."""
    directory.mkdir(parents=True, exist_ok=True)
    written: dict[Path, int] = {}
    for name, columns in tables(log).items():
        table = pa.table(columns)
        if table.num_rows == 0:
            continue
        path = directory / f"{name}.{kind}"
        if kind == "csv":
            pyarrow.csv.write_csv(table, path)
        else:
            pyarrow.parquet.write_table(table, path)
        written[path] = table.num_rows
    return written


def tables(log: RunLog) -> dict[str, dict[str, Any]]:
    """Columns of each track by name."""
    tracks = {"control": log.control, "truth": log.truth, "estimate": log.estimate, "mission": log.mission}
    lines = {key: [getattr(line, key) for line in log.lines] for key in ("t_s", "level", "name", "message")}
    return {name: track_columns(track) for name, track in tracks.items()} | {
        "vehicle": dict(log.vehicle),
        "wall_timing": track_columns(log.timings),
        "log": lines,
    }


def track_columns(track: Any) -> dict[str, Any]:
    """A track's fields as flat columns."""
    columns: dict[str, Any] = {}
    for field in dataclasses.fields(track):
        values = getattr(track, field.name)
        if isinstance(values, np.ndarray) and values.ndim == 2:
            names = component_names(field.name) if values.shape[1] == 3 else [f"q_{axis}" for axis in "wxyz"]
            columns |= {name: values[:, axis] for axis, name in enumerate(names)}
        else:
            columns[field.name] = list(values) if isinstance(values, tuple) else values
    return columns


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` is no error
    sys.exit(main())
