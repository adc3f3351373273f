"""Options of a channel lattice: unit cell, spacing, channel width and ports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from design.errors import NetworkError

LatticeKind = Literal["grid", "honeycomb", "gyroid", "diamond"]


@dataclass(frozen=True)
class LatticeOptions:
    """Options of a channel lattice and its ports.

    Attributes
    ----------
    kind : {"grid", "honeycomb", "gyroid", "diamond"}
        See `design.lattices.lattice.unit_cell`.
    cell_mm : float
        Edge of the unit cell; across a hexagon, and from layer to layer, in the honeycomb.
    radius_mm : float
        Of the channels.
    manifold_radius_mm : float, optional
        Of the ports and of the channels in the first and last layer, where it fits; half as much
        again as ``radius_mm`` by default.
    axis : {"x", "y", "z"}
        The inlet is at its lower end, the outlet at its upper.
    clearance_mm : float
        Between channels that don't meet, and between channels and the tissue's surface.
    """

    kind: LatticeKind
    cell_mm: float
    radius_mm: float
    manifold_radius_mm: float | None = None
    axis: Literal["x", "y", "z"] = "z"
    clearance_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(LatticeKind) or self.axis not in ("x", "y", "z"):
            raise NetworkError(
                f"lattice {self.kind!r} along {self.axis!r}: give one of "
                f"{', '.join(get_args(LatticeKind))}, along x, y or z"
            )
        sizes = (self.cell_mm, self.radius_mm, self.manifold_mm)
        if not (all(map(math.isfinite, sizes)) and min(sizes) > 0.0 and self.clearance_mm >= 0.0):
            raise NetworkError(
                f"lattice: cell_mm {self.cell_mm:g} and the radii {self.radius_mm:g} of channels "
                f"and {self.manifold_mm:g} of manifolds must be above 0, clearance_mm "
                f"{self.clearance_mm:g} at least 0"
            )
        if self.manifold_mm < self.radius_mm:
            raise NetworkError(
                f"lattice: manifolds (channels beside the ports) {2.0 * self.manifold_mm:g} mm "
                f"wide are narrower than channels of {2.0 * self.radius_mm:g}; widen the manifolds"
            )

    @property
    def manifold_mm(self) -> float:
        """Radius of the manifolds, mm."""
        return 1.5 * self.radius_mm if self.manifold_radius_mm is None else self.manifold_radius_mm
