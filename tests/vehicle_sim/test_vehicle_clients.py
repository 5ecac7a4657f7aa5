"""Real client programs fly the vehicle over UDP: MAVSDK 4 and 3, MAVProxy; skipped where they are not installed. The contract's table."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
CLIENTS = Path(os.environ.get("SITL_CLIENTS", TOP / ".clients"))
FEATURES = {"mavsdk4": 25, "mavsdk3": 18, "mavproxy": 16}


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("client", sorted(FEATURES))
def test_client_program_flies_the_vehicle_as_it_flies_px4(client: str) -> None:
    if not (CLIENTS / client / "bin" / "python").exists():
        pytest.skip(f"{client} is not installed in {CLIENTS}; run tools/install_clients.sh")
    done = subprocess.run(
        [sys.executable, str(TOP / "tools" / "client_matrix.py"), "--only", client, "--clients", str(CLIENTS)],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{client}: {FEATURES[client]} of {FEATURES[client]} features" in done.stdout


@pytest.mark.slow
def test_the_contract_is_printed_with_pass_or_fail_for_every_row() -> None:
    command = [sys.executable, str(TOP / "tools" / "contract.py"), "--verbose"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=170, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "26 of 26 rows pass" in done.stdout
    assert "pass  test_row_07_do_set_mode_is_acknowledged_twice" in done.stdout
