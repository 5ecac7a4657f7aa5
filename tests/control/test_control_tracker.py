"""Observer, tracker and pilot in closed loop with plants that are known exactly."""

import dataclasses

import numpy as np
import pytest

from sandwich_sitl.config import MpcConfig, PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.control.observer import Observer
from sandwich_sitl.control.tracker import Tracker
from sandwich_sitl.mission.orders import Stream
from sandwich_sitl.mission.pilot import STALE_S, Pilot
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference

RATE_HZ = 50.0
MPC = MpcConfig(rate_hz=RATE_HZ)
DT = 1.0 / RATE_HZ


def quintic(share: np.ndarray) -> np.ndarray:
    return share**3 * (10 - 15 * share + 6 * share**2)


def flight(duration_s: float = 12.0, half_width_m: float = 0.6) -> tuple[Reference, Corridor]:
    """A gentle curve of 20 m from rest to rest at 10 m, in overlapping boxes along it."""
    t = np.arange(0, duration_s + DT / 2, DT)
    s = quintic(t / duration_s)
    xyz = np.column_stack([20 * s, 2 * np.sin(np.pi * s), np.full_like(s, 10.0)])
    count = 10
    region = np.minimum((s * count).astype(np.int64), count - 1)
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    Lambda, Gamma, rings = np.empty((count, FACES, 2)), np.empty((count, FACES)), []
    for m in range(count):
        low = xyz[region == m, :2].min(axis=0) - half_width_m
        high = xyz[region == m, :2].max(axis=0) + half_width_m
        offsets = [high[0], high[1], -low[0], -low[1]]
        Lambda[m], Gamma[m] = (
            normals[np.minimum(np.arange(FACES), 3)],
            np.take(offsets, np.minimum(np.arange(FACES), 3)),
        )
        rings.append(np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]))
    return Reference(t, xyz, region), Corridor(Lambda, Gamma, tuple(rings), np.array(rings))


def test_observer_converges_on_a_moving_target_seen_late() -> None:
    """Constant velocity, measurements 0.2 s old: no bias is left in position or velocity."""
    v, age = np.array([2.0, -1.0, 0.5]), 0.2
    observer = Observer(DT, 2.0, np.array([1.0, 1.0, 1.0]))
    for k in range(int(12 / DT)):
        now = k * DT
        observer.correct(v * (now - age), v, age)
        observer.advance(np.zeros(3))
    np.testing.assert_allclose(observer.x[:3], v * 12.0, atol=1e-3)
    np.testing.assert_allclose(observer.x[3:6], v, atol=1e-3)


def test_observer_error_decays_at_its_bandwidth() -> None:
    """Critically damped with both roots at w: (1 + w t) e^(-w t) bounds the error of a step in position."""
    observer = Observer(DT, 1.5, np.zeros(3))
    target = np.array([1.0, 0.0, 0.0])
    for k in range(1, 300):
        observer.correct(target, np.zeros(3), 0.0)
        observer.advance(np.zeros(3))
        error = abs(target[0] - observer.x[0])
        assert error <= (1 + 1.5 * k * DT) * np.exp(-1.5 * k * DT) + 0.02


def test_observer_follows_the_snap_exactly_when_nothing_disturbs() -> None:
    observer = Observer(DT, 1.0, np.zeros(3))
    for k in range(50):
        t = k * DT
        observer.correct(np.array([t**4 / 24, 0, 0]), np.array([t**3 / 6, 0, 0]), 0.0)
        observer.advance(np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(observer.x[[0, 3, 6, 9]], [1 / 24, 1 / 6, 1 / 2, 1.0], atol=1e-12)


@pytest.mark.parametrize("delay_s", [0.0, 0.04])
def test_tracker_with_an_exact_plant_stays_close_and_inside_its_regions(delay_s: float) -> None:
    """A perfect quadruple integrator that is at a tick where it was commanded to be one period and `delay_s` before."""
    reference, corridor = flight()
    config = dataclasses.replace(MPC, delay_s=delay_s + DT)
    tracker = Tracker(config, "timed", reference, corridor, reference.xyz_m[0])
    late = round(delay_s / DT)
    commanded = [np.concatenate([reference.xyz_m[0], np.zeros(9)])] * (late + 1)
    errors = []
    for k, desired in enumerate(reference.xyz_m):
        flown = commanded[-1 - late]
        errors.append(flown[:3] - desired)
        tick = tracker.tick(k * DT, flown[:3], flown[3:6], 0.0)
        assert tick.solution.usable
        assert tick.solution.slack_m.max() < 1e-3
        Lambda, Gamma = corridor.Lambda[reference.region[k]], corridor.Gamma[reference.region[k]]
        assert (Lambda @ flown[:2] - Gamma).max() < 1e-2
        commanded.append(tick.setpoint)
    assert np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()) < 0.03
    assert np.linalg.norm(errors[-1]) < 0.02


