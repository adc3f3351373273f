"""Compare printed lumens with the design: components and loops, leaks, bridges, overlap.

Goes in: a segmented scan and the design. Comes out: Betti numbers, leaks, overlap. Begin with
`compare.py`.
"""

from registration.topology.compare import Faults, Topology, compare_topology, graph_betti
from registration.topology.euler import Betti, betti_numbers
from registration.topology.grid import LumenGrid, lay_grid, scanned_with
from registration.topology.leaks import Leaks, LeakSearch, find_leaks
from registration.topology.overlap import Agreement, Overlap, agreement, overlap

__all__ = [
    "Agreement",
    "Betti",
    "Faults",
    "LeakSearch",
    "Leaks",
    "LumenGrid",
    "Overlap",
    "Topology",
    "agreement",
    "betti_numbers",
    "compare_topology",
    "find_leaks",
    "graph_betti",
    "lay_grid",
    "overlap",
    "scanned_with",
]
