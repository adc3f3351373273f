"""Compare printed lumens with the design: components and loops, leaks, bridges, overlap.

Goes in: a segmented scan and the design. Comes out: Betti numbers, leaks, overlap. Begin with
`compare.py`.
"""

from registration.measuring.topology.compare import (
    Betti,
    Faults,
    Topology,
    betti_numbers,
    compare_topology,
)
from registration.measuring.topology.grid import LumenGrid, lay_grid, scanned_with
from registration.measuring.topology.leaks import LeakSearch, find_leaks
from registration.measuring.topology.overlap import Agreement, Landed, Overlap, agreement, overlap

__all__ = [
    "Agreement",
    "Betti",
    "Faults",
    "Landed",
    "LeakSearch",
    "LumenGrid",
    "Overlap",
    "Topology",
    "agreement",
    "betti_numbers",
    "compare_topology",
    "find_leaks",
    "lay_grid",
    "overlap",
    "scanned_with",
]
