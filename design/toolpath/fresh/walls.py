"""Walls: lines of fixed width along every boundary, from the boundary into the material."""

from __future__ import annotations

from dataclasses import dataclass

from manifold3d import CrossSection, JoinType

from design.toolpath.fresh.section import COLLINEAR_MM, rings
from design.toolpath.toolpath import FloatArray

#: Leftovers narrower than this part of a line's width are corners and rounding, not gaps.
SLIVER = 0.2


@dataclass(frozen=True)
class Walls:
    """Walls of one layer and what they leave.

    Attributes
    ----------
    loops : list of list of (k, 2) arrays, mm
        Closed centrelines of the first wall, the second, …; the last point isn't repeated.
    inside : CrossSection
        What the infill must cover.
    """

    loops: list[list[FloatArray]]
    inside: CrossSection


def build_walls(material: CrossSection, width_mm: float, count: int) -> Walls:
    """Lay ``count`` walls into ``material``.

    The i-th centreline lies (i + ½) w inside the boundary, so the first line's edge *is* the
    boundary and a lumen keeps its size. Where the material is too thin for a second, third …
    wall, what is left between the walls goes to the infill, whose line ends may overlap the
    walls but never reach a lumen. Where it is too thin for the first, nothing is written; the
    coverage report counts it.
    """
    region, leftover, loops = material, CrossSection(), []
    for index in range(count):
        centre = _offset(material, -(index + 0.5) * width_mm)
        loops.append(rings(centre))
        if index > 0:
            thin = region - _offset(centre, 0.5 * width_mm)
            sliver = 0.5 * SLIVER * width_mm
            leftover += _offset(_offset(thin, -sliver), sliver)
        region = _offset(material, -(index + 1) * width_mm)
    return Walls(loops, region + leftover)


def _offset(section: CrossSection, by_mm: float) -> CrossSection:
    # Mitred: a facetted circle keeps its facets, where round joins would add points to each.
    return section.offset(by_mm, JoinType.Miter, 2.0).simplify(COLLINEAR_MM)
