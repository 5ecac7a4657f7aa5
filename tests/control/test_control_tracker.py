"""Tracker and pilot in closed loop with plants that are known exactly."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from sandwich_sitl.config import TrackingConfig
from sandwich_sitl.control.assurance import Fault, Rung, examine
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.tracker import Tracker
from sandwich_sitl.mission.orders import Stream
from sandwich_sitl.mission.pilot import STALE_S, Pilot
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Reference

from .flights import DT, MPC, failing_when, flight, mpc_of, run_config


def fly(
    tracker: Tracker, reference: Reference, delay_s: float, disturb: object, ticks: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Positions (ticks, 3) of an exact plant that is where it was told to be `delay_s` ago, shifted by `disturb(t)`."""
    late = round(delay_s / DT)
    commanded = [np.concatenate([reference.xyz_m[0], np.zeros(9)])] * (late + 1)
    flown = []
    for k in range(ticks):
        state = commanded[-1 - late].copy()
        state[:3] += disturb(k * DT)  # type: ignore[operator]
        flown.append(state[:3])
        tick = tracker.tick(k * DT, state[:3], state[3:6], 0.0)
        assert tick.rung is Rung.PLAN
        assert tick.fault is Fault.NONE
        commanded.append(tick.setpoint)
    return np.array(flown), commanded


@pytest.mark.parametrize("delay_s", [0.0, 0.06, 0.14])
@pytest.mark.parametrize("known", [True, False])
def test_tracker_with_an_exact_plant_stays_close_and_inside_its_regions(delay_s: float, known: bool) -> None:
    """Whether the delay is given or measured on the way: the plant is late by one tick more than `late`."""
    reference, corridor = flight(20.0)
    config = run_config(tracking=TrackingConfig(delay_s=delay_s + DT if known else None))
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    flown, _ = fly(tracker, reference, delay_s, lambda _: np.zeros(3), len(reference.t_s) + 100)
    errors = np.linalg.norm(flown[: len(reference.t_s)] - reference.xyz_m, axis=1)
    assert np.sqrt((errors**2).mean()) < (0.01 if known else 0.06)
    assert np.linalg.norm(flown[-1] - reference.xyz_m[-1]) < 0.01
    for k, r in enumerate(flown[: len(reference.t_s)]):
        region = reference.region[k]
        assert (corridor.Lambda[region] @ r[:2] - corridor.Gamma[region]).max() < 0.02


def test_a_steady_push_is_aimed_off() -> None:
    """A vehicle that always ends up 0.3 m beside its command comes back to the route, and stays in the corridor."""
    reference, corridor = flight(20.0)
    config = run_config()
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    aside = np.array([0.1, 0.3, -0.2])
    flown, commanded = fly(tracker, reference, 0.0, lambda t: aside * min(1.0, t / 2.0), len(reference.t_s))
    errors = np.linalg.norm(flown - reference.xyz_m, axis=1)
    assert errors[300:].max() < 0.05
    np.testing.assert_allclose(commanded[-1][:3], reference.xyz_m[-1] - aside, atol=0.02)


def test_a_jump_of_the_estimate_makes_no_step_in_the_command() -> None:
    """0.3 m in one tick, as EKF2 does: position, velocity and acceleration of the command stay those of one motion."""
    reference, corridor = flight(20.0)
    config = run_config()
    calm = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    jumpy = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    _, without = fly(calm, reference, 0.0, lambda _: np.zeros(3), 600)
    _, with_it = fly(jumpy, reference, 0.0, lambda t: np.array([0.0, 0.3, 0.0]) * (t >= 8.0), 600)
    states, plain = np.array(with_it), np.array(without)
    k = 401
    np.testing.assert_allclose(states[:k], plain[:k], atol=1e-9)
    moved = states[k:] - plain[k:]
    assert np.abs(moved[0, :3]).max() < 1e-4
    assert np.abs(moved[0, 3:6]).max() < 5e-3
    assert np.abs(np.diff(states[:, 6:9], axis=0)).max() < 0.8  # jerk bound times the period
    jumps = states[1:, :3] - states[:-1, :3] - DT * states[:-1, 3:6] - DT**2 / 2 * states[:-1, 6:9]
    assert np.abs(jumps).max() < 1e-4
    assert moved[-1, 1] == pytest.approx(-0.3, abs=0.03)  # and in the end it has come back by as much


