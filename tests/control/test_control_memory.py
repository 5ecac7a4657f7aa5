"""A tick leaves nothing behind: no growing memory, nothing for the garbage collector to find."""

import dataclasses
import gc
import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from sandwich_sitl.control.tracker import Tracker

from .flights import DT, MPC, flight, mpc_of, run_config

_NOISE_BYTES = 4096


@pytest.fixture
def no_collection() -> Iterator[None]:
    """The collector off, as in the loop."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def fly_on(tracker: Tracker, first: int, count: int) -> None:
    """Ticks round and round: a noisy vehicle that follows its command."""
    for k in range(first, first + count):
        wobble = 0.02 * np.array([np.sin(k), np.cos(k), 0.0])
        tracker.tick(k * DT, tracker.command[:3] + wobble, tracker.command[3:6], 0.0)


@pytest.mark.usefixtures("no_collection")
@pytest.mark.parametrize("solver", ["active_set", "osqp"])
@pytest.mark.parametrize(("count", "rounds"), [(1500, 3), pytest.param(50_000, 2, marks=pytest.mark.slow)])
def test_memory_and_garbage_do_not_grow_with_the_ticks(solver: str, count: int, rounds: int) -> None:
    reference, corridor = flight()
    config = run_config(mpc=dataclasses.replace(MPC, solver=solver))
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    fly_on(tracker, 0, 700)
    gc.collect()
    tracemalloc.start()
    sizes = []
    for k in range(rounds):
        fly_on(tracker, 700 + k * count, count)
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(sizes[1:]) - sizes[0] < _NOISE_BYTES
    assert gc.collect() < 20
