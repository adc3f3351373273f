"""Level sections of a solid, one at the middle of each layer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from manifold3d import CrossSection, Error, Manifold, Mesh

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath.toolpath import FloatArray

#: Vertices nearer than this to the line through their neighbours are dropped, mm. Triangulated
#: straight walls are cut into many collinear pieces.
COLLINEAR_MM = 1e-4


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
    middle_mm : float, mm
        Height of that section.
    """

    index: int
    tip_mm: float
    material: CrossSection
    middle_mm: float


def layers(solid: Solid, layer_height_mm: float) -> Iterator[Layer]:
    """Yield the layers from the lowest up; a layer without material is left out.

    The solid is cut into round(height / layer height) layers, so that the written height is
    within half a layer of the designed one.

    Raises
    ------
    ToolpathError
        When the mesh isn't a manifold or is lower than half a layer.
    """
    body = manifold_of(solid, "solid")
    low, high = float(solid.bounds[0, 2]), float(solid.bounds[1, 2])
    count = layer_count(low, high, layer_height_mm)
    if count == 0:
        raise ToolpathError(
            f"solid is {high - low:g} mm high, less than half a layer of {layer_height_mm:g} mm "
            "(layer_height_mm); check the part's unit or write thinner layers"
        )
    for index in range(count):
        middle = low + (index + 0.5) * layer_height_mm
        material = body.slice(middle).simplify(COLLINEAR_MM)
        if not material.is_empty():
            yield Layer(index, low + (index + 1) * layer_height_mm, material, middle)


def layer_count(low_mm: float, high_mm: float, layer_height_mm: float) -> int:
    """How many layers come nearest to the part's height."""
    return int(np.floor((high_mm - low_mm) / layer_height_mm + 0.5 - 1e-6))


def rings(section: CrossSection) -> list[FloatArray]:
    """Closed contours, each (k, 2) mm without a repeated last point; holes run clockwise."""
    return [np.asarray(ring, dtype=np.float64) for ring in section.to_polygons() if len(ring) > 2]


def boundary(section: CrossSection) -> shapely.MultiLineString:
    """All contours as prepared lines, to ask what crosses them."""
    closed = [np.vstack([ring, ring[:1]]) for ring in rings(section)]
    lines = shapely.multilinestrings([shapely.linestrings(ring) for ring in closed])
    shapely.prepare(lines)
    return lines


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
