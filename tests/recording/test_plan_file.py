"""A plan that is saved and loaded is the same plan, in the same bytes."""

import dataclasses
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import run_samples

from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.plan_file import load_plan, plan_bytes, plan_from_bytes, save_plan


def assert_same(a: Any, b: Any) -> None:
    """Field by field, arrays exactly and with their types."""
    assert type(a) is type(b)
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            if field.name != "seconds":
                assert_same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    else:
        assert a == b


@pytest.mark.parametrize("obstacles", [True, False])
def test_round_trip(tmp_path: Path, obstacles: bool) -> None:
    plan = run_samples.small_plan(obstacles=obstacles)
    save_plan(plan, tmp_path / "plan.npz")
    assert_same(plan, load_plan(tmp_path / "plan.npz"))


def test_floors_make_the_round_trip_too() -> None:
    plan = run_samples.plan_with_floors(7.0)
    read = plan_from_bytes(plan_bytes(plan))
    assert plan_bytes(read) == plan_bytes(plan)
    assert plan.floors is not None
    assert read.floors is not None
    assert read.floors.figures[1] == plan.floors.figures[1]
    assert_same(read.corridor, plan.corridor)


def test_equal_plans_give_equal_bytes_whatever_their_wall_times() -> None:
    plan = run_samples.small_plan()
    assert plan_bytes(plan) == plan_bytes(dataclasses.replace(run_samples.small_plan(), seconds={"map": 9.0}))
    assert plan_bytes(plan) != plan_bytes(dataclasses.replace(plan, altitude_m=11.0))


def test_numpy_alone_reads_the_file() -> None:
    with np.load(io.BytesIO(plan_bytes(run_samples.small_plan())), allow_pickle=False) as archive:
        assert archive["map_nodes"].shape == (2 * 41 * 7, 2)
        assert archive["map_rows"].tolist() == [7, 7]


def _pickled() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, header=np.array([{"a": 1}], dtype=object))
    return buffer.getvalue()


def _other_archive() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, other=np.zeros(3))
    return buffer.getvalue()


@pytest.mark.parametrize(
    "data",
    [b"", b"not a zip", plan_bytes(run_samples.small_plan())[:-30], _pickled(), _other_archive()],
    ids=["empty", "text", "cut", "pickled", "other"],
)
def test_bad_bytes_are_refused_with_their_source(data: bytes) -> None:
    with pytest.raises(InputError, match=r"^here\.npz: is not a flight plan"):
        plan_from_bytes(data, "here.npz")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_plan(tmp_path / "none.npz")
