"""Scale points, solids and networks about a centre by a separate factor for each axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.network import VesselNetwork
from design.solids.solid import Solid
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Stretch:
    """The map p → about + factor · (p - about), axis by axis.

    Attributes
    ----------
    factor : (x, y, z) float
        Written over designed length.
    about_mm : (x, y, z) float, mm
        What stays where it is, part frame: the part's middle, at the height of its foot.
    """

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    about_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def is_neutral(self) -> bool:
        """Whether it changes nothing."""
        return self.factor == (1.0, 1.0, 1.0)

    @property
    def matrix(self) -> FloatArray:
        """The map as (4, 4) homogeneous matrix, designed to written."""
        out = np.diag([*self.factor, 1.0])
        out[:3, 3] = np.array(self.about_mm) * (1 - np.array(self.factor))
        return out

    def points(self, points: FloatArray) -> FloatArray:
        """Designed places (n, 3) to written ones; exactly the same ones when neutral."""
        if self.is_neutral:
            return points
        about = np.array(self.about_mm)
        return np.asarray(about + np.array(self.factor) * (points - about))

    def back(self, points: FloatArray) -> FloatArray:
        """Written places (n, 3) to designed ones."""
        if self.is_neutral:
            return points
        about = np.array(self.about_mm)
        return np.asarray(about + (points - about) / np.array(self.factor))

    def solid(self, solid: Solid) -> Solid:
        """The solid as it is written; float32 as every solid."""
        if self.is_neutral:
            return solid
        vertices = self.points(solid.vertices).astype(np.float32).astype(np.float64)
        return Solid(vertices, solid.faces)

    def network(self, network: VesselNetwork) -> VesselNetwork:
        """The network as it is written: places moved, radii so that the volume follows."""
        if self.is_neutral:
            return network
        widths = np.concatenate(
            [self.across(way) for way in map(_ways, (p for p, _ in network.polylines()))]
        )
        return replace(
            network,
            nodes=self.points(network.nodes),
            points=self.points(network.points),
            radius=network.radius * widths,
        )

    def across(self, along: FloatArray) -> FloatArray:
        """Factor of a round lumen's equal-area radius, (n,), whose axis runs `along` (n, 3), unit.

        The volume grows by the product of the factors and the length by that along the axis; what
        is left is the area's.
        """
        factor = np.array(self.factor)
        longer = np.linalg.norm(along * factor, axis=1)
        return np.asarray(np.sqrt(np.prod(factor) / longer))


def _ways(points: FloatArray) -> FloatArray:
    """Unit direction at each point of a polyline: along the chord between its neighbours."""
    ahead = np.vstack([points[1:], points[-1:]])
    behind = np.vstack([points[:1], points[:-1]])
    way = ahead - behind
    length = np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(way / np.maximum(length, 1e-12))
