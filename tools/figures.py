"""The paper's figures from the log of a run: `python tools/figures.py RUN.mcap [--out DIR]`.

Writes `path.png` (obstacles, the existing A* and the Sandwich path), `quadrangles.png` (true path, desired path and the
neighbouring quadrangles that hold it, with an enlarged stretch) and `snap.png` (x and y of the snap control against the
discrete time k). Axes are ENU metres.
"""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from sandwich_sitl.errors import InputError, SandwichError
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.reader import RunLog

_ZOOM_M = 12.0


def main() -> int:
    """Returns the exit status: 0, or 2 on an unusable file or directory."""
    parser = argparse.ArgumentParser(description="Draw the paper's figures from the log of a run.")
    parser.add_argument("run", type=Path, metavar="RUN.mcap")
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR")
    options = parser.parse_args()
    try:
        log = RunLog.read(options.run)
        if log.notice is not None:
            print(log.notice, file=sys.stderr)
        if log.plan is None or log.control.t_s.size == 0:
            raise InputError(f"{options.run}: holds no plan or no control ticks, so there is nothing to draw")
        options.out.mkdir(parents=True, exist_ok=True)
        for name, draw in (("path", draw_path), ("quadrangles", draw_quadrangles), ("snap", draw_snap)):
            draw(log, log.plan, options.out / f"{name}.png")
            print(options.out / f"{name}.png")
    except SandwichError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    except OSError as error:
        print(f"{options.out}: cannot be written ({error.strerror}); give another directory", file=sys.stderr)
        return 2
    return 0


def draw_path(log: RunLog, plan: FlightPlan, path: Path) -> None:
    """Both A* paths among the obstacles."""
    del log
    figure, axes = plt.subplots(figsize=(8, 6))
    draw_obstacles(axes, plan)
    axes.plot(*plan.grid_astar_m.T, color="tab:blue", label="existing A*")
    axes.plot(*plan.sandwich_m.T, color="black", marker=".", markersize=3, linewidth=0.8, label="Sandwich A*")
    finish(figure, axes, path)


def draw_quadrangles(log: RunLog, plan: FlightPlan, path: Path) -> None:
    """The flown path inside the quadrangles, whole and enlarged where it turns most."""
    figure, both = plt.subplots(1, 2, figsize=(14, 6))
    flown = log.truth.r_m if log.truth.t_s.size else log.control.estimate_r_m
    inside = flown[:, 2] > 0.5
    for axes in both:
        draw_obstacles(axes, plan)
        for corners in plan.corridor.neighbours_m:
            axes.fill(*corners.T, facecolor="none", edgecolor="tab:red", linewidth=0.5)
        axes.plot(*plan.reference.xyz_m[:, :2].T, color="black", linestyle=":", linewidth=1.0, label="desired")
        axes.plot(*flown[inside, :2].T, color="tab:green", linewidth=1.5, label="flown")
    centre = sharpest(plan.reference.xyz_m[:, :2])
    both[1].set_xlim(centre[0] - _ZOOM_M, centre[0] + _ZOOM_M)
    both[1].set_ylim(centre[1] - _ZOOM_M, centre[1] + _ZOOM_M)
    finish(figure, both[0], path)


def draw_snap(log: RunLog, plan: FlightPlan, path: Path) -> None:
    """u_k of x and y."""
    del plan
    figure, both = plt.subplots(2, 1, figsize=(8, 5), sharex=True)
    for axis, (axes, name) in enumerate(zip(both, "xy", strict=True)):
        axes.step(np.arange(len(log.control.t_s)), log.control.snap_mps4[:, axis], where="post", linewidth=0.8)
        axes.set_ylabel(f"$u_{name}$, m/s$^4$")
        axes.grid(linewidth=0.3)
    both[1].set_xlabel("k")
    figure.tight_layout()
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_obstacles(axes: Axes, plan: FlightPlan) -> None:
    """Obstacles as they are, not grown."""
    for ring in plan.obstacles_m:
        axes.fill(*ring.T, color="0.6")
    x_min, y_min, x_max, y_max = plan.bounds_m
    axes.set_xlim(x_min, x_max)
    axes.set_ylim(y_min, y_max)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def sharpest(xy_m: np.ndarray) -> np.ndarray:
    """Where a path (n, 2) bends most within ten metres."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0), axis=1))])
    even = np.column_stack([np.interp(np.arange(0.0, along[-1], 1.0), along, column) for column in xy_m.T])
    if len(even) < 12:
        return np.asarray(even[len(even) // 2])
    bend = np.linalg.norm(even[10:] - 2 * even[5:-5] + even[:-10], axis=1)
    return np.asarray(even[5 + int(bend.argmax())])


def finish(figure: plt.Figure, axes: Axes, path: Path) -> None:
    """Legend and file."""
    axes.legend(loc="upper left", fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
