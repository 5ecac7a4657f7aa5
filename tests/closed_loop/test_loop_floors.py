"""A flight over a low wall and round a tall tower, over real UDP: floors end to end."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from sandwich_sitl.recording.reader import RunLog

WALL, TOWER = shapely.box(18, -5, 24, 35), shapely.box(34, 6, 38, 13)
CONFIG = """
name: hop
world:
  bounds_m: [0, 0, 56, 24]
  obstacles:
    - {name: wall, polygon_m: [[18, -5], [24, -5], [24, 35], [18, 35]], height_m: 7}
    - {name: tower, polygon_m: [[34, 6], [38, 6], [38, 13], [34, 13]], height_m: 30}
start_m: [5, 11]
goal_m: [51, 11]
altitude_m: 4
planner: {vehicle_radius_m: 0.4, margin_m: 0.6, cell_m: 1.0, floors_m: [4, 9], speed_mps: 3.0, acceleration_mps2: 2.0}
vehicle: {sensors: {estimator: error_model}, wind: {mean_enu_mps: [2, -2, 0], gust_std_mps: [0.8, 0.8, 0.5]}}
link: {uri: "udpin://127.0.0.1:0"}
zenoh: {enabled: false}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of a finished run in gusts; there is no way but over the wall."""
    out = tmp_path_factory.mktemp("floors")
    (out / "hop.yaml").write_text(CONFIG, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "sandwich_sitl.cli", "run", str(out / "hop.yaml"), "--out", str(out)],
        capture_output=True, text=True, timeout=150, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr + done.stdout
    return out


def test_it_lands_and_the_summary_counts_clearance_in_space(flown: Path) -> None:
    summary = json.loads((flown / "summary.json").read_text())
    flight, floors = summary["flight"], summary["floors"]
    assert summary["outcome"] == "landed"
    assert (floors["altitude_m"], floors["changes"]) == (9.0, 2)
    assert (floors["climbed_m"], floors["descended_m"]) == (pytest.approx(5.0, abs=1e-6), pytest.approx(5.0, abs=1e-6))
    assert flight["quadrangle_violations"] == 0
    assert (summary["assurance"]["fallbacks"], summary["mpc"]["infeasible"]) == (0, 0)
    assert flight["min_clearance_m"] >= 0.4


def test_the_true_path_is_over_the_wall_and_round_the_tower(flown: Path) -> None:
    log = RunLog.read(flown / "run.mcap")
    at = shapely.points(log.truth.r_m[:, :2])
    over = shapely.distance(WALL, at) <= 0.4
    assert over.any()
    assert log.truth.r_m[over, 2].min() > 7.0 + 0.4
    assert shapely.distance(TOWER, at).min() > 0.4
    np.testing.assert_allclose(log.truth.r_m[-1], [51.0, 11.0, 0.0], atol=0.5)


def test_what_was_flown_was_proven_and_every_plan_stayed_at_its_altitudes(flown: Path) -> None:
    log = RunLog.read(flown / "run.mcap")
    plan = log.plan
    assert plan is not None
    assert plan.proof is not None
    assert plan.proof.proven
    assert plan.proof.least_headroom_m is not None
    assert plan.proof.least_headroom_m > 0.0
    control = log.control
    lifted = control.setpoint_r_m[:, 2] > 1.0
    low, high = plan.corridor.z_m[control.region[lifted]].T
    ground_m = control.reference_m[0, 2] - plan.reference.xyz_m[0, 2]
    z = control.setpoint_r_m[lifted, 2] + control.offset_m[lifted, 2] - ground_m
    assert (z > low - 0.05).all()
    assert (z < high + 0.05).all()
