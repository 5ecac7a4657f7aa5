"""The fallback ladder flown: the offboard loop in this process, the vehicle in its own, a solver that fails on cue."""

import dataclasses
import json
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from sandwich_sitl.config import RunConfig, load_config
from sandwich_sitl.control.assurance import Fault
from sandwich_sitl.control.horizon import Horizon, HorizonAnswer, HorizonSolver, HorizonTick
from sandwich_sitl.control.solvers.registry import solver_for_flight
from sandwich_sitl.launcher import make_plan
from sandwich_sitl.link.wire import Frame, FrameSplitter
from sandwich_sitl.progress import Progress
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.summary import clearance_m, summarise
from sandwich_sitl.run import FlightResult, Observers, fly

from ..control.flights import failing_when
from .conftest import Process, free_port

Start = Callable[..., Process]


class Spoiled:
    """A solver whose answers of the ticks `spoiled` are taken from `spoil`; that of the height is left alone."""

    def __init__(self, solver: HorizonSolver, spoiled: range, spoil: Callable[[HorizonAnswer], HorizonAnswer]) -> None:
        self._solver, self._spoiled, self._spoil, self._k = solver, spoiled, spoil, -1

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        self._k += 1
        answer = self._solver.solve(tick)
        return self._spoil(answer) if self._k in self._spoiled and tick.state.shape[1] == 2 else answer


def moved(quantity: int, by: float) -> Callable[[HorizonAnswer], HorizonAnswer]:
    """An answer whose r, v, a or j runs away sideways over the horizon, by so much at its end."""

    def spoil(answer: HorizonAnswer) -> HorizonAnswer:
        motion = answer.motion.copy()
        motion[quantity, :, 1] += np.linspace(0.0, by, motion.shape[1])
        return dataclasses.replace(answer, motion=motion)

    return spoil


def raising(_: HorizonAnswer) -> HorizonAnswer:
    raise ValueError("arrays do not fit")


def not_finite(answer: HorizonAnswer) -> HorizonAnswer:
    return dataclasses.replace(answer, snap=np.full_like(answer.snap, np.nan))


