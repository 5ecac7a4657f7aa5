"""`ChannelMap`: the mapping between motion space and planning space, as one frozen value.

Source: paper, section III. Channel d (0-based) is a grid of m_phi x m_d nodes; node (i, j) of the planning space sits
at `xy_m[d][i, j]` of the motion space (ENU, metres). Channels lie side by side across the flow. The last row of channel
d and the first row of channel d + 1 are the two sides of dividing streamline d: the same points where it is free, two
copies on the walls of an obstacle of group R_d, where crossing is barred. Beside the channels lie bays:
ground behind an obstacle's outline that no channel sweeps, meshed with quads of its own and joined to the channels'
walls at the nodes of its lids.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.world.grow import GrownWorld

Flow = Literal["x", "y"]


@dataclass(frozen=True)
class LostGround:
    """Free ground that the map leaves out: its name, outline (V, 2) and area."""

    name: str
    ring_m: NDArray[np.float64]
    area_m2: float


@dataclass(frozen=True)
class MapQuality:
    """What was measured over all cells of the channels and bays."""

    cells: int
    bay_cells: int
    folded_cells: int  # cells with a corner Jacobian that is not positive
    repaired_cells: int  # cells with a node off the finite-difference solution: moved by a repair, or beside one
    min_jacobian_ratio: float  # smallest corner Jacobian / (product of the two edge lengths): sine of the corner angle
    min_angle_deg: float
    mean_angle_error_deg: float  # mean |corner angle - 90 deg|: the paper's orthogonality, measured
    median_edge_m: float  # edges of the channels' cells, to hold against the `cell_m` asked for
    p95_aspect: float  # of the channels' cells: longer over shorter mean side
    max_residual_m: float  # largest residual of Eq. (ellipticpde) at the nodes of all other cells, as a displacement
    coverage: float  # mapped area / free area of the grown world


@dataclass(frozen=True)
class ChannelMap:
    """Checked channel map.

    `flow` is the axis along which phi grows. `xy_m[d]` has shape (m_phi, m_d, 2); `barred[d, i]` (p - 1, m_phi) is true
    where dividing streamline d is an obstacle wall in column i; `barrier[d, i]` is the index of that obstacle in the
    grown world (-1 where free); `Psi` (p + 1,) are the stream values of the dividing streamlines with the two
    borders; `phi` (m_phi,) the potential of each column. `lid_places[b]` (L, 3) are the places (d, i, j) of the nodes
    `bays[b].lid_nodes`. `gridded[d, i]` (p, m_phi - 1) is false where a stretch of channel d would not unfold and is
    meshed as a bay: between columns i and i + 1 the channel has no cells, and nodes with none are nan.
    """

    grown: GrownWorld
    flow: Flow
    xy_m: tuple[NDArray[np.float64], ...]
    gridded: NDArray[np.bool_]
    barred: NDArray[np.bool_]
    barrier: NDArray[np.int64]
    Psi: NDArray[np.float64]
    phi: NDArray[np.float64]
    bays: tuple[Bay, ...]
    lid_places: tuple[NDArray[np.int64], ...]
    lost: tuple[LostGround, ...]
    quality: MapQuality

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max of the world."""
        return self.grown.bounds_m

    @property
    def channels(self) -> int:
        """p, the number of navigable channels."""
        return len(self.xy_m)

    @property
    def nodes(self) -> int:
        """Number of nodes, wall and dividing-streamline nodes counted once a channel."""
        in_channels = sum(int(xy.shape[0] * xy.shape[1]) for xy in self.xy_m)
        return in_channels + sum(len(bay.xy_m) for bay in self.bays)

    def psi_rows(self, channel: int) -> NDArray[np.float64]:
        """Stream values (m_j,) of the rows of one channel."""
        return np.linspace(self.Psi[channel], self.Psi[channel + 1], self.xy_m[channel].shape[1])

    def corners_m(self) -> NDArray[np.float64]:
        """Corners (cells, 4, 2), counter-clockwise, of every cell: channels first, then bays."""
        grids = [grid_quads(xy, gridded) for xy, gridded in zip(self.xy_m, self.gridded, strict=True)]
        return np.concatenate([np.empty((0, 4, 2)), *grids, *(bay.corners_m() for bay in self.bays)])


def grid_quads(xy: NDArray[np.float64], gridded: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Corners (cells, 4, 2), counter-clockwise, of the cells of a grid (m_phi, m_j, 2) in its `gridded` columns."""
    corners = np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2)
    return np.asarray(corners[gridded].reshape(-1, 4, 2))
