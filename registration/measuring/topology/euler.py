"""Betti numbers of a set of voxels: components, handles and cavities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from skimage.morphology import remove_small_holes, remove_small_objects

from kernels.arrays import BoolArray

_FULL = np.ones((3, 3, 3), dtype=np.bool_)


@dataclass(frozen=True)
class Betti:
    """Betti numbers of a solid.

    Attributes
    ----------
    components, loops, cavities : int
        Connected parts, independent loops through the lumen, and enclosed hollows.
    """

    components: int
    loops: int
    cavities: int

    @property
    def euler(self) -> int:
        """Euler number, components - loops + cavities."""
        return self.components - self.loops + self.cavities


def betti_numbers(voxels: BoolArray) -> Betti:
    """Betti numbers of the union of closed voxels (nz, ny, nx).

    Voxels that share a corner hang together (26 neighbours), their background by faces (6). The
    Euler number is counted: corners - edges + faces - voxels of the cubical complex (Kong &
    Rosenfeld 1989, doi 10.1016/0734-189X(89)90147-3); loops follow from it.
    """
    padded = np.pad(voxels, 1)
    parts = int(ndimage.label(padded, structure=_FULL)[1])
    hollows = int(ndimage.label(~padded)[1]) - 1
    return Betti(parts, parts + hollows - euler_number(padded), hollows)


def euler_number(voxels: BoolArray) -> int:
    """Euler number of the union of closed voxels; the border must be empty."""
    total = 0
    for number in range(8):
        axes = [k for k in range(3) if number >> k & 1]
        cells = voxels
        # A face, edge or corner is there when any voxel that it bounds is.
        for axis in axes:
            here = [slice(None)] * 3
            ahead = [slice(None)] * 3
            here[axis], ahead[axis] = slice(None, -1), slice(1, None)
            cells = cells[tuple(here)] | cells[tuple(ahead)]
        total += (-1) ** (3 - len(axes)) * int(np.count_nonzero(cells))
    return total


def without_specks(voxels: BoolArray, least: int) -> BoolArray:
    """Without parts, and without enclosed hollows, of fewer than `least` voxels."""
    kept = remove_small_objects(np.pad(voxels, 1), max_size=least - 1, connectivity=3)
    filled = remove_small_holes(kept, max_size=least - 1, connectivity=1)
    return np.asarray(filled[1:-1, 1:-1, 1:-1])
