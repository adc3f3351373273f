"""Time-step a network's 1D flow from an initial state, by a third-order Runge-Kutta method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import (
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    outlets_by_node,
)
from design.hemodynamics.one_d.grid import KIND, Grid, Nodes, end_impedance
from design.hemodynamics.one_d.kernels import (
    MarchScratch,
    State,
    cell_rates,
    gather_ends,
    smooth_viscously,
    solve_ends,
)
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.pulsatile import PulsatileSolution, cycle_extremes, solve_pulsatile
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@jit
def settle_ends(
    grid: Grid,
    nodes: Nodes,
    state: State,
    drive: FloatArray,
    work: MarchScratch,
    share: float = 0.0,
) -> int:
    """Solve for vessels' ends at a state, into ``work.ends`` and ``work.pressure``.

    ``share`` is the part of a step since a viscous wall acted.
    """
    bad = gather_ends(grid, state, work, share)
    return bad if bad >= 0 else solve_ends(grid, nodes, state, drive, work)


@jit
def advance(
    grid: Grid, nodes: Nodes, state: State, drives: FloatArray, step: float, work: MarchScratch
) -> int:
    """March through steps in place.

    Parameters
    ----------
    drives : (2 steps + 1, w) float64
        Waves at every half step.
    step : float, s

    Returns
    -------
    int
        -1, or the first vessel that flow runs through faster than waves, or that collapses.
    """
    count = (len(drives) - 1) // 2
    for number in range(count):
        work.area[:] = state.area
        work.flow[:] = state.flow
        work.stored[:] = state.stored
        work.mean_flow[:] = 0.0
        for stage in range(3):
            at = 2 * number + (0 if stage == 0 else 2 if stage == 1 else 1)
            share = 0.5 * (at - 2 * number)
            bad = settle_ends(grid, nodes, state, drives[at], work, share)
            if bad >= 0:
                return bad
            cell_rates(grid, state, work)
            old = 0.0 if stage == 0 else 0.75 if stage == 1 else 1.0 / 3.0
            bad = _mix(grid, nodes, state, step, work, old)
            if bad >= 0:
                return bad
            weight = 2.0 / 3.0 if stage == 2 else 1.0 / 6.0
            work.mean_flow[:] += weight * work.ends[1]
            if stage == 1:
                work.late_flow[:] = work.ends[1]
        _pass(nodes, state, step, work)
        if grid.viscous:
            smooth_viscously(grid, state, work, step)
    return -1


@jit
def _mix(
    grid: Grid, nodes: Nodes, state: State, step: float, work: MarchScratch, old: float
) -> int:
    """``old`` of the step's begin and the rest of an Euler step."""
    new = 1.0 - old
    for i in range(len(state.area)):
        # From the step's begin: what is added is small, and so is its rounding.
        area, flow = work.area[i], work.flow[i]
        state.area[i] = area + new * ((state.area[i] - area) + step * work.area_rate[i])
        state.flow[i] = flow + new * ((state.flow[i] - flow) + step * work.flow_rate[i])
    for i in range(len(state.area)):
        if not state.area[i] > 0.0:
            bad = 0
            while grid.offset[bad + 1] <= i:
                bad += 1
            return bad
    for node in range(len(nodes.kind)):
        if nodes.kind[node] == KIND.resistance and nodes.capacitance[node] > 0.0:
            here = state.stored[node]
            rate = -(here - nodes.back[node]) / nodes.distal[node]
            for k in range(nodes.start[node], nodes.start[node + 1]):
                rate += work.ends[1, nodes.end[k]]
            here += step * rate / nodes.capacitance[node]
            state.stored[node] = old * work.stored[node] + new * here
    return -1


@jit
def _pass(nodes: Nodes, state: State, step: float, work: MarchScratch) -> None:
    """Add up what leaves at each node, as the step's stages weigh it."""
    for node in range(len(nodes.kind)):
        for k in range(nodes.start[node], nodes.start[node + 1]):
            state.passed[node] += step * work.mean_flow[nodes.end[k]]


