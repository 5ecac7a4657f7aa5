"""The true obstacles and the sensor that sees them, against shapely and by hand."""

from math import cos, inf, pi, sin
from pathlib import Path

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.config import VehicleConfig, load_run, read_obstacles
from vehicle_sim.errors import ConfigError
from vehicle_sim.obstacles import RangeSensor, Scene, cast
from vehicle_sim.parts import ObstacleConfig, RangeSensorConfig
from vehicle_sim.protocol.node import Node
from vehicle_sim.telemetry.ranging import obstacle_distance
from vehicle_sim.vehicle import Vehicle

START = (5.0, 7.0)
LEVEL = (1.0, 0.0, 0.0, 0.0)
SQUARE = ((8.0, 6.0), (10.0, 6.0), (10.0, 8.0), (8.0, 8.0))  # 3 m east of the start, 2 m wide
EXACT = RangeSensorConfig(noise_std_m=0.0, sectors=4)


def scene(**changes: float) -> Scene:
    return Scene.of([ObstacleConfig(name="crate", polygon_m=SQUARE, **changes)], START)  # type: ignore[arg-type]


def test_rays_agree_with_shapely() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        ring = rng.uniform(-20, 20, (5, 2))
        edges = np.hstack([ring, np.roll(ring, -1, axis=0)])
        at, bearings = rng.uniform(-20, 20, 2), rng.uniform(-pi, pi, 40)
        line = shapely.LinearRing(ring)
        for bearing, found in zip(bearings, cast(edges, at, bearings), strict=True):
            ray = shapely.LineString([at, at + 100 * np.array([cos(bearing), sin(bearing)])])
            met = ray.intersection(line)
            expected = inf if met.is_empty else shapely.Point(at).distance(met)
            assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert np.isinf(cast(np.empty((0, 4)), np.zeros(2), np.zeros(3))).all()


@pytest.mark.parametrize(("yaw", "sector"), [(0.0, 1), (pi / 2, 0), (pi, 3), (-pi / 2, 2)])
def test_the_crate_to_the_east_is_where_the_nose_says(yaw: float, sector: int) -> None:
    sensor = RangeSensor(EXACT, scene(), 1)
    sweep = sensor.sweep(0, (0.0, 0.0, -2.0), (cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)))
    assert sweep.ranges_m[sector] == pytest.approx(3.0)
    assert np.isinf(np.delete(sweep.ranges_m, sector)).all()
    assert (sweep.first_deg, sweep.increment_deg) == (0.0, 90.0)


def test_a_narrow_field_is_centred_on_the_nose() -> None:
    sensor = RangeSensor(RangeSensorConfig(noise_std_m=0.0, field_deg=90.0, sectors=3), scene(), 1)
    sweep = sensor.sweep(0, (0.0, 0.0, -2.0), (cos(pi / 4), 0.0, 0.0, sin(pi / 4)))
    assert sweep.first_deg == pytest.approx(-30.0)
    assert sweep.ranges_m[1] == pytest.approx(3.0)


def test_it_appears_in_time_ends_at_its_height_and_out_of_reach_is_nothing() -> None:
    late = scene(appears_s=4.0, height_m=5.0)
    sensor = RangeSensor(EXACT, late, 1)
    for t_us, height_m, seen in ((3_900_000, 2.0, False), (4_000_000, 2.0, True), (4_000_000, 5.5, False)):
        assert np.isfinite(sensor.sweep(t_us, (0.0, 0.0, -height_m), LEVEL).ranges_m).any() == seen
        inside = late.hit(t_us * 1e-6, 0.0, 4.0, height_m)
        assert inside == ("crate" if seen else None)
    assert late.hit(9.0, 0.0, 2.0, 2.0) is None
    short = RangeSensor(RangeSensorConfig(noise_std_m=0.0, sectors=4, reach_m=2.9), scene(), 1)
    assert np.isinf(short.sweep(0, (0.0, 0.0, -2.0), LEVEL).ranges_m).all()


def test_noise_is_that_of_seed_and_time_however_often_it_is_asked() -> None:
    sensors = [RangeSensor(RangeSensorConfig(sectors=4, noise_std_m=0.1), scene(), seed) for seed in (1, 1, 2)]
    pose = ((0.0, 0.0, -2.0), LEVEL)
    ranges = [sensor.sweep(1000, *pose).ranges_m[1] for sensor in sensors]
    assert ranges[0] == ranges[1] == sensors[0].sweep(1000, *pose).ranges_m[1]
    assert ranges[0] != ranges[2]
    spread = [sensors[0].sweep(t, *pose).ranges_m[1] for t in range(400)]
    assert np.std(spread) == pytest.approx(0.1, rel=0.15)
    assert np.mean(spread) == pytest.approx(3.0, abs=0.03)


def test_the_message_is_sent_at_its_rate_to_every_client_and_says_what_was_seen() -> None:
    sensor = RangeSensor(RangeSensorConfig(noise_std_m=0.0, sectors=36, rate_hz=5.0), scene(), 1)
    node = Node(Vehicle(VehicleConfig(), 1, range_sensor=sensor), lockstep=False)
    session = node.session("client")
    node.advance_to(2_000_000)
    frames = [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in node.take(session)]
    sweeps = [frame for frame in frames if frame.get_type() == "OBSTACLE_DISTANCE"]
    assert len(sweeps) == 10
    message = sweeps[-1]
    assert (message.frame, message.increment_f, message.angle_offset) == (mavlink.MAV_FRAME_BODY_FRD, 10.0, 0.0)
    assert message.distances[9] == pytest.approx(300, abs=2)
    assert message.distances[0] == message.max_distance + 1
    assert set(message.distances[36:]) == {65535}
    assert obstacle_distance(Vehicle(VehicleConfig(), 1)) is None


def test_bad_obstacles_are_named(tmp_path: Path) -> None:
    config = tmp_path / "run.yaml"
    config.write_text("start_m: [0, 0]\nvehicle:\n  obstacles:\n    - {name: a, polygon_m: [[0, 0], [1, 1]]}\n")
    with pytest.raises(ConfigError, match=r"run.yaml:4: vehicle.obstacles\[0\].polygon_m"):
        load_run(config)
    listed = tmp_path / "more.json"
    listed.write_text('[{"name": "a", "polygon_m": [[0, 0], [1, 1], [0, 1]], "appears_s": -1}]')
    with pytest.raises(ConfigError, match="appears_s"):
        read_obstacles(listed)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_obstacles(tmp_path / "none.json")
