"""`ChannelMap`: the mapping between motion space and planning space, as one frozen value.

Source: paper, section III. Channel j (0-based) is a grid of m_phi x m_j nodes; node (i, j_row) of the planning space
sits at `xy_m[i, j_row]` of the motion space (ENU, metres). Channels lie bottom to top. The top row of channel d and
the bottom row of channel d + 1 are the two sides of dividing streamline d: the same points where it is free, two
copies on the walls of an obstacle of group R_d, where crossing is barred (notes N3, N10).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MapQuality:
    """What the map's own check measured over all cells."""

    cells: int
    folded_cells: int  # cells with a corner Jacobian that is not positive
    repaired_cells: int  # cells whose nodes were moved off the finite-difference solution
    min_jacobian_ratio: float  # smallest corner Jacobian / (product of the two edge lengths): sine of the corner angle
    min_angle_deg: float
    mean_angle_error_deg: float  # mean |corner angle - 90 deg| (notes N7)
    max_residual_m: float  # largest residual of Eq. (ellipticpde) at nodes that no repair moved, as a displacement
    coverage: float  # mapped area / free area of the grown world


@dataclass(frozen=True)
class ChannelMap:
    """Checked channel map.

    `xy_m[d]` has shape (m_phi, m_d, 2); `barred[d, i]` (p - 1, m_phi) is true where dividing streamline d is an
    obstacle wall in column i; `barrier[d, i]` is the index of that obstacle in the grown world (-1 where free); `Psi`
    (p + 1,) are the stream values of the dividing streamlines with the two borders; `phi` (m_phi,) the potential of
    each column.
    """

    bounds_m: tuple[float, float, float, float]
    xy_m: tuple[NDArray[np.float64], ...]
    barred: NDArray[np.bool_]
    barrier: NDArray[np.int64]
    Psi: NDArray[np.float64]
    phi: NDArray[np.float64]
    quality: MapQuality

    @property
    def channels(self) -> int:
        """p, the number of navigable channels."""
        return len(self.xy_m)

    @property
    def nodes(self) -> int:
        """Number of grid nodes, wall and dividing-streamline nodes counted once a channel."""
        return sum(xy.shape[0] * xy.shape[1] for xy in self.xy_m)

    def psi_rows(self, channel: int) -> NDArray[np.float64]:
        """Stream values (m_j,) of the rows of one channel."""
        return np.linspace(self.Psi[channel], self.Psi[channel + 1], self.xy_m[channel].shape[1])
