"""The map from motion space to planning space inverts the channel map."""

import numpy as np
import pytest
import run_samples
from hypothesis import given
from hypothesis import strategies as st

from sandwich_sitl.viewing.planning_space import PlanningSpace

MAP = run_samples.small_map()
SPACE = PlanningSpace(MAP)


def test_nodes_go_to_themselves() -> None:
    for d, grid in enumerate(MAP.xy_m):
        phi, psi = np.meshgrid(MAP.phi, MAP.psi_rows(d), indexing="ij")
        found = SPACE.locate(grid.reshape(-1, 2))
        free = np.ones(phi.shape, dtype=bool)
        free[:, 0 if d else -1] = ~MAP.barred[0]
        expected = np.column_stack([phi.ravel(), psi.ravel()])
        np.testing.assert_allclose(found[free.ravel()], expected[free.ravel()], atol=1e-9)


@given(st.floats(0.0, 40.0), st.floats(0.0, 1.0), st.integers(0, 1))
def test_points_of_a_channel_follow_its_closed_form(x: float, share: float, channel: int) -> None:
    """The sample map is y = (15 - b) psi / 15 below and y = 15 + b + (15 - b)(psi - 15) / 15 above, b the bulge at x."""
    bulge = 5.0 * max(0.0, 1.0 - abs(x - 20.0) / 6.0)
    y = share * (15.0 - bulge) if channel == 0 else 15.0 + bulge + share * (15.0 - bulge)
    ((phi, psi),) = SPACE.locate(np.array([[x, y]]))
    assert abs(phi - x) < 1e-6
    if bulge == 0 or abs(y - 15.0) > bulge + 1e-6:
        assert abs(psi - 15.0 * (channel + share)) < 0.1


def test_points_off_the_map_are_given_the_nearest_point_of_it() -> None:
    """The foot of the perpendicular from (20, 10.4) to the wall from (14, 15) to (20, 10), or to its mirror image."""
    (inside, outside) = SPACE.locate(np.array([[20.0, 10.4], [-3.0, -3.0]]))
    assert abs(inside[0] - 20.0) == pytest.approx(0.4 * 5.0 * 6.0 / 61.0)
    assert inside[1] == pytest.approx(15.0)
    assert tuple(outside) == (0.0, 0.0)


def test_a_line_is_carried_piece_by_piece_and_breaks_at_a_wall_and_off_the_map() -> None:
    straight = SPACE.pieces(np.array([[2.0, 5.0], [38.0, 5.0]]), 0.5, 0.25)
    assert len(straight) == 1
    np.testing.assert_allclose(straight[0][[0, -1], 0], [2.0, 38.0])
    assert np.hypot(*np.diff(straight[0], axis=0).T).max() < 1.0
    through_the_diamond = SPACE.pieces(np.array([[20.0, 5.0], [20.0, 25.0]]), 0.1, 0.25)
    assert [piece[:, 1].max() <= 15.0 for piece in through_the_diamond] == [True, False]
    assert len(SPACE.pieces(np.array([[20.0, 12.0], [20.0, 18.0]]), 0.1, 0.25)) == 0
