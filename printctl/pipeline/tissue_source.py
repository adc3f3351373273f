"""Build the tissue (shape, mesh, points or image; zones, demand) from a recipe's tissue section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from design.network_files.by_suffix import read_network
from design.tissue import (
    BlockZone,
    CylinderZone,
    Demand,
    MeshZone,
    SizeLimits,
    SphereZone,
    Surface,
    Tissue,
    Zone,
    annulus,
    biventricle,
    block,
    carve,
    cylinder,
    depth_demand,
    folded_cortex,
    image_demand,
    kidney,
    liver,
    load_label_surface,
    load_point_surface,
    load_surface,
    read_image,
    tissue_from_surface,
)
from printctl.recipe.sections.tissue import (
    Annulus,
    Biventricle,
    Block,
    BlockPart,
    Cylinder,
    CylinderPart,
    DemandPart,
    DepthDemandPart,
    FileSection,
    FoldedCortex,
    Kidney,
    LabelTissue,
    Liver,
    MeshPart,
    MeshTissue,
    NetworkTissue,
    PointTissue,
    SpherePart,
    TissuePart,
    ZonePart,
)

ANY_SIZE = SizeLimits(0.0, float("inf"))


def make_tissue(part: TissuePart, recipe_folder: Path) -> Tissue:
    """Build the tissue that the recipe names; paths are relative to the recipe."""
    surface, notes = _surface(part, recipe_folder)
    out, out_notes = make_zones(part.keep_out, recipe_folder)
    within, within_notes = make_zones(part.keep_within, recipe_folder)
    carved, cut_notes = carve(surface, out, within)
    notes = (*notes, *out_notes, *within_notes, *cut_notes)
    # A file's size was judged before its zones were cut.
    limits = ANY_SIZE if out or within else _limits(part)
    tissue = tissue_from_surface(carved.vertices, carved.faces, limits=limits, notes=notes)
    if part.demand is None:
        return tissue
    return replace(tissue, demand=_demand(part.demand, tissue, recipe_folder))


def _limits(part: TissuePart) -> SizeLimits:
    return SizeLimits(*part.size_limits_mm) if isinstance(part, FileSection) else SizeLimits()


def _surface(part: TissuePart, folder: Path) -> tuple[Surface, tuple[str, ...]]:
    """The shape in mm before zones, and what was done to it."""
    match part:
        case MeshTissue():
            return load_surface(folder / part.mesh, part.unit, limits=_limits(part))
        case PointTissue():
            return load_point_surface(folder / part.points, part.unit, limits=_limits(part))
        case LabelTissue():
            path = folder / part.labels
            return load_label_surface(path, part.value, voxel_mm=part.voxel_mm, unit=part.unit)
        case NetworkTissue():
            return _box_around(part, folder)
        case Block():
            return block(part.size_mm), ()
        case Cylinder():
            return cylinder(part.diameter_mm, part.height_mm), ()
        case Annulus():
            return annulus(part.outer_diameter_mm, part.inner_diameter_mm, part.height_mm), ()
        case Biventricle():
            return biventricle(part.length_mm), ()
        case Kidney():
            return kidney(part.length_mm), ()
        case Liver():
            return liver(part.width_mm), ()
        case FoldedCortex():
            return folded_cortex(part.thickness_mm), ()


def _box_around(part: NetworkTissue, folder: Path) -> tuple[Surface, tuple[str, ...]]:
    network = read_network(folder / part.network, part.unit)
    reach = network.radius[:, None] + part.margin_mm
    low, high = (network.points - reach).min(axis=0), (network.points + reach).max(axis=0)
    box = block(tuple((high - low).tolist()))
    note = (
        f"The tissue is the box {part.margin_mm:g} mm (tissue.margin_mm) beyond the vessels of "
        "{}: from ({:.4g}, {:.4g}, {:.4g}) to ({:.4g}, {:.4g}, {:.4g}) mm."
    )
    return Surface(box.vertices + low, box.faces), (note.format(part.network, *low, *high),)


def make_zones(parts: Sequence[ZonePart], folder: Path) -> tuple[list[Zone], tuple[str, ...]]:
    """The zones, and what was mended on their meshes."""
    zones: list[Zone] = []
    notes: list[str] = []
    for part in parts:
        match part:
            case CylinderPart():
                zones.append(CylinderZone(part.from_mm, part.to_mm, part.radius_mm))
            case SpherePart():
                zones.append(SphereZone(part.centre_mm, part.radius_mm))
            case BlockPart():
                zones.append(BlockZone(part.from_mm, part.to_mm))
            case MeshPart():
                # A fixture or port may be of any size.
                surface, mended = load_surface(folder / part.mesh, part.unit, limits=ANY_SIZE)
                zones.append(MeshZone(surface, part.mesh))
                notes += mended
    return zones, tuple(notes)


def _demand(part: DemandPart, tissue: Tissue, folder: Path) -> Demand:
    if isinstance(part, DepthDemandPart):
        return depth_demand(tissue, part.depth_mm, part.relative)
    image = read_image(folder / part.image, voxel_mm=part.voxel_mm, unit=part.unit)
    return image_demand(tissue, image)
