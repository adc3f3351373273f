"""Solve steady, pulsatile and 1D flow as a recipe asks; write their tables."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.hemodynamics import (
    FlowConditions,
    FlowSolution,
    OneDOptions,
    PulsatileConditions,
    ShearBand,
    band_summary,
    end_waves,
    flow_summary,
    flow_table,
    one_d_summary,
    one_d_table,
    one_d_waves,
    pulsatile_summary,
    pulsatile_table,
    question_pressure,
    solve_flow,
    solve_one_d,
    solve_pulsatile,
)
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.steady import node_inflow
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray, IntArray
from printctl.analysis.flow.outlets import pulsatile_conditions, steady_conditions
from printctl.analysis.flow.tables import FlowTables
from printctl.recipe.parts import FlowPart, OneDPart

TABLE: Final = "flow.csv"


def shear_band(part: FlowPart) -> ShearBand | None:
    """The band of wall shear that the section asks for."""
    band = part.shear_band_dyn_cm2
    return None if band is None else ShearBand(*(value / DYN_CM2_PER_PA for value in band))


def solve_steady(
    tables: FlowTables, network: VesselNetwork, conditions: FlowConditions, part: FlowPart
) -> tuple[FlowSolution, dict[str, Any]]:
    """Solve, write `TABLE`, and return the solution and its summary.

    Raises
    ------
    FlowError
        As `solve_flow`, or for an absurd pressure.
    OSError
        When the file can't be written.
    """
    solution = solve_flow(network, conditions)
    summary: dict[str, Any] = flow_summary(network, solution, conditions)
    question_pressure(summary["pressure_drop_pa"])
    band = shear_band(part)
    if band is not None:
        summary["shear_band"] = band_summary(network, solution, band)
    tables.put(TABLE, flow_table(network, solution, conditions.density, band))
    return solution, summary


PULSES, WAVES = "flow_pulsatile.csv", "flow_waves.csv"


def solve_and_write(
    tables: FlowTables, network: VesselNetwork, conditions: PulsatileConditions, steps: int
) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Find the periodic state, write `PULSES` and `WAVES`; return the summary and the waves.

    Raises
    ------
    FlowError
        As `solve_pulsatile`, or for an absurd pressure.
    OSError
        When a file can't be written.
    """
    solution = solve_pulsatile(network, conditions, steps)
    summary = pulsatile_summary(network, solution, conditions)
    question_pressure(summary["pressure_max_mmhg"] * PA_PER_MMHG)
    tables.put(PULSES, pulsatile_table(network, solution, conditions))
    waves = end_waves(network, solution, conditions, steps)
    tables.put(WAVES, waves)
    return summary, waves


def read_waves(path: Path) -> dict[str, FloatArray]:
    """Columns of `WAVES`."""
    with path.open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


ONE_D, ONE_D_WAVES = "flow_1d.csv", "flow_1d_waves.csv"


def one_d_options(part: OneDPart, samples: int) -> OneDOptions:
    """A recipe's words as options."""
    return OneDOptions(
        cell_mm=part.cell_mm,
        wall_viscosity_pa_s=part.wall_viscosity_pa_s,
        profile_exponent=part.profile_exponent,
        most_cycles=part.most_cycles,
        samples=samples,
    )


def solve_and_write_one_d(
    tables: FlowTables,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    options: OneDOptions,
    progress: Callable[[int, float], None] | None = None,
) -> dict[str, Any]:
    """Find the periodic state, write `ONE_D` and `ONE_D_WAVES`, return the summary.

    Raises
    ------
    FlowError
        As `solve_one_d`, or for an absurd pressure.
    OSError
        When a file can't be written.
    """
    solution = solve_one_d(network, conditions, options, progress)
    summary = one_d_summary(network, solution, conditions)
    question_pressure(summary["pressure_max_mmhg"] * PA_PER_MMHG)
    tables.put(ONE_D, one_d_table(network, solution, conditions))
    tables.put(ONE_D_WAVES, one_d_waves(network, solution, conditions))
    return summary


_LITTLE: Final = 1e-6
"""Of what enters, below which flow at an end counts as none."""
_SHOWN: Final = 5


def direction_notes(network: VesselNetwork, conditions: FlowConditions) -> list[str]:
    """Return a note on ends at which vessels meet: one drawn backwards makes such ends.

    None where the conditions name the ends.
    """
    if conditions.inlets or conditions.outlets:
        return []
    degree = network.degree()
    ends = [
        (node, what)
        for what, nodes in (("inlet", network.inlets()), ("outlet", network.outlets()))
        for node in nodes[degree[nodes] > 1].tolist()
    ]
    if not ends:
        return []
    shown = []
    for node, what in ends[:_SHOWN]:
        x, y, z = network.nodes[node]
        vessels = np.flatnonzero((network.vessel_nodes == node).any(axis=1)).tolist()
        named = ", ".join(map(str, vessels[:_SHOWN])) + (", ..." if len(vessels) > _SHOWN else "")
        does = "begin" if what == "inlet" else "end"
        shown.append(
            f"node {node} at ({x:.4g}, {y:.4g}, {z:.4g}) mm is an {what}, as vessels {named} all "
            f"{does} there"
        )
    more = f", and {len(ends) - _SHOWN} more" if len(ends) > _SHOWN else ""
    return [
        f"ends where vessels meet, by the vessels' direction alone: {len(ends)} ("
        f"{'; '.join(shown)}{more}); where flow should pass through, turn a vessel round in the "
        "file (swap its ends)"
    ]


