"""Carry a solute along vessels in steady flow, and exchange it with the tissue grid."""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import numpy as np
from scipy.special import i0e

from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.hemodynamics.zero_d.steady import FlowSolution, node_inflow
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class Coupling(NamedTuple):
    """How vessels are cut up and read on the grid."""

    still: float = 1e-9
    """Share of the largest flow below which a vessel carries nothing."""
    rings: int = 2
    """Rings of source points in an element of one cell's length."""
    thin: float = 0.25
    """Lumens of a smaller radius, in cells, have one point instead of a ring."""
    smoothing: float = 0.6234
    """Deviation, in cells and along each axis, of the Gaussian that answers as the grid does: laid
    on 27 cells by quadratic B-splines, spread by the five-point star in the plane across the
    vessel, and read by the B-splines. From Green's functions of a 192 × 192 lattice for 40 places
    in a cell: a thin line answers at its own place as the exact solution does 0.661 ± 0.027 cells
    away from it."""


COUPLING: Final = Coupling()
Pieces = tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]
"""Of `VesselNetwork.pieces`."""
Rings = tuple[FloatArray, FloatArray, FloatArray]
"""Middles (n, 3), axes (n, 3) and radii (n,)."""


class Transport(NamedTuple):
    """Vessels in flow order with their flows, as `sweep` needs them.

    Attributes
    ----------
    order : (m,) int64
        Vessels that flow, by falling pressure where they begin: all that enters a node is known
        before anything leaves it, loops or not.
    begin, end : (v,) int64
        Nodes that each vessel's flow runs from and to.
    forward : (v,) bool
    flow : (v,) float64, µL/s
        Its size.
    supplied : (nodes,) float64, µL/s
        Flow that comes in from outside at each node.
    through : (nodes,) float64, µL/s
        All that enters each node, from outside or by vessels.
    offset : (v + 1,) int64
        Elements of each vessel.
    """

    order: IntArray
    begin: IntArray
    end: IntArray
    forward: np.ndarray
    flow: FloatArray
    supplied: FloatArray
    through: FloatArray
    offset: IntArray


def transport_of(network: VesselNetwork, flow: FlowSolution, elements: Elements) -> Transport:
    """Order a network's vessels for sweeps."""
    size = np.abs(flow.flow)
    moves = size > COUPLING.still * size.max()
    forward = flow.flow >= 0.0
    first, last = network.vessel_nodes.T
    begin, end = np.where(forward, first, last), np.where(forward, last, first)
    order = np.argsort(-flow.pressure[begin], kind="stable")
    inflow = node_inflow(network, flow.flow)
    entering = np.bincount(end, weights=np.where(moves, size, 0.0), minlength=len(inflow))
    leaving = np.bincount(begin, weights=np.where(moves, size, 0.0), minlength=len(inflow))
    # At an inner node the rounding of a sum isn't a supply.
    supplied = np.where(inflow > COUPLING.still * (entering + leaving), inflow, 0.0)
    return Transport(
        order=order[moves[order]],
        begin=begin,
        end=end,
        forward=forward,
        flow=size,
        supplied=supplied,
        through=supplied + entering,
        offset=elements.offset,
    )


