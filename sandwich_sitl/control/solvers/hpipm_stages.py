"""HPIPM (interior point on the Riccati recursion) on the stages, by its C interface in the library of CasADi's wheel.

    stage h = 0 .. n    x = [r, v, a, j] (4 D),  u = [snap (D), s, t],  rows regions (F) and motion limits, upper side alone

Unknowns are divided by the horizon's scales. The first state is known and part of the first gap, so stage 0 has no
state, row or slack; stage n has no snap. The slacks are inputs, because rows that share one of HPIPM's own slacks are
beyond its Newton step (50 iterations and no answer). HPIPM reads matrices column by column.
"""

from collections.abc import Callable, Mapping, Sequence
from ctypes import CDLL, byref, c_double, c_int, c_size_t, c_void_p, create_string_buffer
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.horizon import SOLVED, Horizon, HorizonAnswer, HorizonTick

Array = NDArray[np.float64]

_SPEED = 1  # of hpipm_mode; the absolute mode is a quarter off in p99, the balanced one slower
_SUCCESS = 0  # of hpipm_status
_MOST_ITERATIONS = 50


class HpipmSolver:
    """One HPIPM workspace, started cold: an interior point gains little from the last tick's answer."""

    def __init__(self, horizon: Horizon, tolerance: float = 1e-6) -> None:
        self._horizon = horizon
        n, D, F = horizon.n_tau, horizon.axes, horizon.faces
        motion = [(k, normal) for k in range(3) if horizon.bounded[k] for normal in horizon.edges[k]]
        rows, boxed = F + len(motion), D * horizon.bounded[3]
        self._unit = np.repeat(horizon.scales[:4], D)
        self._C = np.zeros((n, 4 * D, rows))
        for row, (k, normal) in enumerate(motion, start=F):
            of_quantity = slice((k + 1) * D, (k + 2) * D)
            self._C[:, of_quantity, row] = normal / horizon.units[k + 1] * self._unit[of_quantity]
        self._upper = np.ones((n, rows))
        self._linear = np.zeros((n, 4 * D))
        self._gap = np.zeros(4 * D)
        self._input = np.zeros((n, D + 2))  # of stage 0 without slacks
        self._problem = problem = _OcpQp(
            {
                "nx": [0, *[4 * D] * n],
                "nu": [D, *[D + 2] * (n - 1), 2],
                "nbu": [boxed, *[boxed + 2] * (n - 1), 2],
                "ng": [0, *[rows] * n],
            },
            tolerance,
        )
        self._write_constants(boxed, len(motion))
        moving = [problem.setter("b", 0, self._gap)]
        for h in range(n):
            moving += [
                problem.setter("C", h + 1, self._C[h]),
                problem.setter("ug", h + 1, self._upper[h]),
                problem.setter("q", h + 1, self._linear[h]),
            ]
        self._moving = moving
        self._read = [problem.getter("u", h, self._input[h]) for h in range(n)]

    def _write_constants(self, boxed: int, motion: int) -> None:
        hz, unit = self._horizon, self._unit
        n, D, F = hz.n_tau, hz.axes, hz.faces
        chain = np.kron(hz.chain, np.eye(D)) * unit / unit[:, None]
        drive = np.kron(hz.drive[:, None], np.eye(D)) * hz.scales[4] / unit[:, None]
        weight = np.concatenate([np.full(D, hz.weight * unit[0] ** 2), np.zeros(3 * D)])
        box = np.full(boxed, hz.units[4] / hz.scales[4])
        curvature = np.full(D, hz.scales[4] ** 2 / hz.beta)
        linear, quadratic = hz.penalties.T
        slack_of_row = np.repeat(np.eye(2), [F, motion], axis=0)
        nothing, both = np.zeros((2, 4 * D)), np.zeros(2)
        for h in range(n + 1):
            snaps, slacks = D * (h < n), 2 * (h > 0)
            boxes = boxed * (h < n)
            self._problem.set(
                h,
                R=np.diag(np.concatenate([curvature[:snaps], quadratic[:slacks]])),
                r=np.concatenate([np.zeros(snaps), linear[:slacks]]),
                idxbu=np.concatenate([np.arange(boxes), snaps + np.arange(slacks)]).astype(np.int32),
                lbu=np.concatenate([-box[:boxes], both[:slacks]]),
                ubu=np.concatenate([box[:boxes], both[:slacks]]),
                ubu_mask=np.concatenate([np.ones(boxes), both[:slacks]]),
            )
            if h < n:
                self._problem.set(h, B=np.concatenate([drive.T, nothing[:slacks]]))
            if h > 0:
                D_T = np.concatenate([np.zeros((snaps, F + motion)), -slack_of_row.T])
                self._problem.set(h, Q=np.diag(weight), D=D_T, lg_mask=np.zeros(F + motion))
            if 0 < h < n:
                self._problem.set(h, A=chain.T)

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The answer to the tolerance."""
        hz = self._horizon
        D, F = hz.axes, hz.faces
        if not all(np.isfinite(part).all() for part in (tick.state, tick.desired, tick.normals, tick.offsets)):
            return hz.failed()
        self._C[:, :D, :F] = tick.normals.transpose(0, 2, 1) * self._unit[:D, None]
        self._upper[:, :F] = tick.offsets
        self._linear[:, :D] = -hz.weight * self._unit[:D] * tick.desired
        self._gap[:] = (hz.chain @ tick.state).ravel() / self._unit
        for move in self._moving:
            move()
        status, iterations = self._problem.solve()
        for read in self._read:
            read()
        snap = self._input[:, :D] * hz.scales[4]
        if status != _SUCCESS or not np.isfinite(snap).all():
            return hz.failed(iterations)
        return hz.answer_of_snap(snap, tick, SOLVED, iterations)


class _OcpQp:
    """HPIPM's structures of one problem with `sizes` of each stage, in memory of their own whose size HPIPM tells."""

    def __init__(self, sizes: Mapping[str, Sequence[int]], tolerance: float) -> None:
        self._memory: list[Any] = []
        last = len(sizes["nx"]) - 1
        dim = self._structure("dim", last)
        for name, of_stages in sizes.items():
            for stage, size in enumerate(of_stages):
                _LIBRARY.d_ocp_qp_dim_set(name.encode(), stage, int(size), dim)
        self._qp = self._structure("", dim)
        _LIBRARY.d_ocp_qp_set_all_zero(self._qp)
        self._answer = self._structure("sol", dim)
        self._settings = self._structure("ipm_arg", dim)
        _LIBRARY.d_ocp_qp_ipm_arg_set_default(_SPEED, self._settings)
        self._setting("iter_max", c_int(_MOST_ITERATIONS))
        for residual in ("stat", "eq", "ineq", "comp"):
            self._setting(f"tol_{residual}", c_double(tolerance))
        self._workspace = self._structure("ipm_ws", dim, self._settings)

    def set(self, stage: int, **values: NDArray[Any]) -> None:
        """Write values of a stage; matrices are given transposed, and HPIPM keeps a copy."""
        for field, value in values.items():
            self.setter(field, stage, np.ascontiguousarray(value))()

    def setter(self, field: str, stage: int, values: NDArray[Any]) -> Callable[[], None]:
        """What takes in `values`, as they are then, when it is called."""
        return self._at(_LIBRARY[f"d_ocp_qp_set_{field}"], stage, _address(values), self._qp)

    def getter(self, field: str, stage: int, values: NDArray[Any]) -> Callable[[], None]:
        """What writes the answer's `field` into `values` when it is called."""
        return self._at(_LIBRARY[f"d_ocp_qp_sol_get_{field}"], stage, self._answer, _address(values))

    def solve(self) -> tuple[int, int]:
        """HPIPM's status and its number of iterations."""
        _LIBRARY.d_ocp_qp_ipm_solve(self._qp, self._answer, self._settings, self._workspace)
        status, iterations = c_int(-1), c_int(0)
        _LIBRARY.d_ocp_qp_ipm_get_status(self._workspace, byref(status))
        _LIBRARY.d_ocp_qp_ipm_get_iter(self._workspace, byref(iterations))
        return status.value, iterations.value

    @staticmethod
    def _at(function: Any, *arguments: Any) -> Callable[[], None]:
        return lambda: function(*arguments)

    def _setting(self, name: str, value: Any) -> None:
        _LIBRARY.d_ocp_qp_ipm_arg_set(name.encode(), byref(value), self._settings)

    def _structure(self, kind: str, *of: Any) -> c_void_p:
        prefix = f"d_ocp_qp_{kind}_" if kind else "d_ocp_qp_"
        structure = self._allocate(self._size(f"{prefix}strsize"))
        _LIBRARY[f"{prefix}create"](*of, structure, self._allocate(self._size(f"{prefix}memsize", *of)))
        return structure

    def _size(self, function: str, *of: Any) -> int:
        measure = _LIBRARY[function]
        measure.restype = c_size_t
        return int(measure(*of))

    def _allocate(self, size: int) -> c_void_p:
        self._memory.append(create_string_buffer(size))
        return c_void_p(_address(np.frombuffer(self._memory[-1], dtype=np.uint8)).value)


def _address(values: NDArray[Any]) -> c_void_p:
    """Where `values` lie. They live at least as long as the pointer, also where it alone is kept."""
    return values.ctypes.data_as(c_void_p)


def _shared_library() -> CDLL:
    """Raises `ModuleNotFoundError` where CasADi is not installed or its wheel carries no HPIPM."""
    package = find_spec("casadi")
    libraries = sorted(Path(package.origin).parent.glob("libhpipm.*")) if package and package.origin else []
    if not libraries:
        raise ModuleNotFoundError("no library of HPIPM", name="casadi")
    return CDLL(str(libraries[0]))


_LIBRARY = _shared_library()
