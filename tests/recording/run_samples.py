"""A small plan and a small run with known numbers, for the tests of recording, viewing and tools.

World: 40 m x 30 m with one diamond. Two channels meet in the line y = 15 m, which opens to both sides of the diamond.
The run: armed at 1 s, ACTIVE from 2 s to 12 s along y = 5 m at 3 m/s and 10 m height, disarmed at 14 s, 10 ticks a
second.
"""

import dataclasses
from pathlib import Path

import numpy as np
from shapely import Polygon

from sandwich_sitl.channels.channel_map import ChannelMap, MapQuality
from sandwich_sitl.planning.flight_plan import Corridor, FlightPlan, FloorFigures, FloorPlan, Reference
from sandwich_sitl.recording.merge import merge_logs
from sandwich_sitl.recording.messages import nanoseconds
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import ControlRecord, MissionRecord, TickTiming
from sandwich_sitl.world.grow import GrownWorld

BOUNDS_M = (0.0, 0.0, 40.0, 30.0)
DIAMOND_M = np.array([[15.0, 15.0], [20.0, 11.0], [25.0, 15.0], [20.0, 19.0]])
GROWN_M = np.array([[14.0, 15.0], [20.0, 10.0], [26.0, 15.0], [20.0, 20.0]])
SPEED_MPS = 3.0
ROW_Y_M = 5.0
OFFSET_M = 0.2  # the vehicle flies this far to the left of the reference
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def small_map() -> ChannelMap:
    """Two channels of 41 x 7 nodes, one dividing streamline barred along the diamond."""
    x_m = np.linspace(0.0, 40.0, 41)
    bulge_m = 5.0 * np.clip(1.0 - np.abs(x_m - 20.0) / 6.0, 0.0, None)
    share = np.linspace(0.0, 1.0, 7)
    below_y = (15.0 - bulge_m)[:, None] * share
    above_y = (15.0 + bulge_m)[:, None] * (1.0 - share) + 30.0 * share
    grids = tuple(np.stack([np.broadcast_to(x_m[:, None], y.shape), y], axis=-1).copy() for y in (below_y, above_y))
    barred = (bulge_m > 0)[None]
    return ChannelMap(
        grown=GrownWorld(BOUNDS_M, (Polygon(GROWN_M),), ("diamond",)),
        flow="x",
        xy_m=grids,
        gridded=np.ones((2, 40), dtype=bool),
        barred=barred,
        barrier=np.where(barred, 0, -1),
        Psi=np.array([0.0, 15.0, 30.0]),
        phi=x_m,
        bays=(),
        lid_places=(),
        lost=(),
        quality=MapQuality(480, 0, 0, 0, 0.71, 50.0, 6.0, 1.0, 2.5, 1e-6, 0.98),
    )


def small_plan(*, obstacles: bool = True) -> FlightPlan:
    """The plan along y = 5 m; its corridor is the box 3.5 m <= y <= 6.5 m in three lengths."""
    row = np.arange(2, 39)
    sandwich_phi_psi = np.column_stack([row, np.full(len(row), 5.0)]).astype(float)
    t_s = np.arange(0.0, 10.0 + 1e-9, 0.1)
    x_m = 2.0 + SPEED_MPS * t_s
    xyz_m = np.column_stack([x_m, np.full_like(x_m, ROW_Y_M), np.full_like(x_m, 10.0)])
    boxes = [(0.0, 14.0), (12.0, 28.0), (26.0, 40.0)]
    normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    rings = tuple(np.array([[a, 3.5], [b, 3.5], [b, 6.5], [a, 6.5]]) for a, b in boxes)
    return FlightPlan(
        name="small",
        bounds_m=BOUNDS_M,
        start_m=(2.0, ROW_Y_M),
        goal_m=(38.0, ROW_Y_M),
        altitude_m=10.0,
        vehicle_radius_m=0.4,
        obstacle_names=("diamond",) if obstacles else (),
        obstacles_m=(DIAMOND_M,) if obstacles else (),
        obstacle_heights_m=np.array([np.nan] if obstacles else []),
        grown_m=(GROWN_M,) if obstacles else (),
        channel_map=small_map(),
        sandwich_m=np.column_stack([row, np.full(len(row), ROW_Y_M)]).astype(float),
        sandwich_phi_psi=sandwich_phi_psi,
        grid_astar_m=np.array([[2.0, 5.0], [5.0, 8.0], [35.0, 8.0], [38.0, 5.0]]),
        exact_m=np.array([[2.0, 5.0], [38.0, 5.0]]),
        reference=Reference(t_s, xyz_m, np.searchsorted([13.0, 27.0], x_m)),
        corridor=Corridor(
            Lambda=np.broadcast_to(normals, (3, 4, 2)).copy(),
            Gamma=np.array([[b, -a, 6.5, -3.5] for a, b in boxes]),
            polygons_m=rings,
            neighbours_m=np.stack(rings),
        ),
        seconds={"channel map": 0.5, "route": 0.25},
    )


def plan_with_floors(height_m: float) -> FlightPlan:
    """The same plan flown at 10 m over the obstacle of a height, in regions from 9 m to 11 m."""
    plan = small_plan()
    figures = (
        FloorFigures(5.0, 1, 0, 0, *[np.nan] * 4, climb_cost_m=0.0, refused="no route"),
        FloorFigures(10.0, 0, 2, 574, 36.5, 36.0, 36.0, 36.0, climb_cost_m=15.0),
    )
    floors = FloorPlan(figures, flown=1, length_m=36.0, climbed_m=5.0, descended_m=5.0, changes=2)
    corridor = dataclasses.replace(plan.corridor, z_m=np.array([[9.0, 11.0]] * 3))
    return dataclasses.replace(plan, floors=floors, corridor=corridor, obstacle_heights_m=np.array([height_m]))


