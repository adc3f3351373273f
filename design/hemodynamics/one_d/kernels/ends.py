"""Solve for area, flow and pressure at vessel ends in 1D flow: junctions, inlets, outlets.

A vessel's end brings its outgoing invariant W = u + 4c (u towards the node); what its area and
flow become there has the same. In terms of c everything is a polynomial: p = 2ϱc² - K,
u = W - 4c, A = A₀ (2ϱc²/K)². The invariant is that of α = 1 (Formaggia et al. 2003); it is used
only over the small step from the cell's value at the end to the node's, so that the scheme stays
of second order for other profiles.

All ends of a node share P: at a junction the total pressure p + ½ϱu², at an inlet or outlet the
pressure; p has the pressure outside the vessel in it. Newton's method on (c of each end, P) has an
arrow for its matrix: with Y = -dQ/dH, each end's admittance, P = (Σ(Q + Y H) - g₀)/(ΣY + g₁),
where g₀ + g₁ P is what leaves the node outwards, and then c += (P - H)/H'. No number of vessels is
special, and loops need nothing.

In a viscous wall the end's pressure has -γ Q_x besides, over half a cell: a resistance in series.

Helpers take numbers, not the grid: a tuple of arrays handed to a call counts references, which
took ten times as long as the sums.
"""

from __future__ import annotations

import numpy as np

from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.one_d.nodes import JUNCTION, PRESSURE, REFLECTION, Nodes
from kernels import jit
from kernels.arrays import FloatArray

ROWS = 14
"""Of `ends`: see `solve_ends`."""

_ROUNDS = 50
_CLOSE = 1e-9
"""Of the wall's stiffness; the step taken after it leaves rounding."""


@jit
def gather_ends(
    grid: Grid,
    area: FloatArray,
    pressure: FloatArray,
    flow: FloatArray,
    smoothed: FloatArray,
    share: float,
    ends: FloatArray,
) -> int:
    """Carry cells' pressure and flow to the ends of vessels in straight lines, and begin there.

    Parameters
    ----------
    area, pressure, flow : (n,) float64
        Of cells.
    smoothed : (2 v,) float64
        What a viscous wall did to the last cells' outward flow in the step before.
    share : float
        Of a step that has gone by without it: within a step the wall's viscosity hasn't acted
        yet, and the difference to the node's flow, which is of the size of a step, would be
        wrong by as much.
    ends : (14, 2 v) float64

    Returns
    -------
    int
        -1, or the first vessel that collapses or is outrun.
    """
    density, per_density = grid.density, 1.0 / grid.density
    for vessel in range(len(grid.cell)):
        for side in range(2):
            if side == 0:
                i, back, sign, face = grid.offset[vessel], 1, -1.0, grid.offset[vessel] + vessel
            else:
                i, back, sign = grid.offset[vessel + 1] - 1, -1, 1.0
                face = grid.offset[vessel + 1] + vessel
            end = 2 * vessel + side
            stiff, base = grid.face_stiffness[face], grid.face_area[face]
            p = 1.5 * pressure[i] - 0.5 * pressure[i + back]
            q = sign * (1.5 * flow[i] - 0.5 * flow[i + back])
            y = 1.0 + p / stiff
            if not y > 0.0:
                return vessel
            c = np.sqrt(0.5 * stiff * y * per_density)
            u = q / (base * y * y)
            if not abs(u) < c:
                return vessel
            ends[3, end], ends[4, end] = c, u + 4.0 * c
            ends[5, end], ends[6, end] = stiff, base * 4.0 * density * density / (stiff * stiff)
            ends[7, end], ends[8, end] = 0.0, 0.0
            ends[13, end] = stiff - grid.external[vessel]
            if grid.viscous:
                g = grid.face_drag[face] / np.sqrt(area[i])
                ends[7, end], ends[8, end] = 2.0 * g / grid.cell[vessel], sign * flow[i]
                ends[8, end] += share * smoothed[end]
    return -1


