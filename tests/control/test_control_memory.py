"""A tick leaves nothing behind: no growing memory, nothing for the garbage collector to find."""

import dataclasses
import gc
import resource
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from sandwich_sitl.control.tracker import Tracker

from .flights import DT, MPC, flight, mpc_of, run_config

_NOISE_BLOCKS = 30
_NOISE_KIB = 1024


@pytest.fixture
def no_collection() -> Iterator[None]:
    """The collector off, as in the loop."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def peak_kib() -> int:
    """Largest resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def fly_on(tracker: Tracker, first: int, count: int) -> None:
    """Ticks round and round: a noisy vehicle that follows its command."""
    for k in range(first, first + count):
        wobble = 0.02 * np.array([np.sin(k), np.cos(k), 0.0])
        tracker.tick(k * DT, tracker.command[:3] + wobble, tracker.command[3:6], 0.0)


@pytest.mark.usefixtures("no_collection")
@pytest.mark.parametrize(
    ("solver", "count"),
    [("active_set", 1500), ("osqp", 1500), pytest.param("active_set", 50_000, marks=pytest.mark.slow)],
)
def test_memory_and_garbage_do_not_grow_with_the_ticks(solver: str, count: int) -> None:
    """Blocks held by Python after the first and after the second half of the ticks; resident memory of the process."""
    reference, corridor = flight()
    config = run_config(mpc=dataclasses.replace(MPC, solver=solver))
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    fly_on(tracker, 0, 700)
    gc.collect()
    fly_on(tracker, 700, count)
    blocks, resident = sys.getallocatedblocks(), peak_kib()
    fly_on(tracker, 700 + count, count)
    assert sys.getallocatedblocks() - blocks < _NOISE_BLOCKS
    assert peak_kib() - resident < _NOISE_KIB
    assert gc.collect() < 20