def steady_notes(
    network: VesselNetwork, solution: FlowSolution, conditions: FlowConditions
) -> list[str]:
    """What is said of inlets that flow leaves by, and outlets that it enters by."""
    inlets, outlets = boundary_nodes(network, conditions)
    into = node_inflow(network, solution.flow)
    little = _LITTLE * float(np.maximum(into, 0.0).sum())
    leaving, entering = inlets[into[inlets] < -little], outlets[into[outlets] > little]
    if len(inlets) == len(leaving):
        return [
            "the flow goes backwards, in at outlets and out at the inlets: pressure at the outlets "
            "is above that at the inlets; raise --inlet-pressure-mmhg (inlet_pressure_mmhg), or "
            "lower the outlets'"
        ]
    return [
        f"flow {does} {len(nodes)} of {len(ends)} {what} ({_named(nodes)}): the pressure there is "
        f"{than} that in the network; see whether that is meant"
        for does, nodes, ends, what, than in (
            ("leaves by", leaving, inlets, "inlets", "below"),
            ("enters by", entering, outlets, "outlets", "above"),
        )
        if len(nodes)
    ]


def supply_notes(network: VesselNetwork, part: FlowPart, conditions: FlowConditions) -> list[str]:
    """Return a note on veins without artery, whose flow the section doesn't give."""
    notes = []
    for supply in conditions.supplies[len(part.supplies) :]:
        trees = np.unique(network.tree[np.isin(network.vessel_nodes[:, 0], supply.inlets)])
        named = ", ".join(map(str, trees.tolist()))
        notes.append(
            f"no artery joins the veins (tree {named}): they drain what the other inlets bring, "
            f"{supply.flow_ul_s / UL_S_PER_ML_MIN:.4g} mL/min, on a supply of their own; "
            f"flow: {{supplies: [{{trees: [{named}], flow_ml_min: ...}}]}} gives them another flow"
        )
    return notes


def pulse_notes(waves: Mapping[str, FloatArray]) -> list[str]:
    """What is said of a cycle in whose course the inlets' flow turns round; see `end_waves`."""
    flow = waves["inlet_flow_ml_min"]
    back = flow < -_LITTLE * float(np.abs(flow).max())
    if not back.any() or back.all():
        return []
    return [
        f"the flow goes back out of the inlets for {back.mean():.0%} of the cycle, by up to "
        f"{-flow.min():.3g} mL/min; a higher mean or a smaller amplitude keeps it forward"
    ]


def _named(nodes: IntArray) -> str:
    shown = ", ".join(map(str, nodes[:_SHOWN].tolist()))
    return f"node {shown}" + (f" and {len(nodes) - _SHOWN} more" if len(nodes) > _SHOWN else "")


Cycle = Callable[[int, float, float], None]
"""Takes a 1D cycle's number, its change over the swing, and the change that counts as periodic."""


def solve_section(
    tables: FlowTables,
    network: VesselNetwork,
    part: FlowPart,
    cycle: Cycle,
    *,
    steady: FlowConditions | None = None,
    folder: Path = Path(),
    print_scale: float = 1.0,
) -> tuple[FlowSolution, dict[str, Any]]:
    """Return the steady solution, and the summary of all that was solved, with notes if any.

    Parameters
    ----------
    steady : FlowConditions, optional
        In place of the section's own, at the design's size.
    folder : Path
        The section's tables are relative to it.
    print_scale : float
        See `pulsatile_conditions`.

    Raises
    ------
    FlowError, UsageError, OSError
        As `steady_conditions`, `pulsatile_conditions` and the solvers.
    """
    driven = steady or steady_conditions(part, folder, network)
    solution, summary = solve_steady(tables, network, driven, part)
    notes = direction_notes(network, driven) + steady_notes(network, solution, driven)
    notes += supply_notes(network, part, driven)
    if part.pulse is None:
        return solution, summary | _said(notes)
    steps = part.pulse.steps
    conditions = pulsatile_conditions(part, part.pulse, folder, print_scale, network)
    summary["pulsatile"], waves = solve_and_write(tables, network, conditions, steps)
    notes += pulse_notes(waves)
    if part.one_d is not None:
        options = one_d_options(part.one_d, steps)
        summary["one_d"] = solve_and_write_one_d(
            tables,
            network,
            conditions,
            options,
            lambda number, change: cycle(number, change, options.tolerance),
        )
    return solution, summary | _said(notes)


def _said(notes: list[str]) -> dict[str, list[str]]:
    return {"notes": notes} if notes else {}