def test_tracker_returns_to_the_route_after_a_push() -> None:
    reference, corridor = flight()
    tracker = Tracker(MPC, "timed", reference, corridor, reference.xyz_m[0] + (0.0, 0.5, 0.0))
    state = np.concatenate([reference.xyz_m[0] + (0.0, 0.5, 0.0), np.zeros(9)])
    for k in range(len(reference.t_s)):
        state = tracker.tick(k * DT, state[:3], state[3:6], 0.0).setpoint
    assert np.linalg.norm(state[:3] - reference.xyz_m[-1]) < 0.02


def test_an_unusable_answer_leaves_the_last_plan_running_in_its_own_time() -> None:
    reference, corridor = flight()
    tracker = Tracker(MPC, "timed", reference, corridor, reference.xyz_m[0])
    state, usable = np.concatenate([reference.xyz_m[0], np.zeros(9)]), 100
    for k in range(usable):
        tick = tracker.tick(k * DT, state[:3], state[3:6], 0.0)
        state = tick.setpoint
    plan = tick.solution.snap
    broken = dataclasses.replace(reference, xyz_m=np.full_like(reference.xyz_m, np.nan))
    tracker._reference = broken
    for k in range(usable, usable + 12):
        tick = tracker.tick(k * DT, state[:3], state[3:6], 0.0)
        state = tick.setpoint
        assert not tick.solution.usable
        step = int((k - usable + 1) * DT / MPC.step_s + 1e-9)
        np.testing.assert_array_equal(tick.snap, plan[step])


def test_setpoints_form_one_smooth_motion() -> None:
    """Each set-point is reached from the last one under the reported snap."""
    reference, corridor = flight(6.0)
    config = dataclasses.replace(MPC, delay_s=DT)
    tracker = Tracker(config, "timed", reference, corridor, reference.xyz_m[0])
    last = np.concatenate([reference.xyz_m[0], np.zeros(9)])
    for k in range(200):
        tick = tracker.tick(k * DT, last[:3], last[3:6], 0.0)
        assert np.abs(tick.setpoint[:3] - last[:3] - last[3:6] * DT - last[6:9] * DT**2 / 2).max() < 1e-4
        np.testing.assert_allclose(tick.setpoint[9:] - last[9:], tick.snap * DT, atol=1e-12)
        last = tick.setpoint


GROUND_M = 0.7


def run_config() -> RunConfig:
    return RunConfig(
        world=WorldConfig(bounds_m=(-5, -5, 30, 10)),
        start_m=(0, 0),
        goal_m=(20, 0),
        altitude_m=10,
        planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6),
        mpc=dataclasses.replace(MPC, delay_s=0.0),
    )


def view_of(r: np.ndarray, v: np.ndarray, now_s: float) -> VehicleView:
    half = np.pi / 8  # yaw 45 degrees
    return VehicleView(
        heard=True, r_m=r, v_mps=v, position_time_s=now_s, q_wxyz=np.array([np.cos(half), 0, 0, np.sin(half)])
    )


def lifted_flight() -> tuple[Pilot, np.ndarray]:
    reference, corridor = flight()
    return Pilot(run_config(), reference, corridor), reference.xyz_m[0] + (0.0, 0.0, GROUND_M - 10.0)


def test_pilot_streams_nothing_until_asked_and_nothing_blindly() -> None:
    pilot, home = lifted_flight()
    assert pilot.steer(Stream.IDLE, 0.0, view_of(home, np.zeros(3), 0.0)).setpoint is None
    assert pilot.steer(Stream.TRACK, 0.0, VehicleView()).setpoint is None
    assert pilot.steer(Stream.NONE, 0.0, view_of(home, np.zeros(3), 0.0)).setpoint is None


