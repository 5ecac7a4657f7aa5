"""Recorded control ticks: what the controller was asked in a real run, small enough to keep.

A sequence holds, tick by tick, the command in force (12,), the time sigma at which the reference is looked up and the
offset that is aimed off, with the piece of reference and the regions that a horizon of up to `LONGEST_S` needs. Any
horizon's problems can be made of it. The last sequences are made of others: regions pulled in, states pushed out,
rows and states of awkward sizes that must be solved all the same, and ticks that none can solve.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.horizon import HorizonTick
from sandwich_sitl.errors import InputError
from sandwich_sitl.recording.reader import RunLog

Array = NDArray[np.float64]

LONGEST_S = 4.2
STORED = ("calm", "gusty", "overdriven")


@dataclass(frozen=True)
class TickSequence:
    """`command` (K, 12), `sigma_s` (K,), `offset_m` (K, 2); reference `t_s` (J,), `xy_m` (J, 2), `region` (J,); `Lambda`
    (M, F, 2), `Gamma` (M, F). ENU SI.
    """

    name: str
    command: Array
    sigma_s: Array
    offset_m: Array
    t_s: Array
    xy_m: Array
    region: NDArray[np.int64]
    Lambda: Array
    Gamma: Array

    def problems(self, n_tau: int, step_s: float) -> Iterator[HorizonTick]:
        """The plane's problem of each tick for a horizon of `n_tau` steps of `step_s`."""
        ahead = np.arange(1, n_tau + 1) * step_s
        for x, sigma, offset in zip(self.command, self.sigma_s, self.offset_m, strict=True):
            times = sigma + ahead
            desired = np.column_stack([np.interp(times, self.t_s, self.xy_m[:, axis]) for axis in range(2)])
            place = np.clip(np.searchsorted(self.t_s, times), 0, len(self.t_s) - 1)
            Lambda = self.Lambda[self.region[place]]
            yield HorizonTick(
                x.reshape(4, 3)[:, :2].copy(),
                desired - offset,
                Lambda,
                self.Gamma[self.region[place]] - Lambda @ offset,
            )


def from_log(log: RunLog, name: str, first: int, count: int) -> TickSequence:
    """Ticks `first` .. `first + count` of a run's tracking, all flown at the reference's own rate; both 1 or more, as a
    tick's state is the command before it.

    Raises `InputError` for a log without a plan or with fewer ticks.
    """
    if log.plan is None or log.control.t_s.size < first + count:
        raise InputError(f"{log.path}: holds no plan, or fewer than {first + count} control ticks; give another run")
    control, reference, corridor = log.control, log.plan.reference, log.plan.corridor
    at = slice(first, first + count)
    period = float(np.median(np.diff(control.t_s)))
    a = control.setpoint_a_mps2
    jerk = np.gradient(a, period, axis=0)
    before = slice(first - 1, first + count - 1)
    command = np.hstack([control.setpoint_r_m[before], control.setpoint_v_mps[before], a[before], jerk[before]])
    distance = np.linalg.norm(reference.xyz_m[None] - control.reference_m[at][:, None], axis=2)
    sigma = reference.t_s[distance.argmin(axis=1)] + control.delay_s[at] - period
    window = (reference.t_s >= sigma.min() - period) & (reference.t_s <= sigma.max() + LONGEST_S)
    used, region = np.unique(reference.region[window], return_inverse=True)
    return TickSequence(
        name, command, sigma, control.offset_m[at, :2], reference.t_s[window], reference.xyz_m[window, :2],
        region.astype(np.int64), corridor.Lambda[used], corridor.Gamma[used],
    )  # fmt: skip


_ARRAYS = ("command", "sigma_s", "offset_m", "t_s", "xy_m", "region", "Lambda", "Gamma")


def save(sequence: TickSequence, path: Path) -> None:
    """Write a sequence in single precision, which is finer than any estimate."""
    arrays = {name: getattr(sequence, name) for name in _ARRAYS}
    small = {name: value.astype(np.int16 if name == "region" else np.float32) for name, value in arrays.items()}
    np.savez_compressed(path, **small)