def test_a_plan_that_starts_from_the_estimated_motion_shakes_the_vehicle() -> None:
    """Why the plan starts from the command: 1 cm of noise in the measured place, plan started from either."""
    reference, corridor = flight(10.0)
    config = run_config()
    shaken = []
    for from_estimate in (False, True):
        rng = np.random.default_rng(5)
        tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
        commanded = [np.concatenate([reference.xyz_m[0], np.zeros(9)])] * 4
        accelerations = []
        for k in range(400):
            if from_estimate and k > 5:
                tracker.command = tracker.estimator.motion.copy()
            noisy = commanded[-4][:3] + rng.normal(0.0, 0.01, 3)
            tick = tracker.tick(k * DT, noisy, commanded[-4][3:6] + rng.normal(0.0, 0.02, 3), 0.0)
            commanded.append(tick.setpoint)
            accelerations.append(tick.setpoint[6:9])
        shaken.append(float(np.abs(np.diff(accelerations, axis=0)).mean()))
    assert shaken[1] > 3 * shaken[0]


def test_tracker_returns_to_the_route_after_a_push() -> None:
    reference, corridor = flight()
    config = run_config()
    start = reference.xyz_m[0] + (0.0, 0.5, 0.0)
    tracker = Tracker(config, mpc_of(config), reference, corridor, start)
    state = np.concatenate([start, np.zeros(9)])
    for k in range(len(reference.t_s) + 100):
        state = tracker.tick(k * DT, state[:3], state[3:6], 0.0).setpoint
    assert np.linalg.norm(state[:3] - reference.xyz_m[-1]) < 0.02


def test_setpoints_form_one_smooth_motion() -> None:
    """Each set-point is reached from the last one under the reported snap."""
    reference, corridor = flight(6.0)
    config = run_config()
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    last = np.concatenate([reference.xyz_m[0], np.zeros(9)])
    for k in range(200):
        tick = tracker.tick(k * DT, last[:3], last[3:6], 0.0)
        assert np.abs(tick.setpoint[:3] - last[:3] - last[3:6] * DT - last[6:9] * DT**2 / 2).max() < 1e-4
        np.testing.assert_allclose(tick.setpoint[9:] - last[9:], tick.snap * DT, atol=1e-9)
        last = tick.setpoint


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 500.0])
@pytest.mark.parametrize("late_s", [0.03, 0.12, 0.17])
def test_a_late_tick_makes_no_step_in_the_command(rate_hz: float, late_s: float) -> None:
    """With 0.3 m of offset learned: the command goes on by its own motion over the gap."""
    reference, corridor = flight(20.0)
    dt = 1.0 / rate_hz
    t = np.arange(0.0, 20.0 + dt / 2, dt)
    xyz = np.column_stack([np.interp(t, reference.t_s, column) for column in reference.xyz_m.T])
    region = reference.region[np.minimum(np.rint(t / DT).astype(int), len(reference.region) - 1)]
    config = run_config(mpc=dataclasses.replace(MPC, rate_hz=rate_hz))
    tracker = Tracker(config, mpc_of(config), Reference(t, xyz, region), corridor, xyz[0])
    state, aside, now_s = np.concatenate([xyz[0], np.zeros(9)]), np.array([0.0, 0.3, 0.0]), 0.0
    while now_s < 5.0:
        now_s += dt
        state = tracker.tick(now_s, state[:3] + min(1.0, now_s / 2.0) * aside, state[3:6], 0.0).setpoint
    before, gap_s = state, dt + late_s
    vehicle = before[:3] + gap_s * before[3:6] + aside
    after = tracker.tick(now_s + gap_s, vehicle, before[3:6], 0.0).setpoint
    moved = before[:3] + gap_s * before[3:6] + gap_s**2 / 2 * before[6:9]
    assert np.abs(after[:3] - moved).max() < 5e-3
    assert np.abs(after[3:6] - before[3:6] - gap_s * before[6:9]).max() < 0.1


