"""Solvers by the name that `mpc.solver` gives them."""

from importlib import import_module

from sandwich_sitl.control.horizon import Horizon, HorizonSolver
from sandwich_sitl.control.solvers.idle_rows import IdleRowsFirst
from sandwich_sitl.errors import InputError

_PLACES = {
    "active_set": ("active_set", "ActiveSetSolver"),
    "osqp": ("osqp_dual", "OsqpSolver"),
    "daqp": ("daqp_dense", "DaqpSolver"),
    "piqp": ("piqp_sparse", "PiqpSolver"),
    "clarabel": ("clarabel_sparse", "ClarabelSolver"),
    "hpipm": ("hpipm_stages", "HpipmSolver"),
}
_EXTRAS = {"daqp": "solvers", "clarabel": "solvers", "hpipm": "hpipm"}
NAMES = tuple(_PLACES)


def bare_solver(name: str, horizon: Horizon) -> HorizonSolver:
    """The solver itself. Raises `InputError` when its package is not installed."""
    module, kind = _PLACES[name]
    try:
        place = import_module(f"sandwich_sitl.control.solvers.{module}")
    except ModuleNotFoundError as error:
        raise InputError(
            f"mpc.solver: {name} needs the package '{error.name}'; "
            f"install it (pip install 'sandwich-sitl[{_EXTRAS.get(name, 'solvers')}]') or choose osqp"
        ) from error
    solver: HorizonSolver = getattr(place, kind)(horizon)
    return solver


def solver_for_flight(name: str, horizon: Horizon) -> HorizonSolver:
    """The solver as it flies: asked only in ticks in which a row binds; the first two see to that themselves."""
    solver = bare_solver(name, horizon)
    return solver if name in ("active_set", "osqp") else IdleRowsFirst(horizon, solver)
