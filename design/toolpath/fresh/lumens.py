"""Refuse a network with lumens too small for the layer height and line width."""

from __future__ import annotations

import numpy as np

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath.fresh.options import FreshOptions


def check_lumens(network: VesselNetwork, options: FreshOptions) -> None:
    """Check every vessel of ``network`` against the smallest lumen the options leave open.

    Raises
    ------
    ToolpathError
        With the narrowest vessel, its diameter, the limit and the remedy.
    """
    narrowest = np.minimum.reduceat(network.radius, network.offset[:-1]) * 2
    limit = options.smallest_lumen_mm
    closed = np.flatnonzero(narrowest < limit * (1 - 1e-9))
    if len(closed):
        vessel = int(closed[np.argmin(narrowest[closed])])
        raise ToolpathError(
            f"vessel {vessel}: lumen of {narrowest[vessel]:.3f} mm is narrower than "
            f"{limit:.3f} mm, which lines of {options.line_width_mm:g} mm in layers of "
            f"{options.layer_height_mm:g} mm leave open ({len(closed)} such vessels); "
            "use a finer needle and thinner layers, or fix a larger smallest lumen in the design"
        )
