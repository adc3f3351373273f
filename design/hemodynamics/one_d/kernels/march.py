"""Time-step the 1D flow of a network by the third-order Runge-Kutta method of Shu and Osher.

Shu & Osher's (1988, doi 10.1016/0021-9991(88)90177-5): U₁ = U + Δt L(U),
U₂ = ¾U + ¼(U₁ + Δt L(U₁)), U = ⅓U + ⅔(U₂ + Δt L(U₂)); L is asked at t, t + Δt and t + Δt/2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.one_d.kernels.cells import (
    cell_pressures,
    cell_rates,
    smooth_viscously,
)
from design.hemodynamics.one_d.kernels.ends import ROWS, gather_ends, solve_ends
from design.hemodynamics.one_d.nodes import RESISTANCE, Nodes
from kernels import jit
from kernels.arrays import FloatArray


class State(NamedTuple):
    """Cross-sections and flows of all cells, and the outlets' state, at one time.

    Attributes
    ----------
    area, flow : (n,) float64, mm², µL/s
        Of cells.
    stored : (m,) float64, Pa
        Behind each outlet's first resistance.
    passed : (m,) float64, µL
        What has left the network at each node.
    """

    area: FloatArray
    flow: FloatArray
    stored: FloatArray
    passed: FloatArray


class MarchScratch(NamedTuple):
    """Scratch: one set a network, so that a step allocates nothing."""

    pressure: FloatArray
    area_rate: FloatArray
    flow_rate: FloatArray
    area: FloatArray
    flow: FloatArray
    stored: FloatArray
    ends: FloatArray
    mean_flow: FloatArray
    late_flow: FloatArray
    smoothed: FloatArray
    lines: FloatArray


def make_work(grid: Grid, nodes: Nodes) -> MarchScratch:
    """Scratch for a network."""
    cells, ends = len(grid.area), 2 * len(grid.cell)
    return MarchScratch(
        pressure=np.zeros(cells),
        area_rate=np.zeros(cells),
        flow_rate=np.zeros(cells),
        area=np.zeros(cells),
        flow=np.zeros(cells),
        stored=np.zeros(len(nodes.kind)),
        ends=np.zeros((ROWS, ends)),
        mean_flow=np.zeros(ends),
        late_flow=np.zeros(ends),
        smoothed=np.zeros(ends),
        lines=np.zeros((2, cells)),
    )


@jit
def settle_ends(
    grid: Grid,
    nodes: Nodes,
    state: State,
    drive: FloatArray,
    work: MarchScratch,
    share: float = 0.0,
) -> int:
    """Find what vessels' ends are at a state; ``work.ends`` and ``work.pressure`` hold it.

    ``share`` of a step has gone by since a viscous wall was heard.
    """
    cell_pressures(grid, state.area, work.pressure)
    bad = gather_ends(grid, state.area, work.pressure, state.flow, work.smoothed, share, work.ends)
    if bad >= 0:
        return bad
    return solve_ends(nodes, state.stored, drive, grid.density, work.ends)


@jit
def advance(
    grid: Grid,
    nodes: Nodes,
    state: State,
    drives: FloatArray,
    step: float,
    work: MarchScratch,
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
            cell_rates(grid, state.area, state.flow, work.pressure, work.ends[0], work.ends[1],
                       work.area_rate, work.flow_rate)  # fmt: skip
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
            smooth_viscously(
                grid, state.area, state.flow, work.late_flow, step, work.smoothed, work.lines
            )
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
        if nodes.kind[node] == RESISTANCE and nodes.capacitance[node] > 0.0:
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
    """Pressure of every cell with the one outside and what a viscous wall adds.

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
