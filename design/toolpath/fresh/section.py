"""Cut horizontal sections of a solid at mid-layer heights, with lumens kept at full width.

A line's round side touches a slanted wall above or below its crest, so the section at mid-layer
alone lets it stand into the lumen, by r (1 - cos φ) for a side of radius r and a wall φ off the
upright. The crest must keep r (1/cos φ - 1) away from the wall at mid-layer. That is, to 3 µm up
to 80° at r = 30 µm, the greater of 0 and 0.8 r tan φ - 0.4 r.

Seven tenths of that are kept: the lumen is united with its sections 0.56 r above and below, each
made smaller by 0.28 r. All of it leaves the widest free circle as designed, but floors and ceilings
of lying lumens 0.4 layers too high, and lumens of the example planar_fresh 13 to 25 µm wide of the
design as scanned; without any they are 9 µm narrow to 7 µm wide, so they are 5 to 16 µm wide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, Error, JoinType, Manifold, Mesh, OpType

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.solids.solid import Solid
from design.toolpath.fresh.options import FreshOptions
from kernels.arrays import FloatArray

#: Vertices nearer than this to the line through their neighbours are dropped, mm. Triangulated
#: straight walls are cut into many collinear pieces.
COLLINEAR_MM = 1e-4
#: The same of sections: a fine mesh has points that no motor step of 12.5 µm could tell apart.
SECTION_MM = 5e-4
#: Sections beside the one at mid-layer, in layer heights: 0.56 of a round side's radius.
BESIDE = 0.28
#: By how much these are made smaller, over what a bead is wider than its rectangle, one side.
BEHIND = 0.28 / (1 - np.pi / 4)
#: Gaps between bodies of one part that are closed, half of their width, mm: where two surfaces that
#: should meet were made into triangles apart.
CLOSING_MM = 5e-3


class Body:
    """One or more closed bodies that are cut as one.

    Parameters
    ----------
    solids : sequence of Solid
        Where there are several, gaps between them up to 2 `CLOSING_MM` wide are closed.

    Raises
    ------
    ToolpathError
        When one isn't a closed manifold.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        several = len(solids) > 1
        self._bodies = [
            manifold_of(solid, f"solid {k + 1}" if several else "solid")
            for k, solid in enumerate(solids)
        ]
        self.low_mm = min(float(solid.bounds[0, 2]) for solid in solids)
        self.high_mm = max(float(solid.bounds[1, 2]) for solid in solids)

    @property
    def volume_ul(self) -> float:
        """Volume of the bodies, µL; where they overlap, once."""
        if len(self._bodies) == 1:
            return self._bodies[0].volume()
        return Manifold.batch_boolean(self._bodies, OpType.Add).volume()

    def slice(self, z_mm: float) -> CrossSection:
        """Section at a height."""
        if len(self._bodies) == 1:
            return self._bodies[0].slice(z_mm)
        cuts = [body.slice(z_mm) for body in self._bodies]
        whole = CrossSection.batch_boolean(cuts, OpType.Add)
        closed = whole.offset(CLOSING_MM, JoinType.Miter, 2.0)
        return whole + closed.offset(-CLOSING_MM, JoinType.Miter, 2.0)


@dataclass(frozen=True)
class Layer:
    """One layer of the part.

    Attributes
    ----------
    index : int
        0 for the lowest.
    tip_mm : float, mm
        The needle's tip while the layer is written: the layer's top.
    material : CrossSection
        Section at the middle of the layer.
    carved : CrossSection
        The same without what lines would stand in lumens with, above or below their crests.
    middle_mm : float, mm
        Height of that section.
    height_mm : float, mm
        Of the layer.
    """

    index: int
    tip_mm: float
    material: CrossSection
    carved: CrossSection
    middle_mm: float
    height_mm: float


def layers(body: Body, levels: FloatArray, inset_mm: Callable[[float], float]) -> Iterator[Layer]:
    """Yield the layers from the lowest up; a layer without material is left out.

    Parameters
    ----------
    body : Body
    levels : (n + 1,) float64, mm
        Borders of the layers, ascending.
    inset_mm : callable
        By how much half a line's bead is wider than half its rectangle, of a layer's height.
    """
    for index, (low, high) in enumerate(pairwise(levels.tolist())):
        middle, height = 0.5 * (low + high), round(high - low, 9)
        material = body.slice(middle).simplify(SECTION_MM)
        if not material.is_empty():
            carved = _carved(body, material, middle, height, inset_mm(height))
            yield Layer(index, high, material, carved, middle, height)


def _carved(
    body: Body, material: CrossSection, middle: float, height: float, inset: float
) -> CrossSection:
    """The material without the lumens' sections above and below; see the module."""
    for side in (-BESIDE, BESIDE):
        hollow = _hollow(body.slice(middle + side * height))
        if not hollow.is_empty():
            material = material - hollow.offset(-BEHIND * inset, JoinType.Miter, 2.0)
    return material.simplify(SECTION_MM)


def _hollow(section: CrossSection) -> CrossSection:
    """Lumens of a section, those that open to the outside too: its pieces' hulls without it."""
    pieces = section.decompose()
    if all(piece.num_contour() == 1 and _is_convex(piece) for piece in pieces):
        return CrossSection()
    return CrossSection.batch_boolean([piece.hull() for piece in pieces], OpType.Add) - section


def _is_convex(piece: CrossSection) -> bool:
    return piece.hull().area() - piece.area() < COLLINEAR_MM**2


def rings(section: CrossSection) -> list[FloatArray]:
    """Closed contours, each (k, 2) mm without a repeated last point; holes run clockwise."""
    return [np.asarray(ring, dtype=np.float64) for ring in section.to_polygons() if len(ring) > 2]


def manifold_of(solid: Solid, what: str) -> Manifold:
    """Hand a solid to manifold3d.

    Raises
    ------
    ToolpathError
        When ``what`` isn't a closed manifold.
    """
    body = Manifold(Mesh(solid.vertices.astype(np.float32), solid.faces.astype(np.uint32)))
    if body.status() != Error.NoError or body.is_empty():
        raise ToolpathError(
            f"{what} can't be sliced: its mesh isn't a closed manifold ({body.status().name}); "
            "mend it before slicing"
        )
    return body


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
