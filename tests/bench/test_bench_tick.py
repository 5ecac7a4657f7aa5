"""What `bench tick` says of a tick, and of a ticker that waits as the loop does."""

from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench.tick import TickCost
from sandwich_sitl.bench.tick_realtime import Beside, Deadlines, Misses
from sandwich_sitl.cli import main

CONFIG = Path(__file__).parents[2] / "configs" / "single.yaml"
SHORT = ("start_m=[26,27]", "goal_m=[26,40]", "altitude_m=2")


def test_the_parts_make_up_the_whole() -> None:
    rng = np.random.default_rng(1)
    parts = rng.uniform(1.0, 100.0, (3, 1000))
    lines = TickCost(*parts).lines()
    assert len(lines) == 5
    assert "whole tick" in lines[-1]
    median, p99, p999, worst = (float(word) for word in lines[-1].split()[2:])
    whole = parts.sum(axis=0)
    assert median == pytest.approx(np.median(whole), abs=1.0)
    assert median <= p99 <= p999 <= worst == pytest.approx(whole.max(), abs=1.0)


def ticks(*late: tuple[float, float], until_s: float = 20.0) -> Misses:
    """Fifty ticks a second from 100 s on, each in time but those (after s, by ms)."""
    at_s = 100.0 + np.arange(0.0, until_s, 0.02)
    late_s = np.zeros_like(at_s)
    for after_s, by_ms in late:
        late_s[np.searchsorted(at_s, 100.0 + after_s - 1e-6)] = 1e-3 * by_ms
    return Misses(at_s, late_s)


def test_misses_are_compared_in_time_and_not_by_their_number() -> None:
    """As many misses on both sides: two at the same time, one in the next window, one by each alone."""
    flight = ticks((3.1, 4.0), (7.9, 9.0), (12.5, 2.0), (12.52, 3.0))
    ticker = ticks((3.6, 1.0), (8.1, 5.0), (17.0, 8.0))
    beside = Beside.of(flight, ticker)
    assert (beside.windows, beside.both, beside.ticker_alone, beside.flight_alone) == (20, 3, 1, 1)
    assert beside.both_ms == pytest.approx((9.0, 5.0))
    assert (beside.ticker_ms, beside.flight_ms) == pytest.approx((8.0, 3.0))
    line = Deadlines(50.0, "landed", 1000, 4, 1000, 3, beside).line()
    assert "4 of 1000 set-points after their period, bare ticker 3 of 1000" in line
    assert "flight alone 1 (3.0 ms)" in line


def test_what_the_ticker_misses_before_and_after_the_flight_is_none_of_its_windows() -> None:
    ticker = Misses(np.array([50.0, 99.5, 120.5, 150.0]), np.full(4, 0.03))
    assert Beside.of(ticks(), ticker) == Beside(20, 0, 0, 0, (0.0, 0.0), 0.0, 0.0)
    excused = Beside.of(ticks((0.5, 1.0), (19.5, 1.0)), ticker)
    assert (excused.both, excused.flight_alone) == (2, 0)


def test_the_ticks_of_a_flight_are_gone_through_again(capsys: pytest.CaptureFixture[str]) -> None:
    """The replayed pilot meets the same vehicle, so all its ticks cost something and none takes as long as a period."""
    settings = [word for pair in SHORT for word in ("--set", pair)]
    assert main(["bench", "tick", str(CONFIG), "--repeat", "1", *settings]) == 0
    head, *rows = capsys.readouterr().out.strip().splitlines()
    assert int(head.split()[0]) > 300
    median = float(rows[-1].split()[2])
    assert 20.0 < median < 5000.0
    assert main(["bench", "tick", str(CONFIG), "--realtime", "fast"]) == 2


@pytest.mark.slow
def test_real_time_is_kept_about_as_well_as_a_bare_ticker_keeps_it(capsys: pytest.CaptureFixture[str]) -> None:
    settings = [word for pair in SHORT for word in ("--set", pair)]
    assert main(["bench", "tick", str(CONFIG), "--realtime", "50", *settings]) == 0
    (line,) = capsys.readouterr().out.strip().splitlines()
    assert "landed" in line
    words = line.replace(",", "").split()
    windows, alone = int(words[words.index("windows") - 1]), int(words[words.index("flight") + 2])
    assert windows > 10
    assert alone <= 0.3 * windows
