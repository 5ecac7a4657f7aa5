"""The Rerun recording holds what was flown; it verifies, has its blueprint, and can be drawn without a screen."""

import ctypes.util
import io
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
import rerun.chunk
import run_samples

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.viewing.replay import replay, viewer_command

DEADLINE_S = 60.0
VIEW_CLASSES = {"3D": 1, "2D": 2, "TimeSeries": 4, "StateTimeline": 1, "TextLog": 1}


@pytest.fixture(scope="module")
def recording(run_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "run.rrd"
    replay(run_path, path)
    return path


@pytest.fixture(scope="module")
def entities(recording: Path) -> dict[str, list[Any]]:
    """Chunks of the recording's data by entity path."""
    found: dict[str, list[Any]] = {}
    for chunk in rerun.chunk.RrdReader(recording).stream():
        found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    return found


def column(entities: dict[str, list[Any]], entity: str, name: str) -> list[Any]:
    """Values of one component over time, with its times in seconds, in order of time."""
    rows: list[tuple[float, Any]] = []
    for batch in entities[entity]:
        names = [n for n in batch.schema.names if n.endswith(name)]
        if names and "time" in batch.schema.names:
            times = [t_ns / 1e9 for t_ns in batch.column("time").cast("int64").to_pylist()]
            rows += zip(times, batch.column(names[0]).to_pylist(), strict=True)
    return sorted(rows, key=lambda row: row[0])


def test_the_vehicle_is_where_the_truth_was(run_path: Path, entities: dict[str, list[Any]]) -> None:
    truth = RunLog.read(run_path).truth
    rows = column(entities, "/world/vehicle", ":translation")
    np.testing.assert_allclose([t for t, _ in rows], truth.t_s, atol=1e-6)
    np.testing.assert_allclose([value[0] for _, value in rows], truth.r_m, atol=1e-5)
    flat = [value[0] for _, value in column(entities, "/motion/vehicle", ":positions")]
    np.testing.assert_allclose(flat, truth.r_m[:, :2] * [1.0, -1.0], atol=1e-5)


def test_series_and_states_hold_the_logged_values(run_path: Path, entities: dict[str, list[Any]]) -> None:
    log = RunLog.read(run_path)
    error = column(entities, "/series/error_m", ":scalars")
    np.testing.assert_allclose([value[0] for _, value in error], run_samples.OFFSET_M, atol=1e-9)
    snap = column(entities, "/series/snap/y", ":scalars")
    np.testing.assert_array_equal([value[0] for _, value in snap], log.control.snap_mps4[:, 1])
    solve = column(entities, "/series/wall_ms/solve", ":scalars")
    np.testing.assert_allclose([value[0] for _, value in solve], log.timings.solve_s * 1e3)
    states = column(entities, "/mission/state", ":state")
    assert [value[0] for _, value in states] == list(log.mission.state)
    assert [value[0] for _, value in column(entities, "/log", ":level")] == ["INFO", "WARN"]


def test_everything_of_the_plan_is_drawn(entities: dict[str, list[Any]]) -> None:
    for entity in (
        "/world/obstacles/diamond", "/world/map/dividing_streamlines", "/world/route/sandwich", "/world/flown",
        "/world/region", "/world/horizon", "/motion/obstacles", "/motion/route/grid_astar", "/motion/route/exact",
        "/planning/barred", "/planning/route", "/planning/flown", "/planning/vehicle",
    ):  # fmt: skip
        assert entity in entities, entity
    assert len(column(entities, "/world/region", ":strips")) == 3


def test_rerun_verifies_the_file(recording: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_cut_or_one_sided_log_is_shown_too(run_path: Path, tmp_path: Path) -> None:
    data = run_path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) * 2 // 3])
    replay(cut, tmp_path / "cut.rrd")
    replay(run_samples.write_vehicle(tmp_path / "v.mcap"), tmp_path / "v.rrd")
    assert (tmp_path / "cut.rrd").stat().st_size > 0


def test_a_world_without_obstacles_is_shown_too(tmp_path: Path) -> None:
    replay(run_samples.write_run(tmp_path, run_samples.small_plan(obstacles=False)), tmp_path / "open.rrd")
    assert (tmp_path / "open.rrd").stat().st_size > 0


def test_bad_paths_are_refused(run_path: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        replay(tmp_path / "none.mcap", tmp_path / "x.rrd")
    with pytest.raises(InputError, match="does not exist"):
        replay(run_path, tmp_path / "none" / "x.rrd")


def test_the_control_process_does_not_load_the_viewer() -> None:
    """Recording, and even the viewing modules themselves, load without Rerun."""
    modules = "sandwich_sitl.recording.recorder, sandwich_sitl.viewing.replay, sandwich_sitl.viewing.live, sys"
    program = f"import {modules}; assert 'rerun' not in sys.modules"
    root = str(Path(__file__).parents[2])
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60, env={**os.environ, "PYTHONPATH": root})


@pytest.fixture
def headless() -> Iterator[Any]:
    """A client of a viewer without a screen."""
    missing = [name for name in ("vulkan", "EGL") if ctypes.util.find_library(name) is None]
    if missing or not any(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json")):
        pytest.skip("needs a software renderer: apt install mesa-vulkan-drivers libvulkan1 libegl1")
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [*viewer_command(str(port)), "--headless", "--window-size", "1200x800"]
    viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        wait_for(lambda: can_connect(port))
        yield ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    finally:
        os.killpg(viewer.pid, signal.SIGTERM)
        viewer.wait(20)


def test_a_headless_picture_is_not_blank_and_every_view_is_well(headless: Any, recording: Path) -> None:
    headless.open(str(recording))
    wait_for(lambda: len(headless.get_state().views) == sum(VIEW_CLASSES.values()))
    picture = steady_picture(headless)
    assert len(np.unique((picture[..., :3] * 255).astype(np.uint8).reshape(-1, 3), axis=0)) > 200
    scene, spaces = picture[40:470, :700, :3], picture[490:760, :700, :3]
    assert scene.std() > 0.02
    assert spaces.std() > 0.02
    views = headless.get_state().views
    assert {name: sum(view.view_class == name for view in views) for name in VIEW_CLASSES} == VIEW_CLASSES
    assert [report for view in views for report in view.reports] == []


def steady_picture(client: Any) -> np.ndarray:
    """Screenshots until two agree."""
    pictures: list[bytes] = []

    def agree() -> bool:
        pictures.append(client.take_screenshot())
        return len(pictures) > 2 and pictures[-1] == pictures[-2]

    wait_for(agree, pause_s=0.5)
    return matplotlib.image.imread(io.BytesIO(pictures[-1]), format="png")


def can_connect(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_for(holds: Callable[[], bool], pause_s: float = 0.1) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not holds():
        assert time.monotonic() < deadline, "did not happen in time"
        time.sleep(pause_s)
