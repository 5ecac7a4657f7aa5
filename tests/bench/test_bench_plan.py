"""`bench plan`: what it prints and writes agrees with what was measured, and nothing beats the optimum."""

import json
from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.bench.plan_bench import CLASS, EXACT, GRID, NARROW, SANDWICH, TIGHT, WIDE_GRID, Score, WorldScores
from sandwich_sitl.bench.plan_flights import FlightScores
from sandwich_sitl.bench.plan_peers import peers
from sandwich_sitl.bench.plan_table import table
from sandwich_sitl.bench.plan_worlds import random_world
from sandwich_sitl.cli import main
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.shortest import shortest_path

CONFIGS = Path(__file__).parents[2] / "configs"
MAP = "type octile\nheight 24\nwidth 32\nmap\n" + "\n".join(
    "".join("@" if (8 <= x < 12 and y < 16) or (20 <= x < 24 and y > 8) else "." for x in range(32)) for y in range(24)
)


def test_a_configuration_a_map_file_and_a_random_world(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid_map = tmp_path / "two_walls.map"
    grid_map.write_text(MAP + "\n")
    out = tmp_path / "scores.json"
    options = ["--random", "1", "--nodes", "3000", "--queries", "6", "--seed", "5", "--flights", "2", "--no-peers"]
    options += ["--json", str(out)]
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
        for flight in world["flights"]:
            assert len(flight["duration_ratio"]) + len(flight["refused"]) == 2
            assert flight["proven"] == len(flight["duration_ratio"])
            assert min(flight["duration_ratio"]) >= 0.999
            assert (np.array(flight["corridor_m2"]) > flight["quadrangle_m2"]).all()
            assert f"flown at {flight['speed_mps']:4.1f} m/s" in printed
    assert "5.10 % of the existing A*'s, 5.37 % of the Sandwich A*'s; its text says 6.21 %" in printed


def test_table_of_known_numbers() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0]])
    scores = []
    for method, factor in (
        (EXACT, 1.0),
        (GRID, 1.1),
        (WIDE_GRID, 1.02),
        (NARROW, 1.05),
        (SANDWICH, 1.0),
        (CLASS, 1.0),
        (TIGHT, 1.0),
    ):
        score = Score(method)
        score.add(10.0, factor * line, 2.0)
        score.add(10.0, None if method == SANDWICH else factor * line, 4.0)
        scores.append(score)
    flight = FlightScores(3.0, 2.0, [1.0, 1.1], [1.01, 1.03], [20.0, 30.0], [2.0, 4.0], [30.0, 40.0], 2)
    lines = table([WorldScores("w", 100, 2, {"map": 1.0}, tuple(scores), (flight,))]).splitlines()
    assert lines[0] == "w: 100 nodes, 2 queries"
    assert lines[4].split() == ["grid", "A*", "1.10000", "1.1000", "1.1000", "0.0", "%", "0", "3.00", "3.98"]
    assert lines[7].split()[2:] == ["1.00000", "1.0000", "1.0000", "100.0", "%", "1", "3.00", "3.98"]
    assert "duration/time-optimal 1.050, worst 1.100; curve/route 1.0200; corridor 25.0 m2 a step, quad" in lines[10]
    assert "9.09 % of the existing A*'s, 10.00 % of the Sandwich A*'s" in lines[-9]
    assert "shorter than grid A* in 100.0 % of queries, than grid A*, 16 neighbours in 100.0 %" in lines[-8]
    assert "mean 1.10000, p95 1.1000, worst 1.1000, 0 of 2 without a path" in lines[-6]
    assert lines[-3].endswith("worst 1.0000, 1 of 2 without a path")
    assert lines[-1].endswith("worst 1.0000, optimal homotopy class in 100.0 %, 0 of 2 without a path")


def test_the_same_question_to_every_peer_at_hand() -> None:
    """Exact peers are as short as the exact path; no peer that keeps off obstacles is shorter."""
    world = random_world(3, 0.3, 0.5)
    mesh = build_nav_mesh(world.grown)
    start, goal = np.array([12.0, 60.0]), np.array([190.0, 60.0])
    exact = shortest_path(mesh, start, goal)
    assert exact is not None
    for name, exactly in (("visibility graph", True), ("navmesh A*, funnel", False)):
        query = peers()[name](world.grown, 3000)
        assert query is not None
        points = query(start, goal)
        assert points is not None
        np.testing.assert_array_equal(points[[0, -1]], [start, goal])
        ratio = path_length(points) / exact.length_m
        assert ratio >= 1 - 1e-6
        assert ratio <= (1 + 1e-6 if exactly else 1.3)


def test_a_world_without_ground_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    closed = tmp_path / "closed.map"
    rows = ["@" * 12, *["@" + "." * 10 + "@"] * 10, "@" * 12]
    closed.write_text("type octile\nheight 12\nwidth 12\nmap\n" + "\n".join(rows) + "\n")
    assert main(["bench", "plan", str(closed), "--random", "0"]) == 2
    assert "closed: nothing is free once obstacles are grown by 0.8 m" in capsys.readouterr().err
