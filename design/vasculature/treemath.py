"""Compute a finished tree's radius ratios and radii from its geometry and topology."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.network import VesselKind, VesselNetwork
from design.vasculature.tree import VesselTree
from design.vasculature.viscosity import ROUNDS, SETTLED, relative_viscosities
from kernels import jit
from kernels.arrays import FloatArray

IntArray = NDArray[np.int32]


def tree_from_topology(
    proximal: FloatArray,
    distal: FloatArray,
    parent: IntArray,
    children: NDArray[np.int32],
    *,
    flow_ul_s: float,
    pressure_drop_pa: float,
    murray_exponent: float,
    viscosity_pa_s: float,
    relative_flow: FloatArray | None = None,
    haematocrit: float = -1.0,
    given: NDArray[np.bool_] | None = None,
    smallest_radius_mm: float | None = None,
) -> VesselTree:
    """Derive terminals, flows, reduced resistances and ratios from the leaves up.

    Parameters
    ----------
    proximal, distal : (n, 3) float64, mm
    parent : (n,) int32
    children : (n, 2) int32
    flow_ul_s : float
        Into the root.
    pressure_drop_pa, murray_exponent, viscosity_pa_s, haematocrit : float
        As in `VesselTree`.
    relative_flow : (n,) float64, optional
        Shares of the terminals, in any unit; of other segments it isn't read. Every terminal has
        an equal share by default.
    given : (n,) bool, optional
        Segments of a given trunk; none by default.
    smallest_radius_mm : float, optional
        Fixes the smallest radius; the pressure drop follows, and isn't read.
    """
    n = len(parent)
    own = np.ones(n)
    if relative_flow is not None:
        tips = children[:, 0] < 0
        own = relative_flow / float(relative_flow[tips].mean())
    order = downward_order(children)
    terminals, flow = _sums(order, children, own)
    tree = VesselTree(
        proximal=np.ascontiguousarray(proximal),
        distal=np.ascontiguousarray(distal),
        parent=np.ascontiguousarray(parent),
        children=np.ascontiguousarray(children),
        terminals=terminals,
        relative_flow=flow,
        relative_viscosity=np.ones(n),
        reduced_resistance=np.empty(n),
        ratio=np.empty(n),
        terminal_flow_ul_s=flow_ul_s / int(terminals[0]),
        pressure_drop_pa=pressure_drop_pa,
        murray_exponent=murray_exponent,
        viscosity_pa_s=viscosity_pa_s,
        haematocrit=haematocrit,
        given=np.zeros(n, dtype=np.bool_) if given is None else np.ascontiguousarray(given),
    )
    return _settled(tree, smallest_radius_mm)


def _settled(tree: VesselTree, smallest_mm: float | None) -> VesselTree:
    """The tree with its ratios, in one pass or until viscosities and radii agree."""
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    order = downward_order(tree.children)
    k = 8.0 * tree.viscosity_pa_s / pi
    for _ in range(ROUNDS):
        weighed = k * length * tree.relative_viscosity
        resistance, ratio = _ratios(
            order, tree.children, tree.relative_flow, weighed, tree.murray_exponent
        )
        tree = replace(tree, reduced_resistance=resistance, ratio=ratio)
        if smallest_mm is not None:
            factor = smallest_mm / float(tree_radii(tree).min())
            tree = replace(tree, pressure_drop_pa=tree.pressure_drop_pa / factor**4)
        if tree.haematocrit < 0.0:
            break
        viscosity = np.empty(len(length))
        relative_viscosities(tree_radii(tree), tree.haematocrit, viscosity)
        change = float(np.abs(viscosity / tree.relative_viscosity - 1.0).max())
        if change < SETTLED:
            break
        tree = replace(tree, relative_viscosity=viscosity)
    return tree


@jit
def downward_order(children: Any) -> Any:
    """Segments in an order in which parents come before their children, (n,) int32."""
    order = np.empty(len(children), np.int32)
    stack = np.empty(len(children), np.int32)
    stack[0] = 0
    top = 1
    size = 0
    while top > 0:
        top -= 1
        i = stack[top]
        order[size] = i
        size += 1
        for side in (1, 0):
            if children[i, side] >= 0:
                stack[top] = children[i, side]
                top += 1
    return order[:size]


@jit
def _sums(order: Any, children: Any, own: Any) -> Any:
    """Terminals and flow downstream of each segment; ``own`` is read at terminals."""
    terminals = np.ones(len(children), np.int32)
    flow = own.copy()
    for at in range(len(order) - 1, -1, -1):
        i = order[at]
        a, b = children[i]
        if a < 0:
            continue
        terminals[i], flow[i] = terminals[a], flow[a]
        if b >= 0:
            terminals[i] += terminals[b]
            flow[i] += flow[b]
    return terminals, flow


@jit
def _ratios(order: Any, children: Any, flow: Any, own: Any, gamma: float) -> Any:
    """Reduced resistances and ratios; ``own`` is 8 μ v ℓ / π."""
    resistance = own.copy()
    ratio = np.ones(len(children))
    for at in range(len(order) - 1, -1, -1):
        i = order[at]
        a, b = children[i]
        if a < 0:
            continue
        if b < 0:
            resistance[i] += resistance[a]
            continue
        x = (flow[a] * resistance[a] / (flow[b] * resistance[b])) ** 0.25
        ratio[a] = (1.0 + x**-gamma) ** (-1.0 / gamma)
        ratio[b] = (1.0 + x**gamma) ** (-1.0 / gamma)
        resistance[i] += 1.0 / (ratio[a] ** 4 / resistance[a] + ratio[b] ** 4 / resistance[b])
    return resistance, ratio


@jit
def _radii(order: Any, children: Any, ratio: Any, root: float) -> Any:
    radius = np.empty(len(children))
    radius[0] = root
    for i in order:
        for child in children[i]:
            if child >= 0:
                radius[child] = radius[i] * ratio[child]
    return radius


def tree_radii(tree: VesselTree) -> FloatArray:
    """Radii (n,), mm, in one downward pass: r_root⁴ = Q R* / Δp, then r = β r_parent."""
    flow = tree.terminal_flow_ul_s * int(tree.terminals[0])
    root = (flow * float(tree.reduced_resistance[0]) / tree.pressure_drop_pa) ** 0.25
    radii: FloatArray = _radii(downward_order(tree.children), tree.children, tree.ratio, root)
    return radii


def scaled_to_smallest_radius(tree: VesselTree, radius_mm: float) -> VesselTree:
    """The same tree with its smallest radius at ``radius_mm``.

    All radii change by one factor, with a haematocrit by nearly one. The flow stays; the pressure
    drop follows, for a Newtonian fluid as the factor to the power of -4. Whether it still fits
    must be checked anew (`check_tree`); growth with ``smallest_radius_mm`` does it itself.

    Raises
    ------
    GrowthError
        When ``radius_mm`` isn't above 0.
    """
    if not radius_mm > 0:
        raise GrowthError(f"smallest radius {radius_mm:g} mm isn't above 0; give a positive one")
    if tree.haematocrit >= 0.0:
        return _settled(tree, radius_mm)
    factor = radius_mm / float(tree_radii(tree).min())
    return replace(tree, pressure_drop_pa=tree.pressure_drop_pa / factor**4)


def tree_to_network(
    tree: VesselTree, kind: VesselKind = VesselKind.ARTERY, tree_number: int = 0
) -> VesselNetwork:
    """One straight vessel of constant radius for each segment, flow from root to terminals.

    Node 0 is the root's inlet; node i + 1 the far end of segment i.
    """
    count = len(tree.parent)
    nodes = np.concatenate([tree.proximal[:1], tree.distal])
    # The root's parent is -1, so it begins at node 0.
    ends = np.column_stack([tree.parent.astype(np.int64) + 1, np.arange(1, count + 1)])
    return VesselNetwork.from_segments(
        nodes,
        ends,
        tree_radii(tree),
        np.full(count, int(kind), dtype=np.int64),
        np.full(count, tree_number, dtype=np.int64),
    )