def test_after_a_pause_what_was_learned_of_the_wind_is_kept() -> None:
    """0.3 m beside its command before, during and after a pause of half a second: the command does not start over."""
    reference, corridor = flight(20.0)
    config = run_config()
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    state, aside = np.concatenate([reference.xyz_m[0], np.zeros(9)]), np.array([0.0, 0.3, 0.0])
    for k in range(300):
        state = tracker.tick(k * DT, state[:3] + min(1.0, k / 100) * aside, state[3:6], 0.0).setpoint
    rested = np.concatenate([state[:3], np.zeros(9)])
    t = 300 * DT + 0.5
    state, worst = rested, 0.0
    for k in range(50):
        tick = tracker.tick(t + k * DT, state[:3] + aside, state[3:6], 0.0)
        state = tick.setpoint
        assert tick.offset_m[1] == pytest.approx(0.3, abs=0.05)
        worst = max(worst, abs(float(state[1] + aside[1] - tick.desired_m[1])))
    assert worst < 0.1
    assert np.linalg.norm(rested[:3] - reference.xyz_m[0]) > 1.0


@pytest.mark.parametrize("pause_s", [0.3, 0.8])
def test_after_a_pause_the_plan_begins_where_the_vehicle_has_come_to(pause_s: float) -> None:
    """The vehicle flew on at 60 % of its speed: no leap back to the old command, and the reference waits for it."""
    reference, corridor = flight(10.0)
    config = run_config()
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    state = np.concatenate([reference.xyz_m[0], np.zeros(9)])
    for k in range(250):
        state = tracker.tick(k * DT, state[:3], state[3:6], 0.0).setpoint
    v = 0.6 * state[3:6]
    r = state[:3] + pause_s * v
    t = 249 * DT + pause_s
    first = tracker.tick(t, r, v, 0.0)
    assert first.rung is Rung.PLAN
    assert np.linalg.norm(first.setpoint[:3] - r) < 0.15
    assert np.linalg.norm(first.setpoint[3:6] - v) < 0.3
    assert first.rate == pytest.approx(0.6, abs=0.2)
    state, worst, fastest = first.setpoint, 0.0, 0.0
    for k in range(1, 500):
        tick = tracker.tick(t + k * DT, state[:3], state[3:6], 0.0)
        state = tick.setpoint
        worst = max(worst, float(np.linalg.norm(state[:3] - tick.desired_m)))
        fastest = max(fastest, float(np.linalg.norm(state[3:6])))
    assert worst < 0.35
    assert fastest < 1.3 * 1.875 * 20.5 / 10.0
    assert np.linalg.norm(state[:3] - reference.xyz_m[-1]) < 0.02


@pytest.mark.parametrize("cause", ["refused", "stop"])
def test_after_a_pause_without_a_plan_the_vehicle_brakes_where_it_is(cause: str) -> None:
    """The plan from before the pause is 0.6 s further on by now; a vehicle that stood meanwhile is not sent after it."""
    reference, corridor = flight(10.0)
    config = run_config()
    broken = failing_when(lambda k: cause == "refused" and 250 <= k < 290)
    tracker = Tracker(config, Mpc(config.mpc, config.mode, FACES, broken), reference, corridor, reference.xyz_m[0])
    state = np.concatenate([reference.xyz_m[0], np.zeros(9)])
    for k in range(250):
        state = tracker.tick(k * DT, state[:3], state[3:6], 0.0).setpoint
    tracker.stops = cause == "stop"
    before, t = state, 249 * DT + 0.6
    assert np.linalg.norm(before[3:6]) > 2.0
    v = 0.2 * before[3:6]
    places = []
    for k in range(40):
        tick = tracker.tick(t + k * DT, state[:3], v if k == 0 else state[3:6], 0.0)
        assert tick.rung is Rung.SHIFTED
        state = tick.setpoint
        places.append(state[:3])
    steps = np.linalg.norm(np.diff(np.array([before[:3], *places]), axis=0), axis=1)
    assert steps.max() < 1.01 * np.linalg.norm(v) * DT + 0.12 * np.linalg.norm(v)  # the delay that it is flown ahead of
    assert np.linalg.norm(places[-1] - before[:3]) < np.linalg.norm(v) * (0.4 + 0.12)
    tick = tracker.tick(t + 40 * DT, state[:3], state[3:6], 0.0)
    assert tick.rung is (Rung.PLAN if cause == "refused" else Rung.SHIFTED)
    assert np.linalg.norm(tick.desired_m - state[:3]) < 0.5


