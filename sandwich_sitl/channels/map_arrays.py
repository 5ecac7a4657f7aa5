"""A `ChannelMap` as a flat set of arrays and one JSON-able header, and back.

Ragged parts (channels, bays, rings) are joined end to end with a table of their lengths, so that a file holds few
members however many channels, bays and obstacles there are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.channels.channel_map import ChannelMap, LostGround, MapQuality
from sandwich_sitl.world.grow import GrownWorld

Arrays = dict[str, NDArray[Any]]


def map_to_arrays(channel_map: ChannelMap) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and header of a map."""
    grown = channel_map.grown
    arrays: Arrays = {name: getattr(channel_map, name) for name in ("gridded", "barred", "barrier", "Psi", "phi")}
    arrays["rows"] = np.array([xy.shape[1] for xy in channel_map.xy_m], dtype=np.int64)
    arrays["nodes"] = _joined([xy.reshape(-1, 2) for xy in channel_map.xy_m], 2, np.float64)
    bays = channel_map.bays
    for name, parts, width, kind in (
        ("bay_nodes", [bay.xy_m for bay in bays], 2, np.float64),
        ("bay_quads", [bay.quads for bay in bays], 4, np.int64),
        ("lid_nodes", [bay.lid_nodes[:, None] for bay in bays], 1, np.int64),
        ("lid_places", list(channel_map.lid_places), 3, np.int64),
        ("lost_rings", [lost.ring_m for lost in channel_map.lost], 2, np.float64),
        ("grown_rings", list(grown.rings_m()), 2, np.float64),
    ):
        arrays[name] = _joined(parts, width, kind)
        arrays[f"{name}_lengths"] = np.array([len(part) for part in parts], dtype=np.int64)
    header = {
        "bounds_m": grown.bounds_m,
        "flow": channel_map.flow,
        "grown_names": grown.names,
        "bay_names": [bay.name for bay in bays],
        "lost": [(lost.name, lost.area_m2) for lost in channel_map.lost],
        "quality": asdict(channel_map.quality),
    }
    return arrays, header


def map_from_arrays(arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> ChannelMap:
    """The map of `map_to_arrays`; raises `KeyError`, `ValueError` or `TypeError` when something is missing or off."""
    x_min, y_min, x_max, y_max = header["bounds_m"]
    m_phi = len(arrays["phi"])
    rows = arrays["rows"].tolist()
    channels = np.split(arrays["nodes"], np.cumsum([m_phi * m for m in rows])[:-1]) if rows else []
    bays = zip(
        header["bay_names"], *(_split(arrays, name) for name in ("bay_nodes", "bay_quads", "lid_nodes")), strict=True
    )
    return ChannelMap(
        grown=GrownWorld(
            (float(x_min), float(y_min), float(x_max), float(y_max)),
            tuple(Polygon(ring) for ring in _split(arrays, "grown_rings")),
            tuple(header["grown_names"]),
        ),
        flow=header["flow"],
        xy_m=tuple(nodes.reshape(m_phi, m, 2) for nodes, m in zip(channels, rows, strict=True)),
        bays=tuple(Bay(name, xy, quads, lids[:, 0]) for name, xy, quads, lids in bays),
        lid_places=tuple(_split(arrays, "lid_places")),
        lost=tuple(
            LostGround(name, ring, area)
            for (name, area), ring in zip(header["lost"], _split(arrays, "lost_rings"), strict=True)
        ),
        quality=MapQuality(**header["quality"]),
        **{name: arrays[name] for name in ("gridded", "barred", "barrier", "Psi", "phi")},
    )


def _joined(parts: Sequence[NDArray[Any]], width: int, kind: type) -> NDArray[Any]:
    return np.concatenate([np.empty((0, width), dtype=kind), *parts])


def _split(arrays: Mapping[str, NDArray[Any]], name: str) -> list[NDArray[Any]]:
    lengths = arrays[f"{name}_lengths"]
    return np.split(arrays[name], np.cumsum(lengths)[:-1]) if len(lengths) else []
