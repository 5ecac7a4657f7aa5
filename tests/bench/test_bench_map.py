"""The bench of the channel map at sizes that take a moment."""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest
import shapely

from sandwich_sitl.bench import map_bench, map_peers
from sandwich_sitl.bench.child import ChildFailedError, in_child, peak_memory_mib
from sandwich_sitl.bench.map_bench import SizeFigures, growth, measure_size
from sandwich_sitl.bench.map_worlds import town, world_of
from sandwich_sitl.cli import main
from sandwich_sitl.errors import InputError

CONFIGS = Path(__file__).parents[2] / "configs"


def figures(nodes: int, whole_s: float) -> SizeFigures:
    return SizeFigures(nodes, nodes, 1.0, 1, 0, 1.0, (), whole_s, 0.0, {}, 1.0, whole_s / 2, "")


def test_a_town_is_its_seeds() -> None:
    one, same, other = town(3, 9), town(3, 9), town(4, 9)
    assert one == same
    assert one != other
    assert one.obstacles == 9
    assert 0.1 < 1 - one.grown.free_area_m2 / shapely.box(*one.grown.bounds_m).area < 0.4
    assert one.free_ground().area == pytest.approx(one.grown.free_area_m2)


def test_a_crowded_town_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sandwich_sitl.bench.map_worlds._APART_M", 30.0)
    with pytest.raises(InputError, match=r"only \d found a place"):
        town(1, 4)


def test_a_size_is_measured_whole() -> None:
    began = time.perf_counter()
    found = measure_size(town(3, 6), 8000, 2)
    elapsed = time.perf_counter() - began
    assert found.nodes == pytest.approx(8000, rel=0.3)
    assert found.failures == ()
    assert found.coverage == pytest.approx(1.0)
    assert 0 < found.whole_s < elapsed
    assert found.ratio is not None
    assert found.ratio > 0
    assert all(seconds > 0 for seconds in found.stages_s.values()), found.stages_s


def test_growth_is_the_slope_of_the_logarithms() -> None:
    sizes = [figures(nodes, 1e-5 * nodes**1.1) for nodes in (1000, 10_000, 100_000)]
    assert growth(sizes) == pytest.approx(1.1)
    assert growth(sizes[:1]) is None


def test_a_factorisation_that_does_not_fit_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def out_of_memory(_: int) -> float:
        raise MemoryError

    monkeypatch.setattr(map_bench, "factorise_s", out_of_memory)
    found = measure_size(town(3, 2), 500, 2)
    assert (found.splu_s, found.ratio, found.splu_problem) == (None, None, "does not fit in memory")


def test_a_child_answers_fails_and_is_ended() -> None:
    assert in_child(abs, -3, timeout_s=30.0) == 3
    with pytest.raises(ChildFailedError, match="ValueError: invalid literal"):
        in_child(int, "x", timeout_s=30.0)
    with pytest.raises(ChildFailedError, match=r"longer than 0\.5 s"):
        in_child(time.sleep, 60, timeout_s=0.5)
    with pytest.raises(ChildFailedError, match="ended by the system"):
        in_child(os._exit, 1, timeout_s=30.0)


def test_memory_is_counted() -> None:
    before = peak_memory_mib()
    block = np.ones(50 * 2**17)
    assert peak_memory_mib() >= before
    assert peak_memory_mib() > block.nbytes / 2**20


def test_the_navigation_mesh_covers_the_free_ground() -> None:
    world = town(3, 6)
    _, made = map_peers.navigation_mesh(world)
    triangles, shared = (int(words.split()[0]) for words in made.split(", "))
    ground = world.free_ground()
    corners = len(shapely.get_coordinates(ground)) - 1 - len(ground.interiors)
    # Euler: a triangulated polygon with n corners and h holes has n + 2h - 2 triangles and n + 3h - 3 inner sides.
    assert triangles == corners + 2 * len(ground.interiors) - 2
    assert shared == corners + 3 * len(ground.interiors) - 3


def test_a_missing_peer_is_named() -> None:
    def prepare(_: object) -> tuple[float, str]:
        raise ModuleNotFoundError(name="ompl")

    seconds, made = map_peers._prepared(prepare, town(3, 2))
    assert seconds is None
    assert made == "not installed (pip install 'sandwich-sitl[bench]')"


def test_the_command_prints_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.json"
    sizes = ["--nodes", "800,2000", "--repeat", "1", "--peer-timeout", "0"]
    assert main(["bench", "map", "--obstacles", "4", *sizes, "--json", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "town of seed 1" in printed
    assert "whole build grows as N^" in printed
    data = json.loads(path.read_text(encoding="utf-8"))
    assert [set(size["stages_s"]) == set(map_bench._STAGES) for size in data["sizes"]] == [True, True]
    assert data["load"]["seconds"] > 0
    assert data["update"]["failures"] == []
    assert 0 < data["update"]["median_s"] <= data["update"]["longest_s"]


def test_a_runs_world_is_grown_as_the_run_grows_it() -> None:
    world = world_of(CONFIGS / "single.yaml")
    (polygon,) = world.grown.polygons
    assert polygon.area == pytest.approx(18 * 18, rel=0.02)


@pytest.mark.parametrize("arguments", [["--nodes", "0"], ["--nodes", "many"], ["--repeat", "-1"]])
def test_bad_counts_are_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "map", *arguments])
    assert arguments[0] in capsys.readouterr().err
