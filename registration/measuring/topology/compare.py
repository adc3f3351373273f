"""Compare Betti numbers of the printed lumens with the design's graph."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skimage.morphology import remove_small_holes, remove_small_objects

from design.network import VesselNetwork
from kernels.arrays import BoolArray, IntArray
from registration.measuring.topology.grid import LumenGrid

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


SPECK_MM = 0.2
"""Parts and hollows smaller than a cube of this edge are noise."""


@dataclass(frozen=True)
class Topology:
    """Components and loops of the printed lumens.

    Attributes
    ----------
    designed : Betti
        Of the design's graph: components, and loops = vessels - nodes + components.
    drawn : Betti
        Of the design drawn in voxels as fine as the scan allows.
    printed : Betti
        Of what is free in the scan, likewise, bridges between vessels with it.
    expected : Betti
        Of the graph without the vessels that were found closed, and with the bridges.
    as_designed : bool or None
        Whether the print hangs together as the design does; None where not all was seen, or the
        voxels are too coarse to draw the design itself (`drawn` isn't `designed`).
    explained : bool or None
        Whether closed vessels and bridges explain what was printed; None likewise.
    """

    designed: Betti
    drawn: Betti
    printed: Betti
    expected: Betti
    as_designed: bool | None
    explained: bool | None


@dataclass(frozen=True)
class Faults:
    """What was found that changes how the lumens hang together.

    Attributes
    ----------
    occluded : sequence of int
        Vessel of each occlusion.
    missing : collection of int
        Vessels that aren't there.
    bridges : sequence of (int, int)
        Vessels that are joined by a way of their own.
    """

    occluded: Sequence[int] = ()
    missing: Collection[int] = ()
    bridges: Sequence[tuple[int, int]] = ()


def compare_topology(
    network: VesselNetwork,
    grid: LumenGrid,
    near_mm: float,
    faults: Faults,
    bridge_voxels: IntArray,
    all_seen: bool,
) -> Topology:
    """Compare the printed lumens with the design's graph.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    grid : LumenGrid
        Design and scan.
    near_mm : float, mm
        Free space within this of a designed wall is lumen.
    faults : Faults
        What was found.
    bridge_voxels : (n, 3) int64
        Of the grid, that belong to bridges (z, y, x).
    all_seen : bool
        Whether all vessels were seen from end to end.
    """
    speck = max(2, round((SPECK_MM / grid.step_mm) ** 3))
    printed = grid.known & grid.free & (grid.wall_mm <= near_mm)
    printed[tuple(bridge_voxels.T)] = True
    betti = betti_numbers(without_specks(printed, speck))
    drawn = betti_numbers(without_specks(grid.known & (grid.wall_mm <= 0), speck))
    designed, expected = graph_betti(network), graph_betti(network, faults)
    telling = all_seen and drawn == designed
    return Topology(
        designed=designed,
        drawn=drawn,
        printed=betti,
        expected=expected,
        as_designed=betti == designed if telling else None,
        explained=betti == expected if telling else None,
    )


def graph_betti(network: VesselNetwork, faults: Faults | None = None) -> Betti:
    """Components and loops of a network's graph with some vessels cut through or not there.

    An occluded vessel leaves a stub at each end, and one between any two occlusions. A bridge
    counts as a vessel between the first nodes of those it joins.
    """
    faults = faults or Faults()
    ends: IntArray = network.vessel_nodes
    there = np.setdiff1d(np.arange(len(ends)), np.array(sorted(faults.missing), dtype=np.int64))
    cut = np.intersect1d(there, np.array(sorted(set(faults.occluded)), dtype=np.int64))
    bridges = ends[np.array(faults.bridges, dtype=np.int64).reshape(-1, 2), 0]
    edges = np.concatenate([ends[np.setdiff1d(there, cut)], bridges])
    used, number = np.unique(np.concatenate([edges, ends[cut]]), return_inverse=True)
    rows, columns = number.reshape(-1, 2)[: len(edges)].T
    graph = coo_matrix((np.ones(len(edges)), (rows, columns)), shape=(len(used),) * 2)
    parts = int(connected_components(graph, directed=False)[0]) if len(used) else 0
    between = sum(vessel not in faults.missing for vessel in faults.occluded) - len(cut)
    return Betti(parts + between, len(edges) - len(used) + parts, 0)