@jit
def all_pressures(grid: Grid, state: State, work: MarchScratch, pressure: FloatArray) -> None:
    """Write the pressure of every cell with the one outside and what a viscous wall adds.

    After `settle_ends`.
    """
    for vessel in range(len(grid.cell)):
        for i in range(grid.offset[vessel], grid.offset[vessel + 1]):
            pressure[i] = work.pressure[i] + grid.external[vessel]
    if not grid.viscous:
        return
    for vessel in range(len(grid.cell)):
        first, last = grid.offset[vessel], grid.offset[vessel + 1] - 1
        for i in range(first, last + 1):
            low, high = -work.ends[1, 2 * vessel], work.ends[1, 2 * vessel + 1]
            if i > first:
                low = 0.5 * (state.flow[i - 1] + state.flow[i])
            if i < last:
                high = 0.5 * (state.flow[i] + state.flow[i + 1])
            damped = grid.drag[i] / np.sqrt(state.area[i])
            pressure[i] -= damped * (high - low) / grid.cell[vessel]


class LumpedForecast(NamedTuple):
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
    reflection: Mapping[int, float],
    samples: int,
) -> PulsatileSolution:
    """Return the periodic state of the lumped model under the same conditions.

    A reflection Γ becomes the resistance Z (1 + Γ)/(1 - Γ) that has it, at most a million times
    the vessel's impedance Z, which stands for a closed end.
    """
    if reflection:
        outlets = outlets_by_node(conditions.outlet, boundary_nodes(network, conditions)[1])
        impedance = end_impedance(grid)
        for node, part in reflection.items():
            given = outlets[node]
            if part > -1.0 and isinstance(given, PressureOutlet):
                at = np.flatnonzero(network.vessel_nodes.ravel() == node)[0]
                over = min((1.0 + part) / max(1.0 - part, 1e-300), 1e6)
                times = np.linspace(0.0, 1.0, 64, endpoint=False)
                rest = float(np.mean(given.waveform.at(times)))
                outlets[node] = ResistanceOutlet(float(impedance[at]) * over, rest)
        conditions = replace(conditions, outlet=outlets)
    return solve_pulsatile(network, replace(conditions, profile="poiseuille"), samples)


def lumped_extremes(network: VesselNetwork, lumped: PulsatileSolution) -> LumpedForecast:
    """Return the extremes of each vessel in the lumped model."""
    low, high = cycle_extremes(lumped, lumped.pressure)
    ends = network.vessel_nodes
    flows = [
        np.abs(x) for q in (lumped.flow_in, lumped.flow_out) for x in cycle_extremes(lumped, q)
    ]
    return LumpedForecast(
        low[ends].min(axis=1), high[ends].max(axis=1), np.max(flows, axis=0, initial=0.0)
    )


def with_small_changes(grid: Grid, forecast: LumpedForecast, part: float = 0.3) -> Grid:
    """Return the grid that doesn't limit changes from cell to cell below ``part`` of the swing.

    So crests keep their height.
    """
    swings = part * np.maximum(forecast.high - forecast.low, 1e-300)
    flows = part * np.maximum(forecast.flow, 1e-300)
    return grid._replace(small_pressure=swings**2, small_flow=flows**2)


def first_state(
    network: VesselNetwork, grid: Grid, nodes: Nodes, slot: IntArray, lumped: PulsatileSolution
) -> State:
    """Return pressure and flow in straight lines between the lumped model's at vessels' ends.

    Raises `FlowError` where the pressure would close a vessel.
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
    windkessel = (nodes.kind == KIND.resistance) & (nodes.capacitance > 0.0)
    node_pressure = np.zeros(len(stored))
    node_pressure[slot] = pressure
    stored[windkessel] = (node_pressure - nodes.proximal * leaving)[windkessel]
    return State(
        grid.area * width**2,
        inflow[vessel] * (1.0 - share) + outflow[vessel] * share,
        stored,
        np.zeros(len(stored)),
    )
