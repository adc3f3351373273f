"""Build a FRESH part's infill, and its regions with their own infill or head, from a recipe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from design.network import VesselNetwork
from design.solids import Solid, lumen_solid, solid_from_surface
from design.tissue import zone_surface
from design.toolpath.fresh import Filling, Region
from printctl.pipeline.tissue_source import make_zones
from printctl.recipe.regions import FillingPart, RegionPart


def make_filling(part: FillingPart) -> Filling:
    """The recipe's infill."""
    return Filling(part.infill, part.infill_percent * 1e-2, part.infill_angles_deg)


def make_region(
    part: RegionPart, number: int, folder: Path, network: VesselNetwork, scale: float = 1.0
) -> Region:
    """Region ``number`` (0 first) of a recipe in ``folder``, for the part's ``network``.

    The network has the print's size; places, said in the design's, come ``scale`` times as large.

    Raises
    ------
    DesignError
        When its mesh can't be read or isn't closed, or it has no volume.
    """
    solid = _solid(part, f"toolpath.regions.{number}", folder, network, scale)
    return Region(solid, make_filling(part), part.head)


def _solid(
    part: RegionPart, name: str, folder: Path, network: VesselNetwork, scale: float
) -> Solid:
    if part.where is None:
        wider = replace(network, radius=network.radius + (part.around_vessels_mm or 0.0))
        return lumen_solid(wider)
    (zone,), _ = make_zones([part.where], folder)
    surface = zone_surface(zone, name)
    return solid_from_surface(surface.vertices * scale, surface.faces)
