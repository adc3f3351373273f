"""Summarise an oxygen solution: totals, extremes, balance, histogram and a table of vessels."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.oxygen.conditions import (
    AIR_MILLIMOLAR,
    AIR_MMHG,
    NMOL_PER_MOL,
    assumptions,
)
from design.hemodynamics.oxygen.solution import OxygenSolution
from design.network import VesselNetwork

BINS: Final = 40
MMHG_PER_MILLIMOLAR: Final = AIR_MMHG / AIR_MILLIMOLAR
"""Henry's law: medium at 37 °C holds 0.2 mM under 149 mmHg."""


def oxygen_summary(fine: OxygenSolution, coarse: OxygenSolution | None = None) -> dict[str, Any]:
    """Shares, extremes and balance for `report.json`; keys name their units.

    ``extraction_percent`` is what the vessels leave behind of what they bring.
    ``demand_met_percent`` holds what is taken up against what the cells would take with oxygen in
    plenty. ``cells_fed_at_most`` is the plain balance: what is brought over a cell's uptake.
    ``imbalance`` is in less out less taken up, over what is taken up. ``…_coarser`` is the same on
    a grid of twice the spacing: how much the grid matters, not a bound. ``worst_place`` is the
    middle of the widest hypoxic place, or where there is none the place with least.
    """
    conditions, grid = fine.conditions, fine.grid
    share, field = fine.tissue_share, fine.concentration
    volume = float(share.sum()) * grid.cell_ul
    per_cell = conditions.mol_per_cell_s * NMOL_PER_MOL
    at = grid.origin_mm + grid.spacing_mm * np.array(fine.worst)
    least = fine.least()
    level = conditions.threshold_millimolar
    brought = fine.supplied + max(fine.from_bath, 0.0)
    p5 = _percentile(fine, 5.0)
    summary: dict[str, Any] = {
        "hypoxic_percent": 100.0 * fine.share_below(level),
        "threshold_millimolar": level,
        "least_millimolar": least,
        "least_mmhg": least * MMHG_PER_MILLIMOLAR,
        "worst_place_mm": np.round(at, 4).tolist(),
        "mean_millimolar": float((share * field).sum() / share.sum()),
        "p5_millimolar": p5,
        "inlet_millimolar": conditions.inlet_millimolar,
        "outlet_millimolar": fine.drained / fine.flow_ul_s,
        "supplied_nmol_s": fine.supplied,
        "drained_nmol_s": fine.drained,
        "from_bath_nmol_s": fine.from_bath,
        "consumed_nmol_s": fine.consumed,
        "imbalance": fine.imbalance,
        "extraction_percent": 100.0 * (fine.supplied - fine.drained) / fine.supplied
        if fine.supplied > 0.0
        else 0.0,
        "demand_met_percent": 100.0 * fine.consumed / (volume * conditions.uptake_millimolar_s),
        "cells": conditions.cells_per_ml * volume * 1e-3,
        "cells_fed_at_most": brought / per_cell,
        "tissue_mm3": volume,
        "spacing_um": grid.spacing_mm * 1e3,
        "grid_cells": int(grid.inside.sum()),
    }
    if coarse is not None:
        summary["hypoxic_coarser_percent"] = 100.0 * coarse.share_below(level)
    return summary | {"histogram": histogram(fine), "assumptions": assumptions(conditions)}


def _percentile(solution: OxygenSolution, percent: float) -> float:
    """By volume."""
    held = solution.tissue_share > 0.0
    value, weight = solution.concentration[held], solution.tissue_share[held]
    order = np.argsort(value)
    below = np.cumsum(weight[order])
    return float(value[order][np.searchsorted(below, percent / 100.0 * below[-1])])


def histogram(solution: OxygenSolution) -> dict[str, list[float]]:
    """``edges_millimolar`` (n + 1) from 0 to the most there is, ``share`` of the tissue (n)."""
    top = max(solution.conditions.inlet_millimolar, solution.conditions.bath_millimolar or 0.0)
    top = max(top, 1e-9)
    share, edges = np.histogram(
        np.clip(solution.concentration, 0.0, top),
        bins=BINS,
        range=(0.0, top),
        weights=solution.tissue_share,
    )
    return {"edges_millimolar": edges.tolist(), "share": (share / share.sum()).tolist()}


def oxygen_table(
    network: VesselNetwork, solution: OxygenSolution
) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,); in and out are in the flow's direction.

    ``wall_flux_nmol_s`` is given to the tissue; below 0 where a vessel takes oxygen up.
    """
    return {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
        "oxygen_in_millimolar": solution.entry,
        "oxygen_out_millimolar": solution.exit,
        "oxygen_in_mmhg": solution.entry * MMHG_PER_MILLIMOLAR,
        "oxygen_out_mmhg": solution.exit * MMHG_PER_MILLIMOLAR,
        "wall_flux_nmol_s": solution.wall_flux,
    }
