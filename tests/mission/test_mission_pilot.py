"""The pilot's stop on request: along the plan that was looked at, not straight out of its bend."""

import dataclasses

import numpy as np
import pytest

from sandwich_sitl.config import MpcConfig, RunConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.mission.brake import BrakeProfile
from sandwich_sitl.mission.orders import Stream
from sandwich_sitl.mission.pilot import Pilot
from sandwich_sitl.mission.setpoint import Setpoint
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.planner_config import PlannerConfig
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.world_config import WorldConfig

DT, RADIUS_M, SPEED_MPS, HEIGHT_M = 0.02, 4.0, 3.0, 5.0

CONFIG = RunConfig(
    world=WorldConfig(bounds_m=(-20, -20, 20, 20)), start_m=(RADIUS_M, 0), goal_m=(-RADIUS_M, 0),
    altitude_m=HEIGHT_M, planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6), mpc=MpcConfig(rate_hz=1 / DT),
)  # fmt: skip


def bend() -> tuple[Reference, Corridor]:
    """A circle, its speed brought up smoothly, in one region that is never in the way."""
    t = np.arange(0.0, 12.0, DT)
    ramp = np.clip(t / 4.0, 0.0, 1.0)
    speed = SPEED_MPS * ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    angle = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * DT)]) / RADIUS_M
    xyz = np.column_stack([RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), np.full_like(t, HEIGHT_M)])
    sides = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])[np.minimum(np.arange(FACES), 3)]
    ring = 20.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corridor = Corridor(sides[None], np.full((1, FACES), 20.0), (ring,), ring[None])
    return Reference(t, xyz, np.zeros(len(t), dtype=np.int64)), corridor


def seen(setpoint: Setpoint | None, now_s: float) -> VehicleView:
    """A vehicle that is where it was told to be."""
    r_m = np.array([RADIUS_M, 0.0, HEIGHT_M]) if setpoint is None or setpoint.r_m is None else setpoint.r_m
    v_mps = np.zeros(3) if setpoint is None or setpoint.v_mps is None else setpoint.v_mps
    return VehicleView(heard=True, r_m=r_m, v_mps=v_mps, position_time_s=now_s)


def off_the_bend(places: np.ndarray) -> float:
    return float(np.abs(np.hypot(places[:, 0], places[:, 1]) - RADIUS_M).max())


@pytest.mark.parametrize(("limit_mps", "refused"), [(2.9, True), (3.2, True), (3.26, False)])
def test_a_plan_without_room_for_its_reference_is_refused_before_there_is_a_flight(
    limit_mps: float, refused: bool
) -> None:
    """The plan's speed stays inside an octagon, 0.924 of the limit: a reference of 3 m/s wants 3.25 m/s."""
    config = dataclasses.replace(CONFIG, mpc=dataclasses.replace(CONFIG.mpc, speed_mps=limit_mps))
    if refused:
        with pytest.raises(InputError, match="could not follow its own reference"):
            Pilot(config, *bend())
    else:
        Pilot(config, *bend())


def test_a_horizon_too_short_to_settle_is_refused_and_the_one_that_is_asked_for_is_taken() -> None:
    short = dataclasses.replace(CONFIG, mpc=dataclasses.replace(CONFIG.mpc, horizon_steps=10, step_s=0.02))
    with pytest.raises(InputError, match=r"0\.2 s are too short .* give a horizon of 0\.8 s or more"):
        Pilot(short, *bend())
    Pilot(dataclasses.replace(CONFIG, mpc=dataclasses.replace(CONFIG.mpc, horizon_steps=8, step_s=0.1)), *bend())


def test_a_requested_stop_follows_the_bend_and_ends_at_rest() -> None:
    pilot, last = Pilot(CONFIG, *bend()), None
    flown: list[Setpoint] = []
    stop_at, ticks = 350, 600
    for k in range(ticks):
        now_s = k * DT
        steering = pilot.steer(Stream.TRACK if k < stop_at else Stream.BRAKE, now_s, seen(last, now_s))
        pilot.accepted(now_s)
        last = steering.setpoint
        assert last is not None
        flown.append(last)
    places = np.array([setpoint.r_m for setpoint in flown])
    speeds = np.linalg.norm([setpoint.v_mps for setpoint in flown], axis=1)
    assert speeds[stop_at - 1] > 0.95 * SPEED_MPS
    np.testing.assert_allclose(speeds[-50:], 0.0, atol=1e-9)
    assert np.ptp(places[-50:], axis=0).max() < 1e-9
    assert off_the_bend(places[stop_at:]) < 0.05
    jumps = np.diff(places, axis=0) - DT * np.array([setpoint.v_mps for setpoint in flown[:-1]])
    assert np.abs(jumps[stop_at - 5 :]).max() < 3e-3
    before = flown[stop_at - 1]
    assert before.r_m is not None
    assert before.v_mps is not None
    straight = BrakeProfile(before.r_m, before.v_mps, CONFIG.mission.brake_mps2)
    assert off_the_bend(np.array([straight.at(t)[0] for t in np.arange(0.0, 2.0, DT)])) > 0.2