class Relay:
    """UDP between vehicle and offboard process, which loses the positions of some seconds of the vehicle's clock."""

    def __init__(self, offboard_port: int, from_s: float, to_s: float) -> None:
        self._lost_ms = range(round(1e3 * from_s), round(1e3 * to_s))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self._offboard = ("127.0.0.1", offboard_port)
        self._open, self.lost = True, 0
        self._thread = threading.Thread(target=self._pass_on, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    def close(self) -> None:
        self._open = False
        self._thread.join(timeout=5.0)
        self._socket.close()

    def _pass_on(self) -> None:
        vehicle: tuple[str, int] | None = None
        splitter = FrameSplitter()
        while self._open:
            try:
                data, sender = self._socket.recvfrom(65535)
            except TimeoutError:
                continue
            if sender != self._offboard:
                vehicle = sender
                data = b"".join(frame.raw for frame in splitter.feed_datagram(data) if not self._loses(frame))
            target = self._offboard if sender == vehicle else vehicle
            if data and target is not None:
                self._socket.sendto(data, target)

    def _loses(self, frame: Frame) -> bool:
        """LOCAL_POSITION_NED begins with its time in milliseconds."""
        lost = frame.message_id == 32 and int.from_bytes(frame.raw[10:14], "little") in self._lost_ms
        self.lost += lost
        return lost


class Watch:
    """Notes the mission's states; asks to stop when the state `stop_at` or the time `stop_s` has come."""

    def __init__(self, stop_at: str | None = None, stop_s: float = np.inf) -> None:
        self.states: list[str] = []
        self._stop_at, self._stop_s, self._now_s = stop_at, stop_s, 0.0

    def __call__(self, now_s: float, state: str, text: str) -> None:
        del text
        self._now_s = now_s
        if not self.states or self.states[-1] != state:
            self.states.append(state)

    def stop_requests(self) -> int:
        return int(self._stop_at in self.states or self._now_s >= self._stop_s)


def flown(
    start: Start,
    config_path: Path,
    out: Path,
    make_solver: Callable[[str, Horizon], HorizonSolver],
    watch: Watch,
    relay_to: Callable[[int], int] = lambda port: port,
    **mission: float,
) -> tuple[RunLog, FlightResult, RunConfig]:
    port = free_port()
    config = load_config(config_path, {"link.uri": f"udpin://127.0.0.1:{port}"})
    config = dataclasses.replace(config, mission=dataclasses.replace(config.mission, **mission))
    with Progress() as progress:
        plan = make_plan(config, config_path, progress)
    vehicle = start(
        "vehicle_sim", str(config_path), "--connect", f"udpout://127.0.0.1:{relay_to(port)}", "--bind", "127.0.0.1:0",
        "--log", str(out / "vehicle.mcap"),
    )  # fmt: skip
    vehicle.wait_for("ready")
    with RunRecorder(out / "offboard.mcap", flush_s=1.0, metadata={"name": config.name}) as recorder:
        recorder.plan(0.0, plan)
        result = fly(config, plan, Observers(recorder, watch), watch.stop_requests, make_solver)
        recorder.metadata("result", {"outcome": str(result.outcome.outcome), "reason": result.outcome.reason})
    return RunLog.read(out / "offboard.mcap"), result, config


def test_a_solver_that_fails_for_good_ends_held_and_lands_on_request(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    watch = Watch("HOLD")
    log, result, config = flown(start, short_config, tmp_path, failing_when(lambda k: k >= 580), watch)
    assert (result.outcome.outcome, result.outcome.exit_status) == ("held", 6)
    assert watch.states[watch.states.index("ACTIVE") :] == ["ACTIVE", "BRAKE", "HOLD", "LAND", "DONE"]
    rung = log.control.rung
    assert rung.tolist() == sorted(rung.tolist())  # down the ladder only
    assert (rung == 1).sum() > 30
    assert (rung == 2).sum() >= 1
    speed = np.linalg.norm(log.control.setpoint_v_mps, axis=1)
    assert speed[rung == 0][-1] > 2.0
    assert speed[-1] < 1e-6
    lines = [line.message for line in log.lines if "assurance" in line.message]
    assert len(lines) == 2
    assert "slowing down" in lines[0]
    assert "braking" in lines[1]
    summary = summarise(log)
    assert json.dumps(summary)
    assert summary["outcome"] == "held"
    assert summary["assurance"]["fallbacks"] == 1
    assert summary["assurance"]["faults"] == {"the solver gave no answer": int((rung > 0).sum())}
    assert not log.mission.armed[-1]
    clearance = clearance_m(log.control.estimate_r_m[:, :2], log.plan)
    assert clearance is not None
    assert clearance > config.planner.vehicle_radius_m


def test_a_held_vehicle_that_nobody_asks_for_lands_by_itself(start: Start, short_config: Path, tmp_path: Path) -> None:
    watch = Watch()
    log, result, _ = flown(start, short_config, tmp_path, failing_when(lambda k: k >= 450), watch, hold_s=3.0)
    assert result.outcome.outcome == "held"
    states = dict(zip(log.mission.state, log.mission.t_s, strict=True))
    assert states["LAND"] - states["HOLD"] == pytest.approx(3.0, abs=0.1)


def test_a_solver_that_fails_now_and_then_still_brings_the_vehicle_to_the_goal(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    watch = Watch()
    broken = lambda k: k % 50 in (3, 4, 5) or 600 <= k < 660  # noqa: E731
    log, result, config = flown(start, short_config, tmp_path, failing_when(broken), watch)
    assert result.outcome.outcome == "landed"
    summary = summarise(log)
    assert summary["assurance"]["brake"] == 0
    assert summary["assurance"]["fallbacks"] == summary["assurance"]["recoveries"] > 10
    crate = shapely.box(17, 8, 23, 15)
    points = shapely.points(log.control.estimate_r_m[:, :2])
    assert shapely.distance(points, crate).min() > config.planner.vehicle_radius_m


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (raising, Fault.RAISED),
        (not_finite, Fault.NOT_FINITE),
        (moved(0, 40.0), Fault.REGION),
        (moved(1, 40.0), Fault.LIMITS),
    ],
    ids=lambda value: value.name if isinstance(value, Fault) else "",
)
def test_a_plan_that_fails_the_examination_is_not_flown_and_the_next_good_one_is(
    start: Start,
    short_config: Path,
    tmp_path: Path,
    spoil: Callable[[HorizonAnswer], HorizonAnswer],
    fault: Fault,
) -> None:
    watch = Watch()
    log, result, config = flown(
        start, short_config, tmp_path,
        lambda name, horizon: Spoiled(solver_for_flight(name, horizon), range(560, 590), spoil), watch,
    )  # fmt: skip
    assert result.outcome.outcome == "landed"
    assurance = summarise(log)["assurance"]
    assert assurance["faults"] == {str(fault): 30}
    assert (assurance["shifted"], assurance["brake"], assurance["fallbacks"], assurance["recoveries"]) == (30, 0, 1, 1)
    said = [line.message for line in log.lines if "assurance" in line.message]
    assert str(fault) in said[0]
    assert ("arrays do not fit" in said[0]) == (fault is Fault.RAISED)
    clearance = clearance_m(log.control.estimate_r_m, log.plan)
    assert clearance is not None
    assert clearance > config.planner.vehicle_radius_m


def test_a_flight_that_is_asked_to_stop_keeps_to_its_corridor_until_it_rests(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    watch = Watch(stop_s=20.0)
    log, result, _ = flown(start, short_config, tmp_path, solver_for_flight, watch)
    assert result.outcome.outcome == "interrupted"
    assert watch.states[watch.states.index("ACTIVE") :] == ["ACTIVE", "BRAKE", "HOLD", "LAND", "DONE"]
    stopping = np.array([fault == Fault.STOP for fault in log.control.fault])
    speed = np.linalg.norm(log.control.setpoint_v_mps, axis=1)
    assert speed[~stopping][-1] > 2.5
    assert speed[stopping][-1] < 0.5
    assert (log.control.rung[stopping] == 1).all()
    assert log.plan is not None
    corridor, region = log.plan.corridor, log.control.region[stopping]
    places = log.control.estimate_r_m[stopping, :2]
    excess = np.einsum("kfd,kd->kf", corridor.Lambda[region], places) - corridor.Gamma[region]
    assert excess.max() < 0.0
    assurance = summarise(log)["assurance"]
    assert (assurance["shifted"], assurance["fallbacks"], assurance["faults"]) == (0, 0, {})
    assert assurance["brake"] >= stopping.sum()


def test_a_flight_that_loses_sight_of_itself_slows_down_and_goes_on_when_it_sees_again(
    start: Start, short_config: Path, tmp_path: Path
) -> None:
    """0.9 s without LOCAL_POSITION_NED: blind from the age of half a second on."""
    relays: list[Relay] = []

    def relay_to(port: int) -> int:
        relays.append(Relay(port, 17.0, 17.9))
        return relays[-1].port

    watch = Watch()
    try:
        log, result, config = flown(
            start, short_config, tmp_path, solver_for_flight, watch, relay_to, lost_track_m=20.0
        )
    finally:
        for relay in relays:
            relay.close()
    assert relays[0].lost > 20
    assert result.outcome.outcome == "landed", (result.outcome.reason, watch.states)
    faults = summarise(log)["assurance"]["faults"]
    assert set(faults) == {str(Fault.BLIND)}
    assert 5 < faults[str(Fault.BLIND)] < 40
    clearance = clearance_m(log.control.estimate_r_m, log.plan)
    assert clearance is not None
    assert clearance > config.planner.vehicle_radius_m


def test_no_plan_from_the_start_is_no_flight(start: Start, short_config: Path, tmp_path: Path) -> None:
    """Every solve fails: the vehicle leaves the ground as asked, then brakes, holds low above the start and lands."""
    watch = Watch("HOLD")
    log, result, _ = flown(start, short_config, tmp_path, failing_when(lambda _: True), watch)
    assert result.outcome.outcome == "held"
    assert np.abs(log.control.estimate_r_m[:, :2] - (5, 11)).max() < 0.5
    assert log.control.estimate_r_m[:, 2].max() < 1.5
