"""What `bench tick` says of a tick, and of a ticker that waits as the loop does."""

from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench.tick import Deadlines, TickCost
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


def test_a_line_names_both_sides() -> None:
    line = Deadlines(50.0, "landed", 2000, 4, 12.3, 1, 2100, 8, 17.0).line()
    assert "2000 ticks, 4 began late" in line
    assert "bare ticker: 8 of 2100" in line


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
    late, ticks = int(words[words.index("began") - 1]), int(words[words.index("ticks") - 1])
    bare = int(words[words.index("ticker:") + 1])
    assert late <= 3 * bare + 0.02 * ticks
