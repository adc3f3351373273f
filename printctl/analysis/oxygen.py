"""Solve oxygen in vessels and tissue as a recipe asks; write table, field and picture.

Goes in: a recipe's section, a network and its flow. Comes out: tables, a field, a picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from design.files import write_bytes
from design.hemodynamics import FlowSolution, vessel_resistance
from design.hemodynamics.oxygen import (
    OxygenConditions,
    grid_of_tissue,
    oxygen_summary,
    oxygen_table,
    solve_refined,
    spacing_for,
    write_oxygen_vti,
)
from design.network import VesselNetwork
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from printctl.analysis.flow.tables import write_columns
from printctl.progress import Report
from printctl.recipe.parts import OxygenPart
from printctl.run_folder.artefacts import OXYGEN

if TYPE_CHECKING:  # loads matplotlib
    from printctl.analysis.networks import Source

TABLE: Final = OXYGEN
FIELD: Final = "oxygen.vti"
SLICE: Final = "oxygen.svg"
_ASSUMED: Final = ("cells_per_ml", "uptake_mol_per_cell_s")


def oxygen_conditions(part: OxygenPart) -> OxygenConditions:
    """A recipe's words in the design's units."""
    return OxygenConditions(
        inlet_millimolar=part.inlet_millimolar,
        cells_per_ml=part.cells_per_ml,
        mol_per_cell_s=part.uptake_mol_per_cell_s,
        half_millimolar=part.half_millimolar,
        tissue_diffusivity_mm2_s=part.tissue_diffusivity_mm2_s,
        medium_diffusivity_mm2_s=part.medium_diffusivity_mm2_s,
        sherwood=part.sherwood,
        threshold_millimolar=part.threshold_millimolar,
        bath_millimolar=part.bath_millimolar,
    )


def solve_and_write(
    folder: Path,
    network: VesselNetwork,
    flow: FlowSolution,
    tissue: Tissue,
    part: OxygenPart,
    report: Report,
    scale: float = 1.0,
) -> dict[str, Any]:
    """Solve on three grids, write `TABLE`, `FIELD` and `SLICE`, return the summary.

    Parameters
    ----------
    network : VesselNetwork
        In the print's size, ``scale`` times the tissue's.
    flow : FlowSolution
        Of that network.
    tissue : Tissue
    part : OxygenPart
    report : Report
        Of progress.

    Raises
    ------
    FlowError
        As `solve_refined`.
    OSError
        When a file can't be written.
    """
    # Heavy (matplotlib, a CPU second), and every design loads this module.
    from report.figures.oxygen_figures import slice_figure

    spacing = (
        spacing_for(tissue.bounds * scale, part.grid_cells)
        if part.spacing_um is None
        else part.spacing_um * 1e-3
    )
    fine, coarse = solve_refined(
        network,
        flow,
        lambda size: grid_of_tissue(tissue, size, scale),
        spacing,
        oxygen_conditions(part),
        report=report,
    )
    table = oxygen_table(network, fine)
    write_columns(folder / TABLE, table)
    write_oxygen_vti(folder / FIELD, fine)
    write_bytes(folder / SLICE, slice_figure(fine, network))
    return oxygen_summary(fine, coarse) | {"vessels": _rows(table)}


def _rows(table: dict[str, Any]) -> list[dict[str, Any]]:
    """JSON-ready; a vessel without flow has no oxygen of its own."""
    columns = [
        [None if value != value else value for value in column.tolist()]
        for column in table.values()
    ]
    return [dict(zip(table, row, strict=True)) for row in zip(*columns, strict=True)]


def hypoxia(summary: dict[str, Any], part: OxygenPart) -> str:
    """The finding in a sentence, and which of ``part``'s constants are assumptions of ours."""
    x, y, z = summary["worst_place_mm"]
    usual = {key: OxygenPart.model_fields[key].default for key in _ASSUMED}
    rests = "".join(
        f"; {key} {value:g} is an assumption, not measured: give yours"
        for key, value in usual.items()
        if getattr(part, key) == value
    )
    word = " the widest such place is " if summary["hypoxic_percent"] > 0.0 else " "
    return (
        f"{summary['hypoxic_percent']:.3g} % of the tissue is below "
        f"{summary['threshold_millimolar']:g} mM; the least is "
        f"{summary['least_millimolar']:.3g} mM,{word}at ({x:g}, {y:g}, {z:g}) mm{rests}"
    )


def known_flow(source: Source) -> FlowSolution | None:
    """The flow that a run found; None where nothing is known."""
    known, network = source.known.flow, source.network
    if "flow_ul_s" not in known:
        return None
    flow, radius = known["flow_ul_s"], network.mean_radius()
    return FlowSolution(
        pressure=_node_pressure(network, known["pressure_in_mmhg"], known["pressure_out_mmhg"]),
        flow=flow,
        velocity=flow / (np.pi * radius**2),
        wall_shear=known["wall_shear_pa"],
        resistance=vessel_resistance(network, 1e-3),
    )


def _node_pressure(network: VesselNetwork, enter: Any, leave: Any) -> Any:
    pressure = np.zeros(len(network.nodes))
    pressure[network.vessel_nodes[:, 0]] = enter * PA_PER_MMHG
    pressure[network.vessel_nodes[:, 1]] = leave * PA_PER_MMHG
    return pressure