def load(path: Path) -> TickSequence:
    """Read a sequence."""
    with np.load(path) as data:
        arrays = {name: data[name].astype(np.int64 if name == "region" else np.float64) for name in _ARRAYS}
    # Single precision leaves normals a hair off unit length, which is theirs to be.
    size = np.linalg.norm(arrays["Lambda"], axis=2)
    return TickSequence(
        path.stem, **{**arrays, "Lambda": arrays["Lambda"] / size[..., None], "Gamma": arrays["Gamma"] / size}
    )


def stored() -> tuple[TickSequence, ...]:
    """The sequences of the repository."""
    place = resources.files("sandwich_sitl.bench") / "data"
    with resources.as_file(place) as folder:
        return tuple(load(folder / f"{name}.npz") for name in STORED)


def narrow(sequence: TickSequence, half_width_m: float = 0.02) -> TickSequence:
    """Regions pulled in until the reference has `half_width_m` to the nearest side: rows bind in most ticks."""
    Gamma = sequence.Gamma.copy()
    for m in range(len(Gamma)):
        stretch = sequence.xy_m[sequence.region == m]
        Gamma[m] = np.minimum(Gamma[m], (sequence.Lambda[m] @ stretch.T).max(axis=1) + half_width_m)
    return replace(sequence, name=f"{sequence.name}, narrow", Gamma=Gamma)


def pushed_out(sequence: TickSequence, by_m: float = 1.5) -> TickSequence:
    """Every fourth tick starts aside by `by_m`, out of its regions: no hard answer exists."""
    command = sequence.command.copy()
    command[::4, 1] += by_m
    return replace(sequence, name=f"{sequence.name}, pushed out", command=command)


def awkward(sequence: TickSequence, acceleration_mps2: float) -> TickSequence:
    """Numbers that scale badly, within what a `HorizonTick` may hold; every tick has an answer.

    In turn from region to region: four sides 1000 km away, four sides that repeat the others turned by 1e-9 rad, all
    sides twice, half a millimetre round the reference. Every third tick accelerates by `acceleration_mps2`.
    """
    command, Gamma, Lambda = sequence.command.copy(), sequence.Gamma.copy(), sequence.Lambda.copy()
    Gamma[::4, 4:8] = 1e6
    across = np.stack([-Lambda[1::4, :4, 1], Lambda[1::4, :4, 0]], axis=2)
    Lambda[1::4, 4:8], Gamma[1::4, 4:8] = Lambda[1::4, :4] + 1e-9 * across, Gamma[1::4, :4]
    Lambda[2::4, 4:8], Gamma[2::4, 4:8] = Lambda[2::4, :4], Gamma[2::4, :4]
    thin = narrow(sequence, 0.0005)
    Gamma[3::4] = thin.Gamma[3::4]
    direction = command[::3, 3:5] / np.maximum(np.linalg.norm(command[::3, 3:5], axis=1, keepdims=True), 1e-9)
    command[::3, 6:8] = acceleration_mps2 * direction
    return replace(sequence, name=f"{sequence.name}, awkward", command=command, Lambda=Lambda, Gamma=Gamma)


def hostile(sequence: TickSequence) -> TickSequence:
    """In turn: untouched, 100 km from the origin, doubled rows, opposite rows that touch, not a number."""
    command, Gamma, Lambda = sequence.command.copy(), sequence.Gamma.copy(), sequence.Lambda.copy()
    Lambda[:, -1], Gamma[:, -1] = Lambda[:, 0], Gamma[:, 0]
    Lambda[::7, -2] = -Lambda[::7, 0]
    Gamma[::7, -2] = -Gamma[::7, 0]
    command[3::5, 0] += 1e5
    command[4::5, 3] = np.nan
    return replace(sequence, name=f"{sequence.name}, hostile", command=command, Lambda=Lambda, Gamma=Gamma)
