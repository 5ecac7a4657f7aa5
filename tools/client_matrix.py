"""Fly the vehicle with real client programs over UDP and print what worked: client x feature. Exit status 1 when anything failed, 2 when no
client program is installed.

    python tools/client_matrix.py [--only mavsdk4|mavsdk3|mavproxy ...] [--clients DIR] [--speed 4]

The programs are those that `tools/install_clients.sh` puts into DIR (default .clients, or $SITL_CLIENTS).
"""

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

TOP = Path(__file__).parents[1]
SCRIPTS = {"mavsdk4": "mavsdk4_flight.py", "mavsdk3": "mavsdk3_flight.py", "mavproxy": "mavproxy_flight.py"}
LIMIT_S = 240


def free_port() -> int:
    """A UDP port nobody had a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def fly(client: str, python: Path, speed: float) -> tuple[list[dict[str, object]], str]:
    """The steps of one client program against a vehicle of its own, and what it said besides."""
    port = free_port()
    with tempfile.TemporaryDirectory() as scratch:
        config = Path(scratch) / "run.yaml"
        config.write_text("start_m: [0.0, 0.0]\n")
        command = [sys.executable, "-m", "vehicle_sim", str(config), "--connect", f"udpout://127.0.0.1:{port}"]
        command += ["--bind", "127.0.0.1:0", "--clock", "realtime", "--speed", str(speed), "--until-eof"]
        vehicle = subprocess.Popen(command, cwd=TOP, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
        script = str(TOP / "tools" / "clients" / SCRIPTS[client])
        if client == "mavproxy":
            flight = [sys.executable, script, str(python), str(port)]
        else:
            flight = [str(python), script, f"udpin://127.0.0.1:{port}"]
        child = subprocess.Popen(
            flight, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
        )
        try:
            said = child.communicate(timeout=LIMIT_S)[0]
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            said = child.communicate()[0]
        finally:
            vehicle.terminate()
            vehicle.wait(20)
    decoder = json.JSONDecoder()
    begins = [at for at in range(len(said)) if said.startswith('{"step"', at)]
    return [decoder.raw_decode(said, at)[0] for at in begins], said


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=sorted(SCRIPTS), action="append")
    parser.add_argument("--clients", type=Path, default=Path(os.environ.get("SITL_CLIENTS", TOP / ".clients")))
    parser.add_argument("--speed", type=float, default=4.0)
    arguments = parser.parse_args()
    failures = 0
    flown: dict[str, dict[str, str]] = {}
    for client in arguments.only or SCRIPTS:
        python = arguments.clients / client / "bin" / "python"
        if not python.exists():
            print(f"{client}: not installed in {arguments.clients} (tools/install_clients.sh)")
            failures += arguments.only is not None
            continue
        steps, said = fly(client, python, arguments.speed)
        for step in steps:
            mark = "pass" if step["ok"] else "FAIL"
            note = f"  {step['note']}" if step["note"] else ""
            print(f"{client:9s} {step['step']!s:28s} {mark}{note}")
        wrong = sum(not step["ok"] for step in steps)
        failures += wrong if steps else 1
        if not steps or wrong:
            print(said[-2000:], file=sys.stderr)
        print(f"{client}: {len(steps) - wrong} of {len(steps)} features")
        flown[client] = {str(step["step"]).replace("_", " "): "pass" if step["ok"] else "FAIL" for step in steps}
    if not flown:
        print(f"no client program was flown: run tools/install_clients.sh {arguments.clients}", file=sys.stderr)
        return 2
    if len(flown) > 1:
        print(matrix(flown))
    return int(failures > 0)


def matrix(flown: dict[str, dict[str, str]]) -> str:
    """Feature by client; "-" where a client has no such step."""
    features = list(dict.fromkeys(feature for steps in flown.values() for feature in steps))
    width = max(map(len, features))
    head = " ".join([" " * width, *(f"{client:8s}" for client in flown)])
    return "\n".join([head] + [_row(feature, width, flown) for feature in features])


def _row(feature: str, width: int, flown: dict[str, dict[str, str]]) -> str:
    return " ".join([feature.ljust(width), *(f"{steps.get(feature, '-'):8s}" for steps in flown.values())]).rstrip()


if __name__ == "__main__":
    sys.exit(main())