def test_a_tick_too_late_for_its_plan_to_end_in_a_stop_flies_on_by_the_last_one() -> None:
    """Of a horizon of 0.3 s a tick that comes 0.18 s late leaves 0.1 s, in which no vehicle stops."""
    reference, corridor = flight(20.0)
    limits = {"speed_mps": 60.0, "acceleration_mps2": 60.0, "jerk_mps3": 5e3, "snap_mps4": 5e5, "tilt_deg": 60.0}
    mpc = dataclasses.replace(MPC, horizon_steps=30, step_s=0.01, bandwidth_radps=40.0, **limits)
    config = run_config(mpc=mpc)
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    state = np.concatenate([reference.xyz_m[0], np.zeros(9)])
    for k in range(300):
        tick = tracker.tick(k * DT, state[:3], state[3:6], 0.0)
        state = tick.setpoint
        assert tick.rung is Rung.PLAN
    tick = tracker.tick(299 * DT + 0.18, state[:3], state[3:6], 0.0)
    assert (tick.rung, tick.fault) == (Rung.SHIFTED, Fault.LATE)
    assert np.linalg.norm(tick.setpoint[:3] - state[:3]) < 0.18 * np.linalg.norm(state[3:6])


def test_a_measurement_is_compared_with_the_command_of_its_own_time() -> None:
    """An exact plant heard of 0.1 s late: told so, the tracker sees no offset; not told, it sees 0.1 s of way."""
    reference, corridor = flight(10.0)
    config = run_config(tracking=TrackingConfig(delay_s=0.0))
    worst = {}
    for told in (True, False):
        tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
        states = [np.concatenate([reference.xyz_m[0], np.zeros(9)])] * 6
        offsets = []
        for k in range(350):
            seen = states[-5]
            tick = tracker.tick(k * DT, seen[:3], seen[3:6], 5 * DT if told else 0.0)
            states.append(tick.setpoint)
            offsets.append(float(np.linalg.norm(tick.offset_m)))
        worst[told] = max(offsets)
    assert worst[True] < 0.02
    assert worst[False] > 0.15


