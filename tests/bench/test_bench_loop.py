"""The loop's bench: every instant in one part, and figures of a real flight on both sides."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench.loop import WAIT, LoopFlight, fly
from sandwich_sitl.bench.loop_peer import fly_rotorpy
from sandwich_sitl.bench.loop_realtime import bare_ticker
from sandwich_sitl.bench.stopwatch import REST, Parts, Stopwatch
from sandwich_sitl.cli import main
from sandwich_sitl.link.transport import UdpTransport
from sandwich_sitl.planning.flight_plan import Reference
from tests.closed_loop.conftest import SHORT


class Work:
    """Spends processor time and sleep in known shares."""

    def outer(self) -> None:
        self.burn(0.004)
        self.inner()

    def inner(self) -> None:
        time.sleep(0.01)

    def tick(self) -> None:
        self.outer()

    @staticmethod
    def burn(seconds: float) -> None:
        end = time.thread_time() + seconds
        while time.thread_time() < end:
            pass


def test_parts_leave_out_the_parts_within_them_and_add_up_to_the_tick() -> None:
    watch, work = Stopwatch(), Work()
    watch.around(work, "outer", "outer")
    watch.around(work, "inner", "inner")
    watch.around(work, "tick", "tick", ends_tick=True)
    work.tick()  # the first tick began before the loop did and is left out
    begin = time.perf_counter()
    for _ in range(5):
        work.tick()
    whole = time.perf_counter() - begin
    parts = watch.parts()
    assert sum(wall.sum() for wall in parts.wall_s.values()) == pytest.approx(whole, rel=0.05)
    assert parts.cpu_s["outer"].mean() == pytest.approx(0.004, rel=0.1)
    assert (parts.wall_s["inner"] >= 0.01).all()
    assert parts.cpu_s["inner"].max() < 0.002
    assert {len(wall) for wall in parts.wall_s.values()} == {5}


def test_parts_survive_their_file(tmp_path: Path) -> None:
    parts = Parts({"a": np.arange(3.0), "b": np.ones(3)}, {"a": np.zeros(3), "b": np.full(3, 2.0)})
    np.savez(tmp_path / "parts.npz", **parts.arrays())
    with np.load(tmp_path / "parts.npz") as data:
        again = Parts.load(data)
    for clock, same in ((parts.wall_s, again.wall_s), (parts.cpu_s, again.cpu_s)):
        assert list(clock) == list(same)
        assert all(np.array_equal(clock[name], same[name]) for name in clock)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> LoopFlight:
    folder = tmp_path_factory.mktemp("loop")
    (folder / "short.yaml").write_text(SHORT, encoding="utf-8")
    return fly(folder / "short.yaml", {}, folder, timed=True)


def test_both_sides_are_timed_tick_by_tick(flown: LoopFlight) -> None:
    for side in (flown.offboard, flown.vehicle):
        walls = side.parts.wall_s
        assert walls[WAIT].size == pytest.approx(flown.simulated_s / flown.period_s, abs=5)
        assert 0.0 < sum(wall.sum() for wall in walls.values()) <= flown.wall_s  # which has start and end besides
        assert all(side.parts.cpu_s[part].sum() > 0.0 for part in walls)
        assert side.parts.cpu_s[REST].mean() < 1e-3


def test_figures_of_a_flight_and_the_classes_as_before(flown: LoopFlight) -> None:
    assert 38.0 < flown.simulated_s < 45.0
    assert flown.factor == pytest.approx(flown.simulated_s / flown.wall_s)
    assert all(0.0 < spent < 1e6 for spent in flown.processor_us)
    assert flown.others < os.cpu_count()
    assert not hasattr(UdpTransport.receive, "__wrapped__")


def test_a_peer_that_is_not_there_is_named_with_the_reason() -> None:
    reference = Reference(np.arange(9.0), np.zeros((9, 3)), np.zeros(9, dtype=np.int64))
    assert "tools/install_clients.sh" in fly_rotorpy(None, reference, 1.0)
    assert "not measured" in fly_rotorpy("/nowhere/python", reference, 1.0)


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "short.yaml").write_text(SHORT, encoding="utf-8")
    for options, part in (
        (["--solver", "none"], "mpc.solver"),
        (["--set", "x"], "--set"),
        (["--rotorpy", "/nowhere/python"], "--rotorpy"),
    ):
        assert main(["bench", "loop", str(tmp_path / "short.yaml"), *options]) == 2
        said = capsys.readouterr().err.strip()
        assert part in said
        assert "\n" not in said


def test_the_bare_ticker_keeps_its_schedule() -> None:
    began = time.monotonic()
    assert "p99.9" in bare_ticker(0.2)
    assert 0.2 <= time.monotonic() - began < 5.0
