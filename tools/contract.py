"""PX4's behaviour row by row, each with the tests that hold the vehicle to it: pass or FAIL. Exit status 1 when a row fails or has no test.

    python tools/contract.py [--verbose]

Runs the conformance tests of tests/vehicle_sim (half a minute). A test belongs to the rows that its name begins with: test_row_12_...,
test_row_02_and_03_..., test_measured_...; the walk of the vehicle's own state table (`vehicle-sim --contract` prints it) stands last.
"""

import argparse
import re
import sys
from collections import defaultdict
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
ROWS = {
    "01": "set-points: own system, frames LOCAL_NED and BODY_NED, others refused with text",
    "02": "type_mask: ignored axes, all ignored and FORCE refused",
    "03": "NaN means ignore; what cannot be flown is bridged 200 ms, then stop",
    "04": "one set-point is proof of life for COM_OF_LOSS_T",
    "05": "position set-points need a position, accelerations only an attitude",
    "06": "modes: disarmed any, armed only what can be flown",
    "07": "DO_SET_MODE is acknowledged twice",
    "08": "mode numbers in DO_SET_MODE and HEARTBEAT",
    "09": "arming and disarming refused with PX4's texts; 21196 disarms",
    "10": "auto-disarm: 10 s without take-off, 2 s after landing",
    "11": "HEARTBEAT: 1 Hz, PX4, quadrotor, system_status",
    "12": "OFFBOARD lost: action, cascade, resumption",
    "13": "sticks end OFFBOARD only with COM_RC_OVERRIDE bit 1",
    "14": "ground station lost: NAV_DLL_ACT",
    "15": "battery levels and COM_LOW_BAT_ACT",
    "16": "stream rates within 5 %",
    "17": "ports of the instances",
    "18": "TIMESYNC is answered",
    "19": "parameters: _HASH_CHECK first, bytewise, types checked",
    "20": "REQUEST_MESSAGE, SET_MESSAGE_INTERVAL, wrong target, unknown command",
    "21": "mission protocol: again after 250 ms, over after 5 s",
    "22": "take-off in OFFBOARD by a set-point above or upward velocity",
    "23": "time-outs are scaled by the speed factor",
    "24": "what MAVSDK needs",
    "measured": "numbers measured on PX4: states, results, texts, times, rates, accuracy",
    "table": "the state table: every row reached and doing what it says; safety laws; failsafes",
}
TABLE_TESTS = ("every_row_of_the_table", "safety_laws", "every_failsafe_row", "failsafe_never_ends", "geofence_acts")


def rows_of(test: str) -> list[str]:
    """The rows a test's name claims."""
    name = test.rpartition("::")[2]
    if name.startswith("test_measured_"):
        return ["measured"]
    match = re.match(r"test_row_(\d\d)(?:_and_(\d\d))?_", name)
    if match:
        return [row for row in match.groups() if row]
    return ["table"] if any(part in name for part in TABLE_TESTS) else []


class Results:
    """A pytest plugin: outcome by row."""

    def __init__(self) -> None:
        self.by_row: dict[str, list[tuple[str, bool]]] = defaultdict(list)

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Keep the conformance tests alone."""
        others = [item for item in items if not rows_of(item.nodeid)]
        items[:] = [item for item in items if rows_of(item.nodeid)]
        config.hook.pytest_deselected(items=others)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A test counts once; one that cannot be set up has failed."""
        if report.when == "call" or (report.when == "setup" and not report.passed):
            for row in rows_of(report.nodeid):
                self.by_row[row].append((report.nodeid.rpartition("::")[2], report.passed))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--verbose", action="store_true", help="name every test")
    arguments = parser.parse_args()
    results = Results()
    options = [str(TOP / "tests" / "vehicle_sim"), "-q", "--no-header", "--no-summary", "-p", "no:cacheprovider"]
    pytest.main([*options, "--rootdir", str(TOP), "-c", str(TOP / "pyproject.toml")], plugins=[results])
    failed = 0
    for row, behaviour in ROWS.items():
        tests = results.by_row[row]
        good = sum(passed for _, passed in tests)
        holds = bool(tests) and good == len(tests)
        failed += not holds
        print(f"{row:9s} {'pass' if holds else 'FAIL'}  {good:3d} of {len(tests):3d} tests  {behaviour}")
        for name, passed in tests if arguments.verbose else []:
            print(f"{'':11s}{'pass' if passed else 'FAIL'}  {name}")
    print(f"{len(ROWS) - failed} of {len(ROWS)} rows pass")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
