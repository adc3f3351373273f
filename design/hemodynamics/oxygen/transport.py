"""Carry a solute along vessels in steady flow: one sweep in flow direction, wall exchange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.hemodynamics.oxygen.elements import Elements
from design.hemodynamics.zero_d.flow import FlowSolution
from design.hemodynamics.zero_d.steady import node_inflow
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray

STILL: Final = 1e-9
"""Share of the largest flow below which a vessel carries nothing."""


@dataclass(frozen=True)
class Transport:
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
    moves = size > STILL * size.max()
    forward = flow.flow >= 0.0
    first, last = network.vessel_nodes.T
    begin, end = np.where(forward, first, last), np.where(forward, last, first)
    order = np.argsort(-flow.pressure[begin], kind="stable")
    inflow = node_inflow(network, flow.flow)
    entering = np.bincount(end, weights=np.where(moves, size, 0.0), minlength=len(inflow))
    leaving = np.bincount(begin, weights=np.where(moves, size, 0.0), minlength=len(inflow))
    # At an inner node the rounding of a sum isn't a supply.
    supplied = np.where(inflow > STILL * (entering + leaving), inflow, 0.0)
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
    entry, leaves = np.full((2, len(transport.flow)), np.nan)
    _sweep(
        transport.order, transport.begin, transport.end, transport.forward, transport.flow,
        transport.supplied * inlet, transport.through, transport.offset, conductance, outside,
        flux, entry, leaves,
    )  # fmt: skip
    return flux, entry, leaves


@jit
def _sweep(
    order: IntArray,
    begin: IntArray,
    end: IntArray,
    forward: np.ndarray,
    flow: FloatArray,
    arrived: FloatArray,
    through: FloatArray,
    offset: IntArray,
    conductance: FloatArray,
    outside: FloatArray,
    flux: FloatArray,
    entry: FloatArray,
    leaves: FloatArray,
) -> None:
    """``arrived`` (nodes,), nmol/s, grows by what each vessel brings."""
    for vessel in order:
        node = begin[vessel]
        here = arrived[node] / through[node] if through[node] > 0.0 else 0.0
        entry[vessel] = here
        low, high = offset[vessel], offset[vessel + 1]
        for k in range(high - low):
            e = low + k if forward[vessel] else high - 1 - k
            flux[e] = -flow[vessel] * np.expm1(-conductance[e] / flow[vessel])
            flux[e] *= here - outside[e]
            here -= flux[e] / flow[vessel]
        leaves[vessel] = here
        arrived[end[vessel]] += flow[vessel] * here


@jit
def gather(start: IntArray, cell: IntArray, weight: FloatArray, field: FloatArray) -> FloatArray:
    """Weighted mean of a flat field around each element, (n,)."""
    mean = np.zeros(len(start) - 1)
    for e in range(len(mean)):
        total = 0.0
        for k in range(start[e], start[e + 1]):
            total += weight[k] * field[cell[k]]
        mean[e] = total
    return mean


@jit
def scatter(
    start: IntArray, cell: IntArray, weight: FloatArray, value: FloatArray, field: FloatArray
) -> None:
    """Add each element's value to a flat field by its weights."""
    for e in range(len(value)):
        for k in range(start[e], start[e + 1]):
            field[cell[k]] += weight[k] * value[e]
