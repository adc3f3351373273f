"""Compare a lattice's flow with a network's at equal inlet flow; write a table and a picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes
from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselKind, VesselNetwork
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray
from printctl.analysis.flow.tables import write_columns
from report.figures.flow_figures import spread_figure

TABLE, PICTURE = "flow_beside.csv", "flow_beside.svg"
_STILL: Final = 0.1
"""Of the mean: a vessel with less flow is nearly still."""

_THIN: Final = 1.1
"""Of the least radius: what a vessel that exchanges may have."""


@dataclass(frozen=True)
class TissueSupply:
    """The vessels of a network that feed the tissue, and what flows in them.

    Attributes
    ----------
    name : str
    vessel : (k,) int64
        Connections of artery and vein where there are any; else what ends in the tissue; in a
        lattice its channels without the wider ones beside the ports.
    flow : (k,) float64, µL/s
    wall_shear : (k,) float64, Pa
    drop_pa : float
        Over the whole network.
    """

    name: str
    vessel: Any
    flow: FloatArray
    wall_shear: FloatArray
    drop_pa: float


def feeding_vessels(name: str, network: VesselNetwork, conditions: FlowConditions) -> TissueSupply:
    """Solve a network's steady flow, and take the vessels that feed.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    solution = solve_flow(network, conditions)
    mine = vessels_to_tissue(network)
    return TissueSupply(
        name,
        mine,
        np.abs(solution.flow[mine]),
        np.abs(solution.wall_shear[mine]),
        float(np.ptp(solution.pressure)),
    )


def vessels_to_tissue(network: VesselNetwork) -> Any:
    """Vessels that feed the tissue, see `TissueSupply.vessel`."""
    joined = np.flatnonzero(network.kind == VesselKind.CONNECTION)
    if len(joined):
        return joined
    ends = np.isin(network.vessel_nodes[:, 1], network.outlets())
    if ends.sum() > 1:
        return np.flatnonzero(ends)
    radius = network.mean_radius()
    return np.flatnonzero(radius <= _THIN * radius.min())


def compare_with_lattice(
    folder: Path, network: VesselNetwork, lattice: VesselNetwork, conditions: FlowConditions
) -> tuple[dict[str, Any], list[str]]:
    """Solve both at the same inlet flow and fluid, write `TABLE` and `PICTURE`; summary, files.

    Raises
    ------
    FlowError, OSError
        As `solve_flow`, and when a file can't be written.
    """
    # Nodes and outlets of their own are the network's: the lattice has one inlet and one outlet.
    plain = replace(conditions, inlets=None, outlets=None, outlet_flow_ul_s={})
    both = (
        feeding_vessels("network", network, conditions),
        feeding_vessels("lattice", lattice, plain),
    )
    write_columns(folder / TABLE, _table(both))
    flows = {one.name: one.flow / one.flow.mean() for one in both}
    write_bytes(folder / PICTURE, spread_figure(flows))
    return {one.name: _supply_numbers(one) for one in both}, [TABLE, PICTURE]


def _table(both: tuple[TissueSupply, ...]) -> dict[str, Any]:
    return {
        "network": np.concatenate([np.full(len(one.vessel), one.name) for one in both]),
        "vessel": np.concatenate([one.vessel for one in both]),
        "flow_ml_min": np.concatenate([one.flow for one in both]) / UL_S_PER_ML_MIN,
        "wall_shear_dyn_cm2": np.concatenate([one.wall_shear for one in both]) * DYN_CM2_PER_PA,
    }


def _supply_numbers(one: TissueSupply) -> dict[str, Any]:
    mean = one.flow.mean()
    return {
        "feeding_vessels": len(one.vessel),
        "flow_spread_percent": float(100.0 * one.flow.std() / mean),
        "least_flow_percent_of_mean": float(100.0 * one.flow.min() / mean),
        "greatest_flow_percent_of_mean": float(100.0 * one.flow.max() / mean),
        "nearly_still_percent": float(100.0 * (one.flow < _STILL * mean).mean()),
        "wall_shear_median_dyn_cm2": float(np.median(one.wall_shear)) * DYN_CM2_PER_PA,
        "pressure_drop_mmhg": one.drop_pa / PA_PER_MMHG,
    }
