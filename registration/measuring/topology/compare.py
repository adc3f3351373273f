"""Compare the printed lumens' components and loops with those of the design's graph."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.network import VesselNetwork
from kernels.arrays import IntArray
from registration.measuring.topology.euler import Betti, betti_numbers, without_specks
from registration.measuring.topology.grid import LumenGrid

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
