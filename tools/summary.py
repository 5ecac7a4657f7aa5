"""Print the summary of one run: `python tools/summary.py RUN.mcap [--json]`."""

import argparse
import json
import signal
import sys
from pathlib import Path

from sandwich_sitl.errors import SandwichError
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.summary import format_summary, summarise


def main() -> int:
    """Returns the exit status: 0, or 2 on an unusable file."""
    parser = argparse.ArgumentParser(description="Print the summary of one run, computed from its log.")
    parser.add_argument("run", type=Path, metavar="RUN.mcap")
    parser.add_argument("--json", action="store_true", help="print it as JSON")
    options = parser.parse_args()
    try:
        log = RunLog.read(options.run)
    except SandwichError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    if log.notice is not None:
        print(log.notice, file=sys.stderr)
    summary = summarise(log)
    print(json.dumps(summary, indent=2) if options.json else format_summary(summary))
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` is no error
    sys.exit(main())
