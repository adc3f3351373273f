"""Recipe section of a channel lattice, for comparison with a grown tree."""

from __future__ import annotations

from printctl.recipe.lattice_shape import LatticeShape
from printctl.recipe.parts import NetworkSection


class LatticeNetwork(NetworkSection, LatticeShape):
    """Channels of a regular lattice clipped to the tissue, with one inlet and one outlet."""
