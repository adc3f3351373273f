"""From the recipe's tissue section to a `Tissue`."""

from __future__ import annotations

from pathlib import Path

from design.tissue import Tissue, load_tissue, shapes, tissue_from_surface
from printctl.recipe.parts import (
    Annulus,
    Biventricle,
    Block,
    Cylinder,
    FoldedCortex,
    MeshTissue,
    TissuePart,
)


def make_tissue(part: TissuePart, recipe_folder: Path) -> Tissue:
    """Build the tissue that the recipe names; paths are relative to the recipe."""
    match part:
        case MeshTissue():
            path = recipe_folder / part.mesh
            return load_tissue(path, part.unit, size_limits_mm=part.size_limits_mm)
        case Block():
            surface = shapes.block(part.size_mm)
        case Cylinder():
            surface = shapes.cylinder(part.radius_mm, part.height_mm)
        case Annulus():
            surface = shapes.annulus(part.inner_radius_mm, part.outer_radius_mm, part.height_mm)
        case Biventricle():
            surface = shapes.biventricle(part.height_mm)
        case FoldedCortex():
            surface = shapes.folded_cortex(part.thickness_mm)
    return tissue_from_surface(*surface)
