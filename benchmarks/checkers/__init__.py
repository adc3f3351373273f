"""Independent checkers of exported networks and G-code; they share no code with the product."""

from benchmarks.checkers.containment import Outside, pieces_outside, winding_numbers
from benchmarks.checkers.meshes import box_triangles, enclosed_volume, read_stl, write_stl
from benchmarks.checkers.networks import (
    Near,
    Perfusion,
    Pieces,
    consistent_radii,
    loop_flows,
    murray_ratios,
    murray_residual,
    near_pairs,
    outlet_flows,
    pieces_of,
    read_network,
    spread,
)

__all__ = [
    "Near",
    "Outside",
    "Perfusion",
    "Pieces",
    "box_triangles",
    "consistent_radii",
    "enclosed_volume",
    "loop_flows",
    "murray_ratios",
    "murray_residual",
    "near_pairs",
    "outlet_flows",
    "pieces_of",
    "pieces_outside",
    "read_network",
    "read_stl",
    "spread",
    "winding_numbers",
    "write_stl",
]
