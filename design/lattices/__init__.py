"""Lattices of channels clipped to a tissue, with one inlet and one outlet."""

from design.lattices.cells import LatticeKind
from design.lattices.lattice import LatticeOptions, build_lattice

__all__ = ["LatticeKind", "LatticeOptions", "build_lattice"]
