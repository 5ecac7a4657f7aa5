"""What is refused before a flight because its plans would be refused in it; flown by the tracker as a second way."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sandwich_sitl.bench.tracking import ABLATION, CONDITIONS, FAULTS
from sandwich_sitl.config import MpcConfig, RunConfig, load_config
from sandwich_sitl.control.assurance import Rung
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.tracker import Tracker
from sandwich_sitl.errors import InputError
from sandwich_sitl.mission.room import check_room
from sandwich_sitl.planner_config import PlannerConfig
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.world_config import WorldConfig

DT, HEIGHT_M, EVERYWHERE_M = 0.02, 5.0, 1e4
CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))


def config_of(speed_mps: float = 3.0, acceleration_mps2: float = 2.0, brake_mps2: float = 3.0, **mpc: Any) -> RunConfig:
    planner = PlannerConfig(
        vehicle_radius_m=0.4, margin_m=0.6, speed_mps=speed_mps, acceleration_mps2=acceleration_mps2
    )
    config = RunConfig(
        world=WorldConfig(bounds_m=(-20, -20, 20, 20)), start_m=(0, 0), goal_m=(10, 0), altitude_m=HEIGHT_M,
        planner=planner, mpc=MpcConfig(**{"rate_hz": 1 / DT, "speed_mps": max(12.0, 1.1 * speed_mps)} | mpc),
    )  # fmt: skip
    return dataclasses.replace(config, mission=dataclasses.replace(config.mission, brake_mps2=brake_mps2))


def check(config: RunConfig) -> None:
    check_room(config, Mpc(config.mpc, config.mode, FACES))


def rungs(config: RunConfig, xyz_m: np.ndarray, on_the_ground: bool = False) -> list[Rung]:
    """Rungs of the tracker along xyz (K, 3) in one region without end, of a vehicle that obeys or stays on the ground."""
    sides = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])[np.minimum(np.arange(FACES), 3)]
    ring = EVERYWHERE_M * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corridor = Corridor(sides[None], np.full((1, FACES), EVERYWHERE_M), (ring,), ring[None])
    reference = Reference(DT * np.arange(len(xyz_m)), xyz_m, np.zeros(len(xyz_m), dtype=np.int64))
    tracker, seen = Tracker(config, Mpc(config.mpc, config.mode, FACES), reference, corridor, xyz_m[0]), []
    for k in range(len(xyz_m)):
        r_m, v_mps = (xyz_m[0], np.zeros(3)) if on_the_ground else (tracker.command[:3], tracker.command[3:6])
        seen.append(tracker.tick(k * DT, r_m.copy(), v_mps.copy(), 0.0).rung)
    return seen


def there(speed_mps: float, acceleration_mps2: float) -> np.ndarray:
    """Rest to speed, 2 s on at it, and back to rest, the acceleration smooth and at most so much; (K, 3)."""
    ramp_s = 1.875 * speed_mps / acceleration_mps2
    share = np.arange(0.0, 1.0, DT / ramp_s)
    rising = speed_mps * share**3 * (10 - 15 * share + 6 * share**2)
    speed = np.concatenate([rising, np.full(100, speed_mps), rising[::-1]])
    return np.column_stack([DT * np.cumsum(speed), np.zeros(len(speed)), np.full(len(speed), HEIGHT_M)])


@pytest.mark.parametrize(
    "changes",
    [
        {"speed_mps": 11.0, "acceleration_mps2": 4.0, "horizon_steps": 10},
        {"speed_mps": 18.0, "brake_mps2": 1.0},
    ],
)
def test_a_speed_that_the_horizon_cannot_stop_is_refused_and_what_is_named_instead_is_flown(
    changes: Mapping[str, Any],
) -> None:
    """Above the limit the tracker refuses plan after plan; at the speed that the message names, none."""
    with pytest.raises(InputError, match=r"mpc\.horizon_steps x mpc\.step_s: in .* planner\.speed_mps") as refusal:
        check(config_of(**changes))
    named = re.search(r"horizon of ([\d.]+) s or more, or a planner\.speed_mps of ([\d.]+)", str(refusal.value))
    assert named is not None
    horizon_s, speed_mps = (float(number) for number in named.groups())
    slower = config_of(**{**changes, "speed_mps": speed_mps})
    longer = config_of(**{**changes, "step_s": horizon_s / config_of(**changes).mpc.horizon_steps})
    for config in (slower, longer):
        check(config)
    fast = config_of(**changes)
    flown, refused = (rungs(c, there(c.planner.speed_mps, c.planner.acceleration_mps2)) for c in (slower, fast))
    assert set(flown) == {Rung.PLAN}
    assert refused.count(Rung.PLAN) < 0.8 * len(refused)


@pytest.mark.parametrize("band_m", [0.05, 0.2, 0.22])
def test_a_band_of_height_that_does_not_hold_the_push_off_is_refused(band_m: float) -> None:
    """On the ground no plan is flown with it; with the band that is named, every one."""
    with pytest.raises(InputError, match=r"mpc\.height_band_m: .* give 0\.3 or more"):
        check(config_of(height_band_m=band_m))
    check(config_of(height_band_m=0.3))
    rise = np.cumsum(np.minimum(np.arange(0.0, 1.5, DT), 1.0)) * DT
    climb = np.column_stack([np.zeros((len(rise), 2)), rise])
    assert Rung.SHIFTED in rungs(config_of(height_band_m=band_m), climb, on_the_ground=True)
    assert set(rungs(config_of(height_band_m=0.3), climb, on_the_ground=True)) == {Rung.PLAN}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_runs_have_room_as_do_those_of_the_benches(path: Path) -> None:
    benches = [*CONDITIONS.values(), *FAULTS.values(), *(changes for changes, _ in ABLATION.values())]
    for changes in benches if path.stem == "paper" else [{}]:
        check(load_config(path, changes))
    check(load_config(path, {"planner.speed_mps": 10.0, "planner.acceleration_mps2": 4.0}))