@jit
def sweep(
    transport: Transport, conductance: FloatArray, outside: FloatArray, inlet: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Carry a solute down the network.

    Along an element Q dc/ds = -(G/ℓ)(c - c_outside), so c comes out as
    c_outside + (c_in - c_outside) exp(-G/Q): never below both, whatever G and Q.

    Parameters
    ----------
    conductance : (n,) float64, µL/s
        G of each element.
    outside : (n,) float64, mM
        What stands around it.
    inlet : float, mM
        In what is supplied.

    Returns
    -------
    flux : (n,) float64, nmol/s
        From each element to what is around it.
    entry, exit : (v,) float64, mM
        At the ends of each vessel, in the flow's direction; NaN where nothing flows.
    """
    flux = np.zeros(len(conductance))
    entry, leaves = np.full(len(transport.flow), np.nan), np.full(len(transport.flow), np.nan)
    arrived = transport.supplied * inlet
    for vessel in transport.order:
        node, flow = transport.begin[vessel], transport.flow[vessel]
        here = arrived[node] / transport.through[node] if transport.through[node] > 0.0 else 0.0
        entry[vessel] = here
        low, high = transport.offset[vessel], transport.offset[vessel + 1]
        for k in range(high - low):
            e = low + k if transport.forward[vessel] else high - 1 - k
            flux[e] = -flow * np.expm1(-conductance[e] / flow)
            flux[e] *= here - outside[e]
            here -= flux[e] / flow
        leaves[vessel] = here
        arrived[transport.end[vessel]] += flow * here
    return flux, entry, leaves


class Elements(NamedTuple):
    """Pieces of vessels, about a cell long, vessel by vessel.

    Attributes
    ----------
    vessel : (n,) int64
    offset : (v + 1,) int64
        Elements of vessel ``i`` are ``offset[i]:offset[i + 1]``, from its first node on.
    length, radius : (n,) float64, mm
    start : (n + 1,) int64
        Cells of element ``e`` are ``start[e]:start[e + 1]`` of the arrays below.
    cell : (k,) int64
        Flat index into the grid.
    weight : (k,) float64
        Sum to 1 for an element in the tissue; one more than half outside has none.
    """

    vessel: IntArray
    offset: IntArray
    length: FloatArray
    radius: FloatArray
    start: IntArray
    cell: IntArray
    weight: FloatArray


def cut_vessels(network: VesselNetwork, grid: TissueGrid) -> Elements:
    """Cut each vessel into equal parts no longer than a cell, and find the cells of each."""
    lengths, h = network.lengths(), grid.spacing_mm
    count = np.maximum(np.ceil(lengths / h - 1e-9).astype(np.int64), 1)
    vessel = np.repeat(np.arange(network.vessel_count), count)
    offset = np.concatenate([[0], np.cumsum(count)])
    number = np.arange(len(vessel)) - offset[vessel]
    rings = COUPLING.rings
    part = (number[:, None] + (np.arange(rings) + 0.5) / rings) / count[vessel][:, None]
    at, axis, radius = _along(network, np.repeat(vessel, rings), part.ravel())
    mean = radius.reshape(-1, rings).mean(axis=1)
    points = np.where(
        mean < COUPLING.thin * h, 1, np.maximum(np.ceil(2.0 * np.pi * mean / (0.75 * h)), 4)
    ).astype(np.int64)
    start = 27 * rings * np.concatenate([[0], np.cumsum(points)])
    length, cell = lengths[vessel] / count[vessel], np.zeros(start[-1], dtype=np.int64)
    elements = Elements(vessel, offset, length, mean, start, cell, np.zeros(start[-1]))
    _spread(elements, (at, axis, radius), points, grid)
    return elements


@jit
def gather(elements: Elements, field: FloatArray) -> FloatArray:
    """Weighted mean of a flat field around each element, (n,)."""
    start, mean = elements.start, np.zeros(len(elements.start) - 1)
    for e in range(len(mean)):
        total = 0.0
        for k in range(start[e], start[e + 1]):
            total += elements.weight[k] * field[elements.cell[k]]
        mean[e] = total
    return mean


@jit
def scatter(elements: Elements, value: FloatArray, field: FloatArray) -> None:
    """Add each element's value to a flat field by its weights."""
    for e in range(len(value)):
        for k in range(elements.start[e], elements.start[e + 1]):
            field[elements.cell[k]] += elements.weight[k] * value[e]


def _along(
    network: VesselNetwork, vessel: IntArray, part: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place (n, 3), unit direction (n, 3) and radius (n,) at a share of each vessel's length."""
    step = np.linalg.norm(np.diff(network.points, axis=0), axis=1)
    step[network.offset[1:-1] - 1] = 0.0
    arc = np.concatenate([[0.0], np.cumsum(step)])
    first, last = network.offset[vessel], network.offset[vessel + 1] - 1
    target = arc[first] + part * (arc[last] - arc[first])
    k = np.clip(np.searchsorted(arc, target, side="right") - 1, first, last - 1)
    wide = np.maximum(arc[k + 1] - arc[k], 1e-300)
    share = np.clip((target - arc[k]) / wide, 0.0, 1.0)
    a, b = network.points[k], network.points[k + 1]
    radius = network.radius[k] + share * (network.radius[k + 1] - network.radius[k])
    return a + share[:, None] * (b - a), (b - a) / wide[:, None], radius


@jit
def _turn_across(axis: FloatArray, across: FloatArray, other: FloatArray) -> None:
    """Write two unit vectors across a unit axis, (3,) each."""
    least = np.argmin(np.abs(axis))
    across[:] = -axis[least] * axis
    across[least] += 1.0
    across /= np.sqrt((across**2).sum())
    other[0] = axis[1] * across[2] - axis[2] * across[1]
    other[1] = axis[2] * across[0] - axis[0] * across[2]
    other[2] = axis[0] * across[1] - axis[1] * across[0]


@jit
def _spread(elements: Elements, rings: Rings, points: IntArray, grid: TissueGrid) -> None:
    """Lay each element's ring points on 27 cells each by quadratic B-splines.

    What falls on cells outside the tissue is shared out among those inside: nothing passes the
    surface.
    """
    at, axis, radius = rings
    origin, h, inside = grid.origin_mm, grid.spacing_mm, grid.inside
    nx, ny, nz = inside.shape
    start, cell, weight = elements.start, elements.cell, elements.weight
    low, across, other, where = np.empty(3, np.int64), np.empty(3), np.empty(3), np.empty(3)
    spline = np.empty((3, 3))
    for e in range(len(points)):
        k, total = start[e], 0.0
        for ring in range(COUPLING.rings):
            i = e * COUPLING.rings + ring
            _turn_across(axis[i], across, other)
            for p in range(points[e]):
                # The two rings are turned against each other by half a step.
                angle = 2.0 * np.pi * (p + 0.5 * ring) / points[e]
                out = radius[i] if points[e] > 1 else 0.0
                where[:] = at[i] + out * (np.cos(angle) * across + np.sin(angle) * other)
                for d in range(3):
                    x = (where[d] - origin[d]) / h
                    middle = np.floor(x + 0.5)
                    low[d] = np.int64(middle) - 1
                    f = x - middle
                    spline[d, 0] = 0.5 * (0.5 - f) ** 2
                    spline[d, 1] = 0.75 - f * f
                    spline[d, 2] = 0.5 * (0.5 + f) ** 2
                for a in range(3):
                    for b in range(3):
                        for c in range(3):
                            x0, y0, z0 = low[0] + a, low[1] + b, low[2] + c
                            within = 0 <= x0 < nx and 0 <= y0 < ny and 0 <= z0 < nz
                            if within and inside[x0, y0, z0]:
                                cell[k] = (x0 * ny + y0) * nz + z0
                                weight[k] = spline[0, a] * spline[1, b] * spline[2, c]
                                total += weight[k]
                            k += 1
        share = total / (COUPLING.rings * points[e])
        scale = 1.0 / total if share > 0.5 else 0.0
        for k in range(start[e], start[e + 1]):
            weight[k] *= scale


def lumen_share(network: VesselNetwork, grid: TissueGrid) -> FloatArray:
    """Share of each cell that is lumen, (nx, ny, nz), 0 to 1; no uptake there."""
    filled = np.zeros(grid.inside.shape)
    _fill(network.pieces(), grid, filled)
    return np.minimum(filled, 1.0, out=filled)


@jit
def _fill(pieces: Pieces, grid: TissueGrid, filled: FloatArray) -> None:
    """Add the volume of each piece, in points a third of a cell apart, to the cells they lie in."""
    start, end, r0, r1, _ = pieces
    origin, h = grid.origin_mm, grid.spacing_mm
    nx, ny, nz = filled.shape
    across, other = np.empty(3), np.empty(3)
    for i in range(len(start)):
        axis = end[i] - start[i]
        length = np.sqrt((axis**2).sum())
        if length == 0.0:
            continue
        axis = axis / length
        _turn_across(axis, across, other)
        steps = int(np.ceil(3.0 * length / h))
        for s in range(steps):
            t = (s + 0.5) / steps
            radius = r0[i] + t * (r1[i] - r0[i])
            rings = max(1, int(np.ceil(3.0 * radius / h)))
            for ring in range(rings):
                out = radius * (ring + 0.5) / rings
                if rings == 1:
                    out = 0.0 if radius < 0.25 * h else 0.5 * radius
                points = max(4, int(np.ceil(6.0 * np.pi * out / h)))
                area = np.pi * radius**2 * (2.0 * ring + 1.0) / rings**2
                for p in range(points):
                    angle = 2.0 * np.pi * (p + 0.5 * (s % 2)) / points
                    ca, sa = np.cos(angle), np.sin(angle)
                    x = start[i] + t * length * axis + out * (ca * across + sa * other)
                    a = int(np.floor((x[0] - origin[0]) / h + 0.5))
                    b = int(np.floor((x[1] - origin[1]) / h + 0.5))
                    c = int(np.floor((x[2] - origin[2]) / h + 0.5))
                    if 0 <= a < nx and 0 <= b < ny and 0 <= c < nz:
                        filled[a, b, c] += area * length / (steps * points * h**3)


# A vessel thinner than a cell is no boundary that the grid sees. Its flux is laid on the grid as a
# smooth source and what the grid then says at the vessel is read with the same weights, so that the
# coupling is symmetric; Green's function of a line gives what lies between that mean and the
# concentration at the wall. It is Peaceman's well model (1978, doi 10.2118/6893-PA) with the source
# spread on purpose, as by Koch et al. 2020 (doi 10.1016/j.jcp.2020.109370), so that it doesn't
# depend on where in a cell, or in which direction, a vessel runs.
_LOW, _HIGH = 1e-5, 1e8


def subgrid(radius: FloatArray, spacing_mm: float) -> FloatArray:
    """ln(r_e/r): 2π D (that at the wall less the mean read on the grid) per flux and length, (n,).

    The source is a ring of radius r blurred by a Gaussian of deviation s per axis. The mean
    of the blurred potential over the ring grows with the variance as the blurred ring's density
    there, so that ln(r_e/r) = ½ ∫ exp(-x) I₀(x)/x dx from (r/s)² on. For r ≪ s it goes to
    ln(√2 s/r) - γ/2, for r ≫ s to 0.
    """
    x, value = _table()
    log_ratio = np.log((np.asarray(radius) / (COUPLING.smoothing * spacing_mm)) ** 2)
    thin = 0.5 * (np.log(2.0) - np.euler_gamma - log_ratio)
    return np.where(log_ratio < x[0], thin, np.interp(log_ratio, x, value))


@cache
def _table() -> tuple[FloatArray, FloatArray]:
    """The integral over ln x, from the top down; above it exp(-x) I₀(x) is 1/√(2π x)."""
    x = np.linspace(np.log(_LOW), np.log(_HIGH), 20_001)
    density = 0.5 * i0e(np.exp(x))
    steps = 0.5 * (density[1:] + density[:-1]) * (x[1] - x[0])
    above = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    return x, above + 1.0 / np.sqrt(2.0 * np.pi * _HIGH)


def exchange(
    radius: FloatArray, length: FloatArray, spacing_mm: float, conditions: OxygenConditions
) -> FloatArray:
    """Flux between stream and grid per difference of concentration, (n,), µL/s.

    Two resistances in series per length: 1/(π D Sh) in the stream (Hellums et al. 1996,
    Ann Biomed Eng 24, 1) and ln(r_e/r)/(2π D) between the wall and what the grid resolves.
    """
    stream = 1.0 / (np.pi * conditions.medium_diffusivity_mm2_s * conditions.sherwood)
    tissue = subgrid(radius, spacing_mm) / (2.0 * np.pi * conditions.tissue_diffusivity_mm2_s)
    return np.asarray(length / (stream + tissue))
