"""Build a run's solids from the tissue and network in its folder, with fiducial dimples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.solids import read_solid, surface_genus
from design.solids.topology import edge_faults
from design.vasculature import PLANAR_DIMPLES, Dimple
from printctl.pipeline.context import RunContext
from printctl.pipeline.solid_build import RunSolids, build
from printctl.recipe.growth import NamedNetwork
from printctl.run_folder.artefacts import SURFACE


def built_solids(context: RunContext, network: VesselNetwork | None = None) -> RunSolids:
    """All solids of the recipe; a design of ours brings its fiducial dimples.

    ``network`` is put in the design's place where it is given.
    """
    named = isinstance(context.recipe.vasculature, NamedNetwork)
    scale = context.recipe.print_scale
    marks = [_scaled(mark, scale) for mark in PLANAR_DIMPLES] if named else []
    tissue = read_solid(context.folder / SURFACE, unit="mm")
    vessels = context.network if network is None else network
    return build(context.recipe.solid, vessels, tissue, body_genus(tissue.faces), marks)


def _scaled(mark: Dimple, scale: float) -> tuple[tuple[float, float, float], float]:
    x, y, z = mark.centre_mm
    return (x * scale, y * scale, z * scale), mark.diameter_mm * scale


def body_genus(faces: NDArray[np.int32]) -> int:
    """Handles of the tissue itself (a ring has one), by its faces (m, 3)."""
    return 0 if edge_faults(faces) else surface_genus(faces)[0]
