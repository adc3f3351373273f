"""Independent checkers of exported networks and G-code; they share no code with the product."""

from benchmarks.checkers.collisions import Near, near_pairs
from benchmarks.checkers.containment import Outside, pieces_outside, winding_numbers
from benchmarks.checkers.murray import (
    Perfusion,
    consistent_radii,
    murray_ratios,
    murray_residual,
)
from benchmarks.checkers.poiseuille import loop_flows, outlet_flows, spread
from benchmarks.checkers.read_network import Pieces, pieces_of, read_network
from benchmarks.checkers.read_stl import box_triangles, enclosed_volume, read_stl, write_stl

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
