"""Build regular lattices of channels clipped to a tissue, with one inlet and one outlet.

Goes in: a tissue and options. Comes out: a network. Begin with `lattice.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.lattices.lattice import build_lattice
    from design.lattices.options import LatticeKind, LatticeOptions

__all__ = ["LatticeKind", "LatticeOptions", "build_lattice"]

__getattr__, __dir__ = on_demand(__name__)
