"""The scene's messages: regions with altitudes are prisms, obstacles stand as high as they are."""

import numpy as np
import run_samples
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from sandwich_sitl.recording.scene import map_update, scene_update


def lines_of(data: bytes, name: str) -> list[np.ndarray]:
    update = SceneUpdate.FromString(data)
    entity = next(entity for entity in update.entities if entity.id == name)
    return [np.array([(p.x, p.y, p.z) for p in line.points]) for line in entity.lines]


def test_a_region_is_an_outline_at_the_altitude_and_with_floors_a_prism() -> None:
    plan = run_samples.small_plan()
    outlines = lines_of(map_update(plan, 0), "regions")
    assert [len(outline) for outline in outlines] == [5, 5, 5]
    assert {z for outline in outlines for z in outline[:, 2]} == {10.0}
    np.testing.assert_array_equal(outlines[0][:4, :2], plan.corridor.polygons_m[0])

    edges = lines_of(map_update(run_samples.plan_with_floors(7.0), 0), "regions")
    assert len(edges) == 3 * (2 + 4)
    low, high, *uprights = edges[:6]
    assert (set(low[:, 2]), set(high[:, 2])) == ({9.0}, {11.0})
    for upright, corner in zip(uprights, plan.corridor.polygons_m[0], strict=True):
        np.testing.assert_array_equal(upright, [[*corner, 9.0], [*corner, 11.0]])


def test_an_obstacle_is_as_high_as_it_is_known_to_be() -> None:
    for height_m, top_m in ((7.0, 7.0), (np.nan, 15.0)):
        update = SceneUpdate.FromString(scene_update(run_samples.plan_with_floors(height_m), 0))
        mesh = next(entity for entity in update.entities if entity.id == "obstacle/diamond").triangles[0]
        assert {point.z for point in mesh.points} == {0.0, top_m}
