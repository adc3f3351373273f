"""From the recipe's tissue section to a `Tissue`."""

from __future__ import annotations

from pathlib import Path

from design.tissue import (
    SizeLimits,
    Tissue,
    annulus,
    biventricle,
    block,
    cylinder,
    folded_cortex,
    load_tissue,
    tissue_from_surface,
)
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
            limits = SizeLimits(*part.size_limits_mm)
            return load_tissue(recipe_folder / part.mesh, part.unit, limits=limits)
        case Block():
            surface = block(part.size_mm)
        case Cylinder():
            surface = cylinder(part.diameter_mm, part.height_mm)
        case Annulus():
            surface = annulus(part.outer_diameter_mm, part.inner_diameter_mm, part.height_mm)
        case Biventricle():
            surface = biventricle(part.length_mm)
        case FoldedCortex():
            surface = folded_cortex(part.thickness_mm)
    return tissue_from_surface(surface.vertices, surface.faces)
