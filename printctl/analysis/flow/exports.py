"""Write a flow problem as input of svZeroDSolver, svOneDSolver or svMultiPhysics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from design.hemodynamics import write_svoned
from design.hemodynamics.other_solvers.svzerod import write_svzerod
from design.network import VesselNetwork
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.solve import one_d_options
from printctl.recipe.parts import Export, OneDPart, ThreeDPart

EXPORTS: Final[Mapping[Export, str]] = {
    "svzerod": "svzerod.json",
    "svoned": "svoned.in",
    "svmultiphysics": "svmultiphysics",
}
"""File or folder of each in a run folder."""
_STEADY_STEPS: Final = 8
"""Of a cycle in which nothing changes."""


def write_exports(
    paths: Mapping[Export, Path],
    network: VesselNetwork,
    driven: Driven,
    space: ThreeDPart,
    fillet_ratio: float,
) -> tuple[list[Path], dict[str, Any]]:
    """Write each solver's input to its path; return the files, and what to report of them.

    Parameters
    ----------
    space : ThreeDPart
        Of which svMultiPhysics' mesh has ``edge_ratio``.
    fillet_ratio : float
        Of that mesh's lumens.

    Raises
    ------
    FlowError, SolidError, UsageError, OSError
        As `Driven.problem`, `lumen_mesh` and the writers.
    """
    if not paths:
        return [], {}
    reported: dict[str, Any] = {}
    conditions, pulse = driven.problem(network), driven.part.pulse
    steps = _STEADY_STEPS if pulse is None else pulse.steps
    if "svzerod" in paths:
        write_svzerod(paths["svzerod"], network, conditions, steps)
    if "svoned" in paths:
        options = one_d_options(driven.part.one_d or OneDPart(), steps)
        write_svoned(paths["svoned"], network, conditions, options)
    if "svmultiphysics" in paths:
        # Heavy (3D flow), and few ask for it.
        from design.hemodynamics.other_solvers.svmultiphysics import (
            straight_shares,
            write_svmultiphysics,
        )
        from design.hemodynamics.three_d import straighten_edges
        from printctl.analysis.flow.printed.printed_fidelities import mesh_of

        mesh = straighten_edges(mesh_of(network, space, fillet_ratio))[0]
        write_svmultiphysics(paths["svmultiphysics"], mesh, conditions)
        kept = straight_shares(mesh)
        reported["svmultiphysics"] = {
            "elements": len(mesh.tets),
            "edge_ratio": space.edge_ratio,
            "volume_share": kept.volume,
            "inlet_area_share": kept.inlet_area,
        }
    return list(paths.values()), reported


def export_notes(reported: Mapping[str, Any]) -> list[str]:
    """Return a note on what svMultiPhysics' straight elements leave out of the lumen."""
    if (mesh := reported.get("svmultiphysics")) is None:
        return []
    volume, area, edge = (mesh[key] for key in ("volume_share", "inlet_area_share", "edge_ratio"))
    return [
        f"svmultiphysics: its elements are straight and hold {volume:.1%} of the lumen's volume "
        f"and {area:.1%} of its inlets' area, so that it resists about {volume**-2 - 1.0:.0%} "
        "more; "
        f"--edge-ratio (three_d.edge_ratio of a recipe) below {edge:g} makes the mesh finer"
    ]