def control_record(t_s: float, index: int = 0, **changes: object) -> ControlRecord:
    """A record whose every number differs from every other."""
    vectors = (
        "estimate_r_m",
        "estimate_v_mps",
        "model_a_mps2",
        "model_j_mps3",
        "setpoint_r_m",
        "setpoint_v_mps",
        "setpoint_a_mps2",
        "snap_mps4",
        "offset_m",
    )
    values: dict[str, object] = {
        name: (n + 0.25 + index, -n - 0.5, n * 1e-3 + 1 / 3) for n, name in enumerate(vectors, start=1)
    }
    values |= {
        "phase": "ACTIVE",
        "reference_m": (2.0 + SPEED_MPS * (t_s - 2.0), ROW_Y_M, 10.0),
        "slack_m": 0.001 * index,
        "solver_status": 1,
        "solver_iterations": 25 + index % 3,
        "region": int(np.searchsorted([13.0, 27.0], 2.0 + SPEED_MPS * (t_s - 2.0))),
        "clearance_m": 6.0,
        "delay_s": 0.05,
        "reference_rate": 1.0,
        "rung": 0,
        "fault": "",
    }
    return ControlRecord(t_s=t_s, **(values | changes))  # type: ignore[arg-type]


def mavlink2_frame(sequence: int, system: int = 1) -> bytes:
    """The header of a MAVLink 2 frame with a small payload; the checksum is not a real one."""
    return bytes([0xFD, 4, 0, 0, sequence % 256, system, 1, 2, 0, 0]) + b"\x01\x02\x03\x04" + b"\x00\x00"


def truth_m(t_s: float) -> tuple[float, float, float]:
    """The true position: up at the start, along the row `OFFSET_M` to the left, down at the goal."""
    x_m = 2.0 + SPEED_MPS * min(max(t_s - 2.0, 0.0), 10.0)
    return (x_m, ROW_Y_M + OFFSET_M, 10.0 if 2.0 <= t_s <= 12.0 else 0.0)


def write_offboard(path: Path, plan: FlightPlan | None = None) -> Path:
    """The offboard process's side of the run."""
    run = {"run_id": "r1", "name": "small", "seed": 7, "clock": "lockstep", "config": {"a": 1}}
    with RunRecorder(path, flush_s=0.25, metadata={"started": "yes"}) as recorder:
        recorder.metadata("run", run)
        recorder.plan(0.0, plan or small_plan())
        recorder.log(0.0, "info", "planned")
        for tick in range(151):
            t_s = tick * 0.1
            _mission_changes(recorder, tick)
            recorder.tf_and_estimate(t_s, truth_m(t_s), IDENTITY)
            if 20 <= tick < 120:
                recorder.control(control_record(t_s, tick))
                recorder.horizon(t_s, np.array([truth_m(t_s + 0.1 * k) for k in range(5)]))
            recorder.mavlink(t_s, "tx", mavlink2_frame(tick, 245))
            recorder.mavlink(t_s, "rx", mavlink2_frame(tick if tick < 100 else tick + 3))
            recorder.timing(
                tick, TickTiming(1e-3 * (tick + 1), 2e-3 * (tick + 1), 0.5 if tick == 9 else 0.0, 70.0 + t_s)
            )
        recorder.log(15.0, "warning", "short battery")
        recorder.metadata("result", {"outcome": "landed", "reason": "", "wall_seconds": 3.0})
    return path


def _mission_changes(recorder: RunRecorder, tick: int) -> None:
    changes = {
        0: MissionRecord("CONNECT", "LOITER", armed=False, landed=True),
        10: MissionRecord("REQUEST", "OFFBOARD", armed=True, landed=True),
        20: MissionRecord("ACTIVE", "OFFBOARD", armed=True, landed=False),
        120: MissionRecord("LAND", "LAND", armed=True, landed=False, reason="goal reached"),
        140: MissionRecord("DONE", "LAND", armed=False, landed=True),
    }
    if tick in changes:
        recorder.mission(tick * 0.1, changes[tick])


def write_vehicle(path: Path) -> Path:
    """The vehicle's side: truth at 20 Hz."""
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
    from mcap.writer import Writer
    from mcap_protobuf.schema import register_schema

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library="vehicle")
        channel = writer.register_channel("/state/truth", "protobuf", register_schema(writer, PoseInFrame))
        for step in range(301):
            t_ns = nanoseconds(step * 0.05)
            pose = PoseInFrame(frame_id="map")
            pose.timestamp.FromNanoseconds(t_ns)
            pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = truth_m(step * 0.05)
            pose.pose.orientation.w = 1.0
            writer.add_message(channel, t_ns, pose.SerializeToString(), t_ns)
        writer.add_metadata("vehicle", {"seed": "7"})
        writer.finish()
    return path


def write_run(directory: Path, plan: FlightPlan | None = None) -> Path:
    """Both sides merged into `run.mcap`."""
    out = directory / "run.mcap"
    merge_logs([write_offboard(directory / "offboard.mcap", plan), write_vehicle(directory / "vehicle.mcap")], out)
    return out
