"""Locate a recipe's planted defects on their vessels, printer's frame, for a simulated scan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.recipe.defects import (
    BulgePart,
    DefectPart,
    LeakPart,
    MissingPart,
    OcclusionPart,
    StenosisPart,
)
from sim.devices.scanner import Defect

_WIDER = 1.25
"""Gel fills a lumen to so much of its designed radius: lines may have left it wider."""


def scan_defects(
    parts: Sequence[DefectPart], network: VesselNetwork, place_mm: FloatArray
) -> list[Defect]:
    """Defects in the printer's frame.

    Parameters
    ----------
    parts : sequence of DefectPart
        As the recipe gives them.
    network : VesselNetwork
        The design, part frame.
    place_mm : (3,) mm
        Part to printer.

    Raises
    ------
    RecipeError
        When there is no such vessel.
    """
    return [_defect(part, network, place_mm) for part in parts]


def _defect(part: DefectPart, network: VesselNetwork, place: FloatArray) -> Defect:
    if part.vessel >= network.vessel_count:
        raise RecipeError(
            f"scan.defects: a {part.defect} is ordered in vessel {part.vessel}, but the network "
            f"has vessels 0 to {network.vessel_count - 1}; give one of those"
        )
    points, radii = network.polyline(part.vessel)
    path = points + place
    upto = arc_lengths(points)
    if isinstance(part, MissingPart):
        return Defect("missing", path, _WIDER * float(radii.max()))
    at = part.at * float(upto[-1])
    radius = float(np.interp(at, upto, radii))
    match part:
        case BulgePart():
            side = None if part.towards is None else np.array(part.towards)
            height = part.height_um * 1e-3
            return Defect("bulge", path, radius, at, part.length_mm, height, side=side)
        case StenosisPart():
            left = 1 - part.percent / 100
            return Defect("stenosis", path, radius, at, part.length_mm, left=left)
        case OcclusionPart():
            return Defect("occlusion", path, _WIDER * radius, at, part.length_mm)
        case LeakPart():
            begin = places_along(path, upto, np.array(at))
            way = np.stack([begin, np.array(part.to) + place])
            return Defect("leak", way, part.diameter_um * 5e-4)