def test_a_plan_is_examined_where_the_vehicle_will_be_when_it_flies_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command is flown a delay later, so its first point belongs to the region of the reference at that time."""
    reference, corridor = flight(10.0)
    config = run_config(tracking=TrackingConfig(delay_s=0.2))
    looked_at: list[tuple[np.ndarray, np.ndarray]] = []

    def noted(*arguments: Any) -> Fault:
        looked_at.append((arguments[2], arguments[5]))
        return examine(*arguments)

    monkeypatch.setattr("sandwich_sitl.control.tracker.examine", noted)
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    state, differ = np.concatenate([reference.xyz_m[0], np.zeros(9)]), 0
    for k in range(400):
        state = tracker.tick(k * DT, state[:3], state[3:6], 0.0).setpoint
        at = k + round(0.2 / DT)
        assert looked_at[-1][1][0] == reference.region[at]
        differ += int(reference.region[at] != reference.region[k])
    assert differ > 50


def climb_and_go() -> Reference:
    """Six seconds of climb over the start, then the flight."""
    route, _ = flight()
    t = np.arange(0, 6.0, DT)
    share = t / 6.0
    up = 10.0 * share**3 * (10 - 15 * share + 6 * share**2)
    start = np.column_stack([np.tile(route.xyz_m[0, :2], (len(t), 1)), up])
    xyz = np.concatenate([start, route.xyz_m])
    return Reference(np.arange(len(xyz)) * DT, xyz, np.concatenate([np.zeros(len(t), np.int64), route.region]))


def test_the_reference_waits_for_a_vehicle_that_is_slow_to_leave_the_ground() -> None:
    reference, (_, corridor) = climb_and_go(), flight()
    config = run_config()
    ground = reference.xyz_m[0]
    tracker = Tracker(config, mpc_of(config), reference, corridor, ground)
    for k in range(100):  # two seconds of spooling up
        tick = tracker.tick(k * DT, ground, np.zeros(3), 0.0)
        assert tick.setpoint[5] > 0.3
        assert tick.desired_m[2] == 0.0
        assert tick.rung is Rung.PLAN
        np.testing.assert_allclose(tick.setpoint[:2], ground[:2], atol=1e-6)
    r, v, errors = ground.copy(), np.array([0.0, 0.0, 0.5]), []
    for k in range(100, 400):
        tick = tracker.tick(k * DT, r, v, 0.0)
        errors.append(np.linalg.norm(r - tick.desired_m))
        r, v = (r + DT * v, v) if r[2] < 0.18 else (tick.setpoint[:3], tick.setpoint[3:6])
    assert max(errors) < 0.12
    assert r[2] > 3.0


@pytest.mark.parametrize("height_m", [4.0, 9.9, 10.2])
def test_a_vehicle_in_the_air_already_is_met_at_its_height(height_m: float) -> None:
    """ArduPilot has taken off by itself before tracking begins, and may be a little too high."""
    reference, (_, corridor) = climb_and_go(), flight()
    config, there = run_config(), np.array([*reference.xyz_m[0, :2], height_m])
    tracker = Tracker(config, mpc_of(config), reference, corridor, there)
    tick = tracker.tick(0.0, there, np.zeros(3), 0.0)
    assert tick.desired_m[2] == pytest.approx(min(height_m, 10.0), abs=0.06)
    assert tick.setpoint[2] == pytest.approx(height_m, abs=0.01)


def test_a_vehicle_too_high_for_its_first_floor_still_begins_at_the_start() -> None:
    """The reference comes to the vehicle's height much later too, on its way to the next floor: not there."""
    level, (_, corridor) = climb_and_go(), flight()
    rising = level.xyz_m + np.outer(0.4 * level.xyz_m[:, 0], [0.0, 0.0, 1.0])
    reference, config = dataclasses.replace(level, xyz_m=rising), run_config()
    there = np.array([*reference.xyz_m[0, :2], 10.3])
    tick = Tracker(config, mpc_of(config), reference, corridor, there).tick(0.0, there, np.zeros(3), 0.0)
    np.testing.assert_allclose(tick.desired_m, [*reference.xyz_m[0, :2], 10.0], atol=0.06)


def test_wind_is_countered_from_the_moment_the_ground_lets_go() -> None:
    """A vehicle blown aside while it leaves the ground: the plan leans against it before it counts as flying."""
    reference, (_, corridor) = climb_and_go(), flight()
    config, ground = run_config(), reference.xyz_m[0]
    tracker = Tracker(config, mpc_of(config), reference, corridor, ground)
    for k in range(50):
        tracker.tick(k * DT, ground, np.zeros(3), 0.0)
    for k in range(50, 65):  # 0.3 s, up to 0.15 m
        t = (k - 49) * DT
        r = ground + np.array([0.0, 0.5 * 1.4 * t * t, 0.5 * t])
        tick = tracker.tick(k * DT, r, np.array([0.0, 1.4 * t, 0.5]), 0.0)
        assert tick.setpoint[5] > 0.3
    assert tick.setpoint[4] < -0.05
    assert tick.setpoint[7] < -0.5


GROUND_M = 0.7


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
    pilot.accepted(0.0)
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
        pilot.accepted(now)
        assert steering.tick is not None or stream is not Stream.TRACK
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
    assert changes.max() <= (3.0 + MPC.acceleration_mps2) * DT + 1e-9  # brake_mps2 beside what the plan does
    assert speeds[-20:].max() == 0.0
    assert not pilot.plan_stale(now)


