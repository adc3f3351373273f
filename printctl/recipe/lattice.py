"""Recipe section of a network that is a regular channel lattice clipped to the tissue."""

from __future__ import annotations

from printctl.recipe.lattice_shape import LatticeShape
from printctl.recipe.parts import NetworkSection


class LatticeNetwork(NetworkSection, LatticeShape):
    """Channels of a regular lattice clipped to the tissue, with one inlet and one outlet."""