def test_pilot_holds_the_first_pose_and_yaw() -> None:
    pilot, home = lifted_flight()
    first = pilot.steer(Stream.POSE, 0.0, view_of(home, np.zeros(3), 0.0)).setpoint
    second = pilot.steer(Stream.POSE, 0.1, view_of(home + 0.05, np.zeros(3), 0.1)).setpoint
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.r_m, home)
    np.testing.assert_array_equal(second.r_m, home)
    assert first.yaw_rad == pytest.approx(np.pi / 4)
    assert pilot.ground_m == pytest.approx(GROUND_M)


def test_pilot_setpoints_are_continuous_from_pose_over_track_to_brake() -> None:
    reference, corridor = flight()
    climb = Reference(reference.t_s, reference.xyz_m - (0.0, 0.0, 10.0), reference.region)
    pilot = Pilot(run_config(), climb, corridor)
    r, v, now = np.array([0.0, 0.0, GROUND_M]), np.zeros(3), 0.0
    streams = [Stream.POSE] * 20 + [Stream.TRACK] * 300 + [Stream.BRAKE] * 200 + [Stream.HOLD] * 20
    positions, velocities = [], []
    for stream in streams:
        steering = pilot.steer(stream, now, view_of(r, v, now))
        assert steering.setpoint is not None
        assert steering.setpoint.r_m is not None
        assert steering.setpoint.v_mps is not None
        assert (steering.tick is not None) == (stream is Stream.TRACK)
        r, v = steering.setpoint.r_m, steering.setpoint.v_mps
        positions.append(r)
        velocities.append(v)
        now += DT
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    speeds = np.linalg.norm(velocities, axis=1)
    assert speeds[:20].max() == 0.0
    assert speeds[200:320].max() > 1.0
    assert (steps <= np.maximum(speeds[:-1], speeds[1:]) * DT + 1e-3).all()
    changes = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
    assert changes.max() <= 3.0 * DT + 1e-9  # brake_mps2
    assert speeds[-20:].max() == 0.0
    assert not pilot.plan_stale(now)


@pytest.mark.parametrize("cause", ["refused", "astray"])
def test_pilot_gives_up_a_plan_that_is_not_sent_or_not_followed(cause: str) -> None:
    """Nothing accepted, or the vehicle standing still while the reference leaves: stale, so the mission brakes."""
    reference, corridor = flight(20.0)
    config = run_config()
    config = dataclasses.replace(config, mission=dataclasses.replace(config.mission, lost_track_m=1.0))
    pilot = Pilot(config, reference, corridor)
    standing = view_of(reference.xyz_m[0], np.zeros(3), 0.0)
    stale_at = None
    for k in range(600):
        pilot.steer(Stream.TRACK, k * DT, standing)
        if cause == "astray":
            pilot.accepted(k * DT)
        if pilot.plan_stale(k * DT):
            stale_at = k * DT
            break
    assert stale_at is not None
    if cause == "refused":
        assert stale_at == pytest.approx(STALE_S, abs=2 * DT)
    else:
        gone = np.linalg.norm(reference.xyz_m - reference.xyz_m[0], axis=1) > 1.0
        assert stale_at == pytest.approx(float(reference.t_s[gone][0]) + STALE_S, abs=3 * DT)


def test_pilot_tells_a_stale_plan_and_a_finished_route() -> None:
    reference, corridor = flight(2.0)
    pilot = Pilot(run_config(), reference, corridor)
    good = view_of(reference.xyz_m[0], np.zeros(3), 0.0)
    pilot.steer(Stream.TRACK, 0.0, good)
    assert not pilot.route_finished(1.0, good)
    broken = view_of(np.full(3, np.nan), np.zeros(3), 0.0)
    for k in range(1, 40):
        pilot.steer(Stream.TRACK, k * DT, broken)
        assert pilot.plan_stale(k * DT) == (k * DT > STALE_S)
    end = view_of(reference.xyz_m[-1], np.zeros(3), 2.5)
    assert pilot.route_finished(2.5, end)
    assert not pilot.route_finished(2.5, view_of(reference.xyz_m[-1], np.array([1.0, 0, 0]), 2.5))
    assert not pilot.route_finished(2.5, view_of(reference.xyz_m[-1] + (1.0, 0, 0), np.zeros(3), 2.5))
