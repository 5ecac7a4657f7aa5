"""A tick leaves nothing behind: no growing memory, nothing for the garbage collector to find."""

import dataclasses
import gc
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sandwich_sitl.control.assurance import Rung
from sandwich_sitl.control.horizon import SOLVED
from sandwich_sitl.control.tracker import Tracker
from sandwich_sitl.planning.corridor import FACES
from sandwich_sitl.planning.flight_plan import Corridor, Reference

from .flights import DT, MPC, mpc_of, quintic, run_config

_LEAK_TICKS = 10  # one block in so many ticks is a leak; what other tests leave behind comes to 60 in all
_NOISE_KIB = 1024
_RADIUS_M, _SPEED_MPS = 5.0, 2.0
_SECTORS = 12
_CUT_M = 0.05  # of the circle's apex over each region, so that the plan has to keep inside of its reference


@pytest.fixture
def no_collection() -> Iterator[None]:
    """The collector off, as in the loop."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def resident_kib() -> float:
    """Resident memory of this process now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1024


def round_and_round(ticks: int) -> tuple[Reference, Corridor]:
    """A circle at 10 m flown for so many ticks, in narrow regions across its chords."""
    t_s = DT * np.arange(ticks + 1)
    angle = np.cumsum(_SPEED_MPS * DT * quintic(np.minimum(t_s / 4.0, 1.0))) / _RADIUS_M
    xyz_m = np.column_stack([_RADIUS_M * np.cos(angle), _RADIUS_M * np.sin(angle), np.full_like(angle, 10.0)])
    width = 2 * np.pi / _SECTORS
    region = np.floor(angle / width).astype(np.int64) % _SECTORS
    middle = (np.arange(_SECTORS) + 0.5) * width
    outward, along = (np.column_stack([np.cos(turned), np.sin(turned)]) for turned in (middle, middle + np.pi / 2))
    normals = np.stack([outward, along, -outward, -along], axis=1)
    length_m = _RADIUS_M * np.sin(width / 2) + 0.7
    offsets_m = np.array([_RADIUS_M - _CUT_M, length_m, 0.6 - _RADIUS_M, length_m])
    faces = np.minimum(np.arange(FACES), 3)
    Lambda, Gamma = normals[:, faces], np.broadcast_to(offsets_m[faces], (_SECTORS, FACES)).copy()
    return Reference(t_s, xyz_m, region), Corridor(Lambda, Gamma, (), np.empty((0, 4, 2)))


def fly_on(tracker: Tracker, first: int, count: int) -> Counter[tuple[int, Rung]]:
    """Ticks of a noisy vehicle that follows its command; how often the solver ended how, and on which rung."""
    seen: Counter[tuple[int, Rung]] = Counter()
    for k in range(first, first + count):
        wobble = 0.02 * np.array([np.sin(k), np.cos(k), 0.0])
        tick = tracker.tick(k * DT, tracker.command[:3] + wobble, tracker.command[3:6], 0.0)
        seen[tick.solution.status, tick.rung] += 1
    return seen


@pytest.mark.usefixtures("no_collection")
@pytest.mark.parametrize(
    ("solver", "count"),
    [
        ("active_set", 1500),
        ("osqp", 2500),
        pytest.param("osqp", 50_000, marks=[pytest.mark.slow, pytest.mark.timeout(600)]),
    ],
)
def test_memory_and_garbage_do_not_grow_with_the_ticks(solver: str, count: int) -> None:
    """Blocks held by Python and resident memory after the first and after the second half of the ticks, in most of which
    rows bind and the solver has work to do.
    """
    first = 700
    reference, corridor = round_and_round(first + 2 * count)
    config = run_config(mpc=dataclasses.replace(MPC, solver=solver))
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    fly_on(tracker, 0, first)
    gc.collect()
    seen = fly_on(tracker, first, count)
    blocks, resident = sys.getallocatedblocks(), resident_kib()
    seen += fly_on(tracker, first + count, count)
    assert sys.getallocatedblocks() - blocks < count / _LEAK_TICKS
    assert resident_kib() - resident < _NOISE_KIB
    assert gc.collect() < 20
    assert seen[SOLVED, Rung.PLAN] > 0.5 * 2 * count
