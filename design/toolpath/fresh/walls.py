"""Lay walls along a layer's contours, and lines in gaps; return the region left for infill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, JoinType

from design.toolpath.fresh.contours import contours_of
from design.toolpath.fresh.paths import Paths, join
from design.toolpath.fresh.section import COLLINEAR_MM
from design.toolpath.fresh.thin import gap_paths, wall_paths
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Walls:
    """Walls of one layer and what they leave.

    Attributes
    ----------
    paths : Paths
        Walls, and lines in the gaps that are too thin for one.
    inside : CrossSection
        What the infill must cover.
    """

    paths: Paths
    inside: CrossSection


def build_walls(material: CrossSection, width_mm: float, count: int, least: float) -> Walls:
    """Lay ``count`` walls into ``material``.

    The i-th centreline lies (i + ½) w inside the boundary, so the first line's edge *is* the
    boundary and a lumen keeps its size. Places thinner than two walls are shared between them
    (`thin`), those thinner than one get one line as wide as they are, and those thinner than
    ``least`` widths none; the coverage report counts them.
    """
    parts: list[Paths] = []
    region = material
    for level in range(count):
        if region.is_empty():
            break
        centre = _offset(material, -(level + 0.5) * width_mm)
        parts.append(wall_paths(contours_of(centre), width_mm, least, level))
        covered = _offset(centre, 0.5 * width_mm)
        parts.append(_gaps(region, covered, width_mm, least, between=level > 0))
        region = _offset(material, -(level + 1) * width_mm)
    # What is left between two last walls, narrower than an infill line, is a gap too.
    broad = _offset(_offset(region, -0.5 * width_mm), 0.5 * width_mm)
    parts.append(_gaps(region, broad, width_mm, least, between=True))
    return Walls(join(parts), broad)


def clear_of_lumens(material: CrossSection, clear_mm: float) -> CrossSection:
    """The material without what is nearer to a hole in it than ``clear_mm``.

    Below 0 the holes become smaller. A lumen that is open to the outside in this section is no
    hole in it and stays.
    """
    rings = material.to_polygons()
    holes = [ring[::-1] for ring in rings if _signed_area(ring) < 0]
    if not holes or clear_mm == 0:
        return material
    made = CrossSection(holes).offset(clear_mm, JoinType.Miter, 2.0)
    if clear_mm > 0:
        return material - made
    return material + CrossSection(holes) - made


def moved_in(material: CrossSection, by_mm: float) -> CrossSection:
    """The material with its whole boundary moved inward."""
    return material if by_mm == 0 else _offset(material, -by_mm)


def _signed_area(ring: FloatArray) -> float:
    x, y = ring[:, 0], ring[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _gaps(
    region: CrossSection, covered: CrossSection, width_mm: float, least: float, *, between: bool
) -> Paths:
    """Lines in the places of ``region`` that are thinner than a line: those not ``covered``."""
    half = 0.5 * least * width_mm
    if region.area() - covered.area() < half * width_mm:
        return join([])  # not even the shortest line that is worth it
    left = region - covered
    core = left.offset(-0.98 * half, JoinType.Miter, 2.0)
    if core.is_empty():
        return join([])
    # Corners and rounding fall away here; places as wide as a line that can be written stay.
    kept = contours_of(left ^ core.offset(2 * half, JoinType.Miter, 2.0))
    return gap_paths(kept, width_mm, least, between=between)


def _offset(section: CrossSection, by_mm: float) -> CrossSection:
    # Mitred: a facetted circle keeps its facets, where round joins would add points to each.
    return section.offset(by_mm, JoinType.Miter, 2.0).simplify(COLLINEAR_MM)
