"""Compute the 1D solver's initial state and limiter thresholds from a periodic 0D solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.errors import FlowError
from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.one_d.kernels.march import State
from design.hemodynamics.one_d.nodes import RESISTANCE, Nodes, end_impedance, outlet_of
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
)
from design.hemodynamics.zero_d.pulsatile.solution import (
    PulsatileSolution,
    cycle_extremes,
    solve_pulsatile,
)
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

_SMALL = 0.3
"""Of a vessel's swing: changes from cell to cell below it aren't limited, so that crests keep
their height."""

_CLOSED = 1e6
"""Resistance over a vessel's impedance that stands for a closed end in the lumped model."""


@dataclass(frozen=True)
class LumpedForecast:
    """What the lumped model expects of each vessel over a cycle, all (v,).

    Attributes
    ----------
    low, high : float64, Pa
        Pressure at either end.
    flow : float64, µL/s
        Greatest size.
    """

    low: FloatArray
    high: FloatArray
    flow: FloatArray


def lumped_state(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    grid: Grid,
    reflection: dict[int, float],
    samples: int,
) -> PulsatileSolution:
    """The periodic state of the lumped model under the same conditions."""
    outlet = conditions.outlet
    if reflection:
        outlet = _with_resistances(network, conditions, grid, reflection)
    return solve_pulsatile(
        network, replace(conditions, profile="poiseuille", outlet=outlet), samples
    )


def _with_resistances(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    grid: Grid,
    reflection: dict[int, float],
) -> dict[int, Outlet]:
    """Outlets, a reflection Γ made the resistance Z (1 + Γ)/(1 - Γ) that has it."""
    impedance = end_impedance(grid)
    outlets: dict[int, Outlet] = {}
    for node in boundary_nodes(network, conditions)[1].tolist():
        outlet = outlets[node] = outlet_of(conditions.outlet, node)
        part = reflection.get(node, -1.0)
        if part > -1.0 and isinstance(outlet, PressureOutlet):
            at = np.flatnonzero(network.vessel_nodes.ravel() == node)[0]
            over = min((1.0 + part) / max(1.0 - part, 1e-300), _CLOSED)
            rest = float(np.mean(outlet.waveform.at(np.linspace(0.0, 1.0, 64, endpoint=False))))
            outlets[node] = ResistanceOutlet(float(impedance[at]) * over, rest)
    return outlets


def lumped_extremes(network: VesselNetwork, lumped: PulsatileSolution) -> LumpedForecast:
    """Extremes of each vessel in the lumped model."""
    low, high = cycle_extremes(lumped, lumped.pressure)
    ends = network.vessel_nodes
    flows = [
        np.abs(x) for q in (lumped.flow_in, lumped.flow_out) for x in cycle_extremes(lumped, q)
    ]
    return LumpedForecast(
        low[ends].min(axis=1), high[ends].max(axis=1), np.max(flows, axis=0, initial=0.0)
    )


def with_small_changes(grid: Grid, seen: LumpedForecast) -> Grid:
    """The grid, knowing which changes are small."""
    swings = _SMALL * np.maximum(seen.high - seen.low, 1e-300)
    flows = _SMALL * np.maximum(seen.flow, 1e-300)
    return grid._replace(small_pressure=swings**2, small_flow=flows**2)


def first_state(
    network: VesselNetwork, grid: Grid, nodes: Nodes, slot: IntArray, lumped: PulsatileSolution
) -> State:
    """Pressure and flow in straight lines between what the lumped model has at vessels' ends.

    Raises
    ------
    FlowError
        Where the pressure would close a vessel.
    """
    at = np.zeros(1)
    pressure = lumped.at(lumped.pressure, at)[0]
    inflow, outflow = (lumped.at(q, at)[0] for q in (lumped.flow_in, lumped.flow_out))
    vessel, share = grid.vessel_of_cell, grid.middles()
    first, last = pressure[network.vessel_nodes].T
    p = first[vessel] * (1.0 - share) + last[vessel] * share - grid.external[vessel]
    width = 1.0 + p / grid.stiffness
    shut = np.flatnonzero(~(width > 0.0))
    if len(shut):
        raise FlowError(
            f"vessel {int(vessel[shut[0]])} would collapse: {p[shut[0]]:.4g} Pa above the outside, "
            f"in a wall of stiffness {grid.stiffness[shut[0]]:.4g} Pa; raise the outlets' "
            "pressure, stiffen the wall or lower the flow"
        )
    stored = nodes.back.copy()
    leaving = np.bincount(slot[network.vessel_nodes[:, 1]], weights=outflow, minlength=len(stored))
    leaving -= np.bincount(slot[network.vessel_nodes[:, 0]], weights=inflow, minlength=len(stored))
    held = (nodes.kind == RESISTANCE) & (nodes.capacitance > 0.0)
    node_pressure = np.zeros(len(stored))
    node_pressure[slot] = pressure
    stored[held] = (node_pressure - nodes.proximal * leaving)[held]
    return State(
        grid.area * width**2,
        inflow[vessel] * (1.0 - share) + outflow[vessel] * share,
        stored,
        np.zeros(len(stored)),
    )
