"""`sandwich-sitl bench map`: what a channel map costs, beside a factorisation and beside what others prepare."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandwich_sitl.options import check_writable, whole

if TYPE_CHECKING:
    from sandwich_sitl.bench.map_bench import SizeFigures, UpdateFigures
    from sandwich_sitl.bench.map_peers import PeerFigures
    from sandwich_sitl.bench.map_worlds import BenchWorld

_NODES = (10_000, 100_000, 1_000_000)
_MIDDLE_NODES = 100_000
_SIZE_TIMEOUT_S = 600.0


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser(
        "map", help="time, growth and memory of the channel map, with peers"
    )
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the town that is mapped (default 1)")
    parser.add_argument(
        "--obstacles", type=whole(1), default=60, metavar="N", help="obstacles of the town (default 60)"
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="the world of this run instead of a town")
    parser.add_argument(
        "--nodes",
        type=_counts,
        default=_NODES,
        metavar="N,N",
        help=f"sizes, about (default {','.join(map(str, _NODES))})",
    )
    parser.add_argument("--repeat", type=whole(1), default=3, metavar="K", help="best of K (default 3)")
    parser.add_argument(
        "--peer-timeout", type=float, default=60.0, metavar="S", help="give a peer up after S seconds; 0: no peers"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here too")
    parser.set_defaults(action=_run)


def _counts(text: str) -> tuple[int, ...]:
    return tuple(map(whole(1), text.split(",")))


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.child import ChildFailedError, in_child
    from sandwich_sitl.bench.map_bench import growth, measure_load, measure_size, measure_update
    from sandwich_sitl.bench.map_peers import measure_peers
    from sandwich_sitl.bench.map_worlds import town, world_of

    check_writable("--json", arguments.json)
    world = world_of(arguments.config) if arguments.config else town(arguments.seed, arguments.obstacles)
    sizes: list[SizeFigures] = []
    for nodes in arguments.nodes:
        _say(f"{nodes} nodes")
        try:
            sizes.append(in_child(measure_size, world, nodes, arguments.repeat, timeout_s=_SIZE_TIMEOUT_S))
        except ChildFailedError as error:
            _say(f"{nodes} nodes: {error}")
    middle = min(_MIDDLE_NODES, max(arguments.nodes))
    _say("update, load")
    update = measure_update(world, middle, arguments.repeat)
    load_nodes, load_s = measure_load(world, middle)
    _say("peers")
    peers = measure_peers(world, arguments.peer_timeout) if arguments.peer_timeout > 0 else ()
    exponent = growth(sizes)
    print("\n".join([*_world_lines(world), "", *_size_lines(sizes, exponent), "", *_stage_lines(sizes), ""]))
    print("\n".join(_update_lines(update)))
    print(f"loading a saved map of {load_nodes} nodes: {1000 * load_s:.1f} ms")
    if peers:
        print("\n".join(["", *_peer_lines(peers)]))
    if arguments.json is not None:
        data = {
            "world": {"name": world.name, "obstacles": world.obstacles, "bounds_m": world.grown.bounds_m},
            "sizes": [asdict(size) for size in sizes],
            "growth_exponent": exponent,
            "update": asdict(update),
            "load": {"nodes": load_nodes, "seconds": load_s},
            "peers": [asdict(peer) for peer in peers],
        }
        arguments.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    whole = len(sizes) == len(arguments.nodes) and not update.failures and not any(size.failures for size in sizes)
    return 0 if whole else 1


def _world_lines(world: "BenchWorld") -> list[str]:
    x_min, y_min, x_max, y_max = world.grown.bounds_m
    solid = 1 - world.grown.free_area_m2 / ((x_max - x_min) * (y_max - y_min))
    return [
        f"{world.name}: {x_max - x_min:.0f} x {y_max - y_min:.0f} m, {world.obstacles} obstacles, "
        f"grown they cover {100 * solid:.0f} %"
    ]


def _size_lines(sizes: Sequence["SizeFigures"], exponent: float | None) -> list[str]:
    lines = [
        f"{'nodes':>9} {'cell m':>7} {'channels':>8} {'bays':>5} {'build s':>8} {'check s':>8} {'whole s':>8} "
        f"{'splu s':>8} {'ratio':>6} {'peak MiB':>9}"
    ]
    for size in sizes:
        splu_s = "-" if size.splu_s is None else f"{size.splu_s:.3f}"
        ratio = "-" if size.ratio is None else f"{size.ratio:.2f}"
        lines.append(
            f"{size.nodes:>9} {size.cell_m:>7.3f} {size.channels:>8} {size.bays:>5} {size.build_s:>8.3f} "
            f"{size.check_s:>8.3f} {size.whole_s:>8.3f} {splu_s:>8} {ratio:>6} {size.peak_mib:>9.0f}"
        )
        lines += [f"{'':>9} splu {size.splu_problem}"] if size.splu_problem else []
        lines += [f"{'':>9} check failed: {failure}" for failure in size.failures]
    if exponent is not None:
        lines.append(f"whole build grows as N^{exponent:.2f}")
    return lines


def _stage_lines(sizes: Sequence["SizeFigures"]) -> list[str]:
    if not sizes:
        return []
    rows = {stage: [size.stages_s[stage] for size in sizes] for stage in sizes[0].stages_s}
    rows["check"] = [size.check_s for size in sizes]
    return [
        f"{'stage, s':<16}" + "".join(f"{size.nodes:>10}" for size in sizes),
        *(f"{stage:<16}" + "".join(f"{seconds:>10.3f}" for seconds in row) for stage, row in rows.items()),
    ]


def _update_lines(update: "UpdateFigures") -> list[str]:
    return [
        f"a pop-up obstacle in a map of {update.channels} channels and {update.nodes} nodes: median "
        f"{1000 * update.median_s:.1f} ms, longest of {update.obstacles} {1000 * update.longest_s:.1f} ms; "
        f"{100 * update.median_s / update.build_s:.1f} % and {100 * update.longest_s / update.build_s:.1f} % of a new build",
        *(f"check failed: {failure}" for failure in update.failures),
    ]


def _peer_lines(peers: Sequence["PeerFigures"]) -> list[str]:
    lines = [f"{'peer, preparation':<40}{'s':>9}"]
    for peer in peers:
        seconds = "-" if peer.seconds is None else f"{peer.seconds:.4f}"
        lines.append(f"{peer.peer:<40}{seconds:>9}  {peer.made}")
    return lines


def _say(text: str) -> None:
    print(f"bench: {text}", file=sys.stderr)
