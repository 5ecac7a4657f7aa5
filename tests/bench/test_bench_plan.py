"""`bench plan`: what it prints and writes agrees with what was measured, and nothing beats the optimum."""

import json
from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench.plan_bench import EXACT, GRID, SANDWICH, TIGHT, Score, WorldScores, table
from sandwich_sitl.cli import main

CONFIGS = Path(__file__).parents[2] / "configs"
MAP = "type octile\nheight 24\nwidth 32\nmap\n" + "\n".join(
    "".join("@" if (8 <= x < 12 and y < 16) or (20 <= x < 24 and y > 8) else "." for x in range(32)) for y in range(24)
)


def test_a_configuration_a_map_file_and_a_random_world(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid_map = tmp_path / "two_walls.map"
    grid_map.write_text(MAP + "\n")
    out = tmp_path / "scores.json"
    options = ["--random", "1", "--nodes", "3000", "--queries", "6", "--seed", "5", "--no-peers", "--json", str(out)]
    assert main(["bench", "plan", str(CONFIGS / "single.yaml"), str(grid_map), *options]) == 0
    printed = capsys.readouterr().out
    worlds = json.loads(out.read_text())
    assert [world["world"] for world in worlds] == ["single", "two_walls", "random 5"]
    for world in worlds:
        assert f"{world['world']}: {world['nodes']} nodes, 6 queries" in printed
        scores = {score["method"]: score for score in world["scores"]}
        exact = np.array(scores[EXACT]["lengths_m"])
        for score in scores.values():
            lengths = np.array(score["lengths_m"], dtype=float)
            assert len(lengths) == 6
            np.testing.assert_allclose(score["ratios"], lengths / exact)
            assert np.nanmin(score["ratios"]) >= 1 - 1e-6
        assert np.mean(scores[TIGHT]["ratios"]) <= 1.001
        assert (np.array(scores[TIGHT]["lengths_m"]) <= scores[SANDWICH]["lengths_m"]).all()
    assert "5.10 % of the existing A*'s, 5.37 % of the Sandwich A*'s; its text says 6.21 %" in printed


def test_table_of_known_numbers() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0]])
    scores = []
    for method, factor in ((EXACT, 1.0), (GRID, 1.1), (SANDWICH, 1.0)):
        score = Score(method)
        score.add(10.0, factor * line, 2.0)
        score.add(10.0, None if method == SANDWICH else factor * line, 4.0)
        scores.append(score)
    lines = table([WorldScores("w", 100, 2, {"map": 1.0}, tuple(scores))]).splitlines()
    assert lines[0] == "w: 100 nodes, 2 queries"
    assert lines[4].split() == ["grid", "A*", "1.10000", "1.1000", "1.1000", "0.0", "%", "0", "3.00", "3.98"]
    assert lines[5].split()[2:] == ["1.00000", "1.0000", "1.0000", "100.0", "%", "1", "3.00", "3.98"]
    assert "9.09 % of the existing A*'s, 10.00 % of the Sandwich A*'s; Sandwich shorter in 100.0 %" in lines[-1]
