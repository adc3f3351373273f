"""Match vessel radii to a wanted flow split in 3D; write radii, history and reduced model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d import ThreeDSolution
from design.hemodynamics.three_d.vessels.effective import effective_network, flow_error
from design.hemodynamics.three_d.vessels.match import (
    MatchedNetwork,
    MatchOptions,
    ideal_target,
    match_split,
    outlet_target,
)
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from printctl.analysis.flow.tables import write_columns
from printctl.analysis.flow.three_d import Tell

MATCHED, HISTORY, VESSELS = "network_matched.csv", "flow_match.csv", "flow_match_vessels.csv"

_PERCENT: Final = 100.0


def match_and_write(
    folder: Path,
    network: VesselNetwork,
    conditions: FlowConditions,
    wanted_ml_min: Mapping[int, float],
    options: MatchOptions,
    tell: Tell,
) -> dict[str, Any]:
    """Match, write `MATCHED`, `HISTORY` and `VESSELS`, and return the summary.

    Parameters
    ----------
    wanted_ml_min : mapping of node to mL/min
        Flows wanted at outlets; where empty, the design's ideal ones in all vessels.

    Raises
    ------
    FlowError, SolidError
        As `match_split`.
    OSError
        When a file can't be written.
    """
    flows = {node: flow * UL_S_PER_ML_MIN for node, flow in wanted_ml_min.items()}
    target = (
        outlet_target(network, conditions, flows) if flows else ideal_target(network, conditions)
    )
    done = match_split(network, conditions, target, options, tell)
    folder.mkdir(parents=True, exist_ok=True)
    write_network_csv(folder / MATCHED, done.network)
    write_columns(folder / HISTORY, _history(done))
    write_columns(folder / VESSELS, _vessels(done))
    scale = done.history[done.best].scale
    return {
        "met": done.met,
        "rounds": len(done.history),
        "best_round": done.best + 1,
        "worst_percent_of_inlet_before": _PERCENT * done.history[0].worst,
        "worst_percent_of_inlet": _PERCENT * done.history[done.best].worst,
        "worst_vessel": done.history[done.best].vessel,
        "radius_scale_least": float(scale.min()),
        "radius_scale_most": float(scale.max()),
        "vessels_at_a_bound": list(done.bounded),
    }


def reduced_summary(
    network: VesselNetwork, conditions: FlowConditions, solution: ThreeDSolution
) -> dict[str, Any]:
    """How far 0D is from 3D, with the network's radii and with those that 3D behaves as.

    Raises
    ------
    FlowError
        As `effective_network`.
    """
    effective = effective_network(network, conditions, solution)
    ratio = effective.resistance / effective.nominal
    summary: dict[str, Any] = {
        "resistance_over_nominal_least": float(ratio.min()),
        "resistance_over_nominal_most": float(ratio.max()),
    }
    for name, each in (("nominal", network), ("effective", effective.network)):
        off = flow_error(each, conditions, effective)
        summary[f"{name}_flow_off_percent_of_inlet"] = _PERCENT * off.flow
        summary[f"{name}_pressure_off_percent_of_drop"] = _PERCENT * off.pressure
    return summary


def _history(done: MatchedNetwork) -> dict[str, Any]:
    rounds = done.history
    return {
        "round": np.arange(1, len(rounds) + 1),
        "worst_percent_of_inlet": np.array([_PERCENT * each.worst for each in rounds]),
        "worst_vessel": np.array([each.vessel for each in rounds]),
        "radius_scale_least": np.array([each.scale.min() for each in rounds]),
        "radius_scale_most": np.array([each.scale.max() for each in rounds]),
        "pressure_drop_mmhg": np.array([each.pressure_drop_pa / PA_PER_MMHG for each in rounds]),
        "elements": np.array([each.elements for each in rounds]),
    }


def _vessels(done: MatchedNetwork) -> dict[str, Any]:
    """A row a vessel; a flow that isn't asked for is NaN."""
    count = done.network.vessel_count
    wanted = np.full(count, np.nan)
    wanted[done.target.vessel] = done.target.flow
    effective = done.effective
    return {
        "vessel": np.arange(count),
        "wanted_ml_min": wanted / UL_S_PER_ML_MIN,
        "flow_ml_min": effective.flow / UL_S_PER_ML_MIN,
        "radius_scale": done.history[done.best].scale,
        "mean_radius_mm": done.network.mean_radius(),
        "resistance_over_nominal": effective.resistance / effective.nominal,
    }


def options_from(
    percent: float, least_lumen_mm: float, edge_ratio: float, fillet_ratio: float, inertia: bool
) -> MatchOptions:
    """Options in a user's words: lumens are told by their diameter.

    Raises
    ------
    FlowError
        As `MatchOptions` and `MeshOptions`.
    """
    options = MatchOptions(tolerance=percent / _PERCENT, least_radius_mm=0.5 * least_lumen_mm)
    return replace(
        options,
        mesh=replace(options.mesh, edge_ratio=edge_ratio, fillet_ratio=fillet_ratio),
        flow=replace(options.flow, convection=inertia),
    )
