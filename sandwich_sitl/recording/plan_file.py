"""A `FlightPlan` as the bytes of an `.npz` archive, and back.

Equal plans give equal bytes: members are stored in a fixed order, uncompressed, with a fixed date.
`FlightPlan.seconds` is wall time, so it is left out; a plan that is read has an empty one. Rings of different lengths
are stored end to end with their lengths. No pickled object is ever read.
"""

import dataclasses
import io
import json
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.map_arrays import map_from_arrays, map_to_arrays
from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.flight_plan import (
    Corridor,
    CorridorProof,
    FlightFigures,
    FlightPlan,
    FloorFigures,
    FloorPlan,
    Reference,
)

FORMAT = "sandwich-plan-3"
_DATE = (1980, 1, 1, 0, 0, 0)
_PLAN_ARRAYS = ("obstacle_heights_m", "sandwich_m", "sandwich_phi_psi", "grid_astar_m", "exact_m")


def plan_bytes(plan: FlightPlan) -> bytes:
    """The plan as a deterministic `.npz` archive."""
    map_arrays, map_header = map_to_arrays(plan.channel_map)
    header = json.dumps(_header(plan) | {"map": map_header})
    arrays: dict[str, NDArray[Any]] = {"header": np.frombuffer(header.encode(), dtype=np.uint8)}
    arrays |= {name: getattr(plan, name) for name in _PLAN_ARRAYS}
    arrays["tight_m"] = plan.tight_m
    arrays |= {f"map_{name}": array for name, array in map_arrays.items()}
    arrays |= {f"reference_{f.name}": getattr(plan.reference, f.name) for f in dataclasses.fields(Reference)}
    arrays |= {f"corridor_{name}": getattr(plan.corridor, name) for name in ("Lambda", "Gamma", "neighbours_m", "z_m")}
    for name, rings in _ring_groups(plan).items():
        arrays[f"{name}_points"], arrays[f"{name}_lengths"] = _join(rings)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _DATE), member.getvalue())
    return buffer.getvalue()


def plan_from_bytes(data: bytes, source: str = "plan.npz") -> FlightPlan:
    """The plan in `data`; raises `InputError` naming `source` when the bytes are not such an archive."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        return _plan(arrays)
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{source}: is not a flight plan ({' '.join(str(error).split()) or type(error).__name__}); "
            "give a plan.npz that `sandwich-sitl plan` wrote"
        ) from error


def save_plan(plan: FlightPlan, path: Path) -> None:
    """Write the plan to `path`."""
    path.write_bytes(plan_bytes(plan))


def load_plan(path: Path) -> FlightPlan:
    """Read a plan; raises `InputError` when the file is missing or not a plan."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of a plan.npz") from error
    return plan_from_bytes(data, str(path))


def _header(plan: FlightPlan) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "name": plan.name,
        "bounds_m": plan.bounds_m,
        "start_m": plan.start_m,
        "goal_m": plan.goal_m,
        "altitude_m": plan.altitude_m,
        "vehicle_radius_m": plan.vehicle_radius_m,
        "obstacle_names": plan.obstacle_names,
        "route_kind": plan.route_kind,
        "route_proven": plan.route_proven,
        "proof": plan.proof and dataclasses.asdict(plan.proof),
        "flight": plan.flight and dataclasses.asdict(plan.flight),
        "floors": plan.floors and dataclasses.asdict(plan.floors),
    }


def _ring_groups(plan: FlightPlan) -> dict[str, Sequence[NDArray[np.float64]]]:
    return {"obstacles": plan.obstacles_m, "grown": plan.grown_m, "corridor_polygons": plan.corridor.polygons_m}


def _plan(arrays: dict[str, NDArray[Any]]) -> FlightPlan:
    header = json.loads(arrays["header"].tobytes())
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError(f"its format is not {FORMAT}")
    map_arrays = {name.removeprefix("map_"): array for name, array in arrays.items() if name.startswith("map_")}
    return FlightPlan(
        name=header["name"],
        bounds_m=_four(header["bounds_m"]),
        start_m=_two(header["start_m"]),
        goal_m=_two(header["goal_m"]),
        altitude_m=float(header["altitude_m"]),
        vehicle_radius_m=float(header["vehicle_radius_m"]),
        obstacle_names=tuple(header["obstacle_names"]),
        obstacles_m=_split(arrays, "obstacles"),
        grown_m=_split(arrays, "grown"),
        channel_map=map_from_arrays(map_arrays, header["map"]),
        reference=Reference(**{f.name: arrays[f"reference_{f.name}"] for f in dataclasses.fields(Reference)}),
        corridor=Corridor(
            Lambda=arrays["corridor_Lambda"],
            Gamma=arrays["corridor_Gamma"],
            polygons_m=_split(arrays, "corridor_polygons"),
            neighbours_m=arrays["corridor_neighbours_m"],
            z_m=arrays.get("corridor_z_m", np.empty((0, 2))),
        ),
        proof=CorridorProof(**header["proof"]) if header["proof"] else None,
        flight=FlightFigures(**header["flight"]) if header["flight"] else None,
        floors=_floors(header.get("floors")),
        seconds={},
        route_kind=header.get("route_kind", "sandwich"),
        route_proven=bool(header.get("route_proven", False)),
        tight_m=arrays.get("tight_m", np.empty((0, 2))),
        obstacle_heights_m=arrays["obstacle_heights_m"],
        sandwich_m=arrays["sandwich_m"],
        sandwich_phi_psi=arrays["sandwich_phi_psi"],
        grid_astar_m=arrays["grid_astar_m"],
        exact_m=arrays["exact_m"],
    )


def _floors(data: dict[str, Any] | None) -> FloorPlan | None:
    if data is None:
        return None
    return FloorPlan(**(data | {"figures": tuple(FloorFigures(**floor) for floor in data["figures"])}))


def _join(rings: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    points = np.concatenate([np.asarray(ring, dtype=np.float64) for ring in rings]) if rings else np.empty((0, 2))
    return points, np.array([len(ring) for ring in rings], dtype=np.int64)


def _split(arrays: dict[str, NDArray[Any]], name: str) -> tuple[NDArray[np.float64], ...]:
    lengths = arrays[f"{name}_lengths"]
    if lengths.size == 0:
        return ()
    return tuple(np.split(arrays[f"{name}_points"], np.cumsum(lengths)[:-1]))


def _two(values: Sequence[float]) -> tuple[float, float]:
    x, y = values
    return float(x), float(y)


def _four(values: Sequence[float]) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = values
    return float(x_min), float(y_min), float(x_max), float(y_max)