@jit
def solve_ends(
    nodes: Nodes, stored: FloatArray, drive: FloatArray, density: float, ends: FloatArray
) -> int:
    """Find area, flow and pressure at every vessel's ends.

    Parameters
    ----------
    nodes : Nodes
    stored : (m,) float64, Pa
        Pressure behind each outlet's first resistance.
    drive : (w,) float64
        Waves at this time.
    density : float
    ends : (14, 2 v) float64
        Written, rows 0 to 2: area, outward flow and pressure at each end. Given by
        `gather_ends`, rows 3 to 8: c (changed), W, K, A/c⁴, resistance in series and the outward
        flow before it; row 13: K less the pressure outside. Scratch, rows 9 to 12: Q, H, H', Y.

    Returns
    -------
    int
        -1, or the first vessel that collapses or is outrun.
    """
    for node in range(len(nodes.kind)):
        kind, wave = nodes.kind[node], nodes.wave[node]
        given = drive[wave] if wave >= 0 else 0.0
        start, stop = nodes.start[node], nodes.start[node + 1]
        if kind == REFLECTION:
            end = nodes.end[start]
            if not _reflect(given, nodes.reflection[node], density, end, ends):
                return end // 2
            continue
        kinetic = 1.0 if kind == JUNCTION else 0.0
        outward, conductance = 0.0, 0.0
        if kind == JUNCTION:
            outward = -given
        elif kind != PRESSURE:
            conductance = 1.0 / nodes.proximal[node]
            outward = -stored[node] * conductance
        shared, total, over = given, 0.0, 0.0
        for _ in range(_ROUNDS):
            worst, total, weighted, over = 0.0, 0.0, 0.0, -outward
            for k in range(start, stop):
                end = nodes.end[k]
                q, head, slope, y = _at(ends[3, end], ends[4, end], ends[13, end], ends[6, end],
                                        ends[7, end], ends[8, end], kinetic, density)  # fmt: skip
                ends[9, end], ends[10, end], ends[11, end], ends[12, end] = q, head, slope, y
                total += y
                over += q
                weighted += y * head
            if kind != PRESSURE:
                shared = (over + weighted) / (total + conductance)
            for k in range(start, stop):
                end = nodes.end[k]
                rest = shared - ends[10, end]
                worst = max(worst, abs(rest) / ends[5, end])
                ends[3, end] += rest / ends[11, end]
                if not ends[3, end] > 0.0:
                    return end // 2
            if worst < _CLOSE:
                break
        bad = _settle(nodes, node, shared, outward + conductance * shared, density, kinetic, ends)
        if bad >= 0:
            return bad
    return -1


@jit
def _at(
    c: float,
    w: float,
    stiff: float,
    scale: float,
    series: float,
    inner: float,
    kinetic: float,
    density: float,
) -> tuple[float, float, float, float]:
    """Flow, pressure, its slope over c, and admittance of an end for its c.

    ``stiff`` is K less the pressure outside.
    """
    u = w - 4.0 * c
    square = c * c
    area = scale * square * square
    q = area * u
    head = 2.0 * density * square - stiff + 0.5 * density * kinetic * u * u
    slope = 4.0 * density * (c - kinetic * u)
    fall = 4.0 * area * (u - c) / c
    head -= series * (q - inner)
    slope -= series * fall
    return q, head, slope, -fall / slope


@jit
def _settle(
    nodes: Nodes,
    node: int,
    shared: float,
    leaving: float,
    density: float,
    kinetic: float,
    ends: FloatArray,
) -> int:
    """Write the node's ends; what Newton's method leaves of the flows' sum is shared out."""
    over, total = -leaving, 0.0
    for k in range(nodes.start[node], nodes.start[node + 1]):
        end = nodes.end[k]
        c = ends[3, end]
        u = ends[4, end] - 4.0 * c
        if not abs(u) < c:
            return end // 2
        area = ends[6, end] * c * c * c * c
        ends[0, end], ends[1, end] = area, area * u
        ends[2, end] = shared - 0.5 * density * kinetic * u * u
        over += area * u
        total += ends[12, end]
    if nodes.kind[node] != PRESSURE:
        for k in range(nodes.start[node], nodes.start[node + 1]):
            end = nodes.end[k]
            ends[1, end] -= over * ends[12, end] / total
    return -1


@jit
def _reflect(given: float, part: float, density: float, end: int, ends: FloatArray) -> bool:
    """Send part of what the arriving wave is over the undisturbed state back."""
    stiff, arriving = ends[5, end], ends[4, end]
    y = (ends[13, end] + given) / stiff
    if not y > 0.0:
        return False
    rest = 4.0 * np.sqrt(0.5 * stiff * y / density)
    back = -rest - part * (arriving - rest)
    c, u = (arriving - back) / 8.0, (arriving + back) / 2.0
    if not (c > 0.0 and abs(u) < c):
        return False
    ends[0, end] = ends[6, end] * c * c * c * c
    ends[1, end] = ends[0, end] * u
    ends[2, end] = 2.0 * density * c * c - ends[13, end]
    return True