def test_braking_starts_from_the_last_set_point_that_went_out() -> None:
    """What the fence has refused, whatever it was, was never asked of the vehicle."""
    reference, corridor = flight()
    climb = Reference(reference.t_s, reference.xyz_m - (0.0, 0.0, 10.0), reference.region)
    pilot = Pilot(run_config(), climb, corridor)
    r, v = np.array([0.0, 0.0, GROUND_M]), np.zeros(3)
    for k in range(300):
        setpoint = pilot.steer(Stream.POSE if k < 20 else Stream.TRACK, k * DT, view_of(r, v, k * DT)).setpoint
        assert setpoint is not None
        if k < 250:
            pilot.accepted(k * DT)
            r, v = setpoint.r_m, setpoint.v_mps
    assert pilot.plan_stale(300 * DT)
    braking = pilot.steer(Stream.BRAKE, 300 * DT, view_of(r, v, 300 * DT)).setpoint
    assert braking is not None
    np.testing.assert_allclose(braking.r_m, r, atol=1e-9)
    np.testing.assert_allclose(braking.v_mps, v, atol=1e-9)
    assert np.linalg.norm(v) > 1.0


@pytest.mark.parametrize("cause", ["refused", "astray"])
def test_pilot_gives_up_a_plan_that_is_not_sent_or_not_followed(cause: str) -> None:
    """Nothing accepted, or the vehicle standing still while the reference leaves: stale, so the mission brakes."""
    reference, corridor = flight(20.0)
    config = run_config()
    config = dataclasses.replace(config, mission=dataclasses.replace(config.mission, lost_track_m=1.0))
    pilot = Pilot(config, reference, corridor)
    stale_at = None
    for k in range(600):
        pilot.steer(Stream.TRACK, k * DT, view_of(reference.xyz_m[0], np.zeros(3), k * DT))
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


def test_a_tick_that_comes_late_is_not_a_plan_that_was_refused() -> None:
    """This process was away for half a second; nothing was refused meanwhile."""
    reference, corridor = flight(20.0)
    pilot = Pilot(run_config(), reference, corridor)
    r, v = reference.xyz_m[0], np.zeros(3)
    for k in range(20):
        setpoint = pilot.steer(Stream.TRACK, k * DT, view_of(r, v, k * DT)).setpoint
        pilot.accepted(k * DT)
        assert setpoint is not None
        r, v = setpoint.r_m, setpoint.v_mps
    assert not pilot.plan_stale(19 * DT + STALE_S + 0.2)
    pilot.steer(Stream.TRACK, 19 * DT + STALE_S + 0.2, view_of(r, v, 19 * DT + STALE_S + 0.2))
    assert not pilot.plan_stale(19 * DT + STALE_S + 0.2)


def test_pilot_tells_a_stale_plan_and_a_finished_route() -> None:
    """Blind, the pilot first slows down along its last plan, then has none; a route ends when its clock and the vehicle do."""
    reference, corridor = flight()
    pilot = Pilot(run_config(), reference, corridor)
    good = view_of(reference.xyz_m[0], np.zeros(3), 0.0)
    pilot.steer(Stream.TRACK, 0.0, good)
    pilot.accepted(0.0)
    assert not pilot.route_finished(good)
    broken = view_of(np.full(3, np.nan), np.zeros(3), 0.0)
    for k in range(1, 80):
        steering = pilot.steer(Stream.TRACK, k * DT, broken)
        pilot.accepted(k * DT)
        assert steering.setpoint is not None
        assert steering.tick is not None
        assert pilot.plan_stale(k * DT) == (steering.tick.rung is Rung.BRAKE)
    assert pilot.plan_stale(80 * DT)
    pilot = Pilot(run_config(), reference, corridor)
    r, v = reference.xyz_m[0], np.zeros(3)
    for k in range(len(reference.t_s) + 5):
        setpoint = pilot.steer(Stream.TRACK, k * DT, view_of(r, v, k * DT)).setpoint
        assert setpoint is not None
        assert setpoint.r_m is not None
        assert setpoint.v_mps is not None
        r, v = setpoint.r_m, setpoint.v_mps
        assert not pilot.route_finished(view_of(r, v, k * DT)) or k * DT >= reference.t_s[-1]
    assert pilot.route_finished(view_of(reference.xyz_m[-1], np.zeros(3), 13.0))
    assert not pilot.route_finished(view_of(reference.xyz_m[-1], np.array([1.0, 0, 0]), 13.0))
    assert not pilot.route_finished(view_of(reference.xyz_m[-1] + (1.0, 0, 0), np.zeros(3), 13.0))
