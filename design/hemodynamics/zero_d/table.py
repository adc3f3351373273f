"""Make the per-vessel table of a steady 0D flow solution; write and read it as CSV."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from design.hemodynamics.zero_d.flow import FlowSolution
from design.hemodynamics.zero_d.shear_band import ShearBand, classify_shear
from design.hemodynamics.zero_d.validity import poiseuille_holds, reynolds
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN, WATER_DENSITY


def flow_table(
    network: VesselNetwork,
    solution: FlowSolution,
    density: float = WATER_DENSITY,
    band: ShearBand | None = None,
) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,).

    Flow, velocity and wall shear are signed: positive along the vessel, from "in" to "out", as
    designed. ``density`` in Pa·s²/mm² goes into the Reynolds number. With a ``band``
    ``wall_shear_band`` says whether the wall shear is below, inside or above it.
    """
    first, last = network.vessel_nodes.T
    pressure_in, pressure_out = solution.pressure[first], solution.pressure[last]
    number = reynolds(network, solution, density)
    table: dict[str, NDArray[np.generic]] = {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "tree": network.tree,
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
        "pressure_in_pa": pressure_in,
        "pressure_out_pa": pressure_out,
        "pressure_in_mmhg": pressure_in / PA_PER_MMHG,
        "pressure_out_mmhg": pressure_out / PA_PER_MMHG,
        "flow_ul_s": solution.flow,
        "flow_ml_min": solution.flow / UL_S_PER_ML_MIN,
        "velocity_mm_s": solution.velocity,
        "wall_shear_pa": solution.wall_shear,
        "wall_shear_dyn_cm2": solution.wall_shear * DYN_CM2_PER_PA,
        "resistance_pa_s_ul": solution.resistance,
        "reynolds": number,
        "poiseuille_holds": poiseuille_holds(network, number).astype(np.int64),
    }
    if solution.loss is not None:
        table["loss_pa"] = solution.loss
    if band is not None:
        table["wall_shear_band"] = classify_shear(solution, band)
    return table


def write_flow_csv(
    path: Path,
    network: VesselNetwork,
    solution: FlowSolution,
    band: ShearBand | None = None,
    density: float = WATER_DENSITY,
) -> None:
    """Write `flow_table` as CSV at full precision.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    table = flow_table(network, solution, density, band)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    write_text(path, out.getvalue())


def read_flow_csv(path: Path) -> list[dict[str, int | float | str]]:
    """Rows of a file that `write_flow_csv` wrote, values as they were."""
    with path.open(encoding="utf-8", newline="") as handle:
        return [
            {name: _value(text) for name, text in row.items()} for row in csv.DictReader(handle)
        ]


def _value(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
