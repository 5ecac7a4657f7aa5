"""MAVProxy driven through its prompt: every feature is a step; prints one JSON line a step. Run by any Python.

python mavproxy_flight.py PYTHON_WITH_MAVPROXY PORT
"""

import json
import os
import queue
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

WAYPOINTS = """QGC WPL 110
0	1	0	16	0	0	0	0	47.397742	8.545594	488	1
1	0	3	22	0	0	0	0	47.397742	8.545594	5	1
2	0	3	16	0	0	0	0	47.397800	8.545594	6	1
3	0	3	16	0	0	0	0	47.397800	8.545650	6	1
"""


class Prompt:
    """MAVProxy as a child process; lines of its output can be waited for."""

    def __init__(self, python: str, port: str, home: Path) -> None:
        (home / "wp.txt").write_text(WAYPOINTS)
        command = [python, str(Path(python).with_name("mavproxy.py")), f"--master=udpin:127.0.0.1:{port}"]
        command += [f"--state-basedir={home}", f"--logfile={home}/flight.tlog"]
        command += ["--default-modules=link,cmdlong,mode,arm,param,wp,misc"]
        self.child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=home,
            env={**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.child.stdout is not None
        for line in self.child.stdout:
            self._lines.put(line.strip())

    def say(self, command: str) -> None:
        assert self.child.stdin is not None
        self.child.stdin.write(command + "\n")
        self.child.stdin.flush()

    def hear(self, pattern: str, limit_s: float = 15.0) -> str:
        end, heard = time.monotonic() + limit_s, []
        while time.monotonic() < end:
            try:
                line = self._lines.get(timeout=0.2)
            except queue.Empty:
                continue
            heard.append(line)
            if re.search(pattern, line):
                return line
        raise TimeoutError(f"no line like {pattern!r} in {limit_s} s; heard {heard[-6:]}")

    def ask_until(self, command: str, pattern: str, limit_s: float) -> str:
        end = time.monotonic() + limit_s
        while True:
            self.say(command)
            try:
                return self.hear(pattern, 1.0)
            except TimeoutError:
                if time.monotonic() > end:
                    raise


def steps(p: Prompt) -> dict[str, Callable[[], object]]:
    def do(command: str, *patterns: str) -> Callable[[], object]:
        def run() -> None:
            p.say(command)
            for pattern in patterns:
                p.hear(pattern, 25.0)

        return run

    return {
        "connect": lambda: p.hear("online system 1", 20.0),
        "parameters at start": lambda: p.hear("Received .* parameters", 20.0),
        "ready": lambda: p.ask_until("status HEARTBEAT", "system_status : 3", 20.0),
        "param fetch": do("param fetch", "Received .* parameters"),
        "param show": do("param show MPC_XY_CRUISE", r"MPC_XY_CRUISE +5\.0"),
        "param set": lambda: (p.say("param set MPC_XY_CRUISE 6.5"), time.sleep(1.0)),
        "param reads back": do("param show MPC_XY_CRUISE", r"MPC_XY_CRUISE +6\.5"),
        "wp load": do("wp load wp.txt", "MISSION_ACK.*ACCEPTED"),
        "wp list": do("wp list", "22 3 47.397742", "Saved .* waypoints"),
        "arm": do("arm throttle", "COMPONENT_ARM_DISARM: ACCEPTED", "ARMED"),
        "takeoff": do("takeoff 5", "NAV_TAKEOFF: ACCEPTED", "Takeoff detected", "Mode LOITER"),
        "guided": lambda: (
            p.say("set flytoframe AMSL"),
            p.say("guided 47.397800 8.545594 495"),
            p.hear("DO_REPOSITION: ACCEPTED"),
            p.ask_until("status GLOBAL_POSITION_INT", r"alt : 49[45]\d\d\d, .*hdg", 20.0),
        ),
        "mode (long DO_SET_MODE)": do("long DO_SET_MODE 1 4 4", "DO_SET_MODE: ACCEPTED", "Mode MISSION"),
        "mission flown": lambda: p.ask_until("status MISSION_CURRENT", "seq : 3", 40.0),
        "rtl": do("long NAV_RETURN_TO_LAUNCH", "NAV_RETURN_TO_LAUNCH: ACCEPTED", "Mode RTL"),
        "landed and disarmed": lambda: p.hear("DISARMED", 60.0),
    }


def main() -> None:
    with tempfile.TemporaryDirectory() as home:
        prompt = Prompt(sys.argv[1], sys.argv[2], Path(home))
        try:
            for name, step in steps(prompt).items():
                begin, note, ok = time.monotonic(), "", True
                try:
                    step()
                except TimeoutError as error:
                    note, ok = str(error), False
                spent = round(time.monotonic() - begin, 2)
                print(json.dumps({"step": name, "ok": ok, "note": note, "s": spent}), flush=True)
        finally:
            prompt.child.kill()
            prompt.child.wait(10)


main()
