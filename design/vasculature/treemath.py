"""Ratios and radii of a finished tree, from its geometry and topology alone."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError
from design.vasculature.tree import VesselTree
from kernels import jit

FloatArray = NDArray[np.float64]
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
) -> VesselTree:
    """Derive terminals, reduced resistances and ratios from the leaves up.

    Parameters
    ----------
    proximal, distal : (n, 3) float64, mm
    parent : (n,) int32
    children : (n, 2) int32
    flow_ul_s : float
        Into the root; every terminal has an equal share.
    pressure_drop_pa, murray_exponent, viscosity_pa_s : float
        As in `VesselTree`.
    """
    length = np.linalg.norm(distal - proximal, axis=1)
    order = downward_order(children)
    k = 8.0 * viscosity_pa_s / pi
    terminals, resistance, ratio = _ratios(order, children, length, k, murray_exponent)
    return VesselTree(
        proximal=np.ascontiguousarray(proximal),
        distal=np.ascontiguousarray(distal),
        parent=np.ascontiguousarray(parent),
        children=np.ascontiguousarray(children),
        terminals=terminals,
        reduced_resistance=resistance,
        ratio=ratio,
        terminal_flow_ul_s=flow_ul_s / int(terminals[0]),
        pressure_drop_pa=pressure_drop_pa,
        murray_exponent=murray_exponent,
        viscosity_pa_s=viscosity_pa_s,
    )


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
        if children[i, 0] >= 0:
            stack[top] = children[i, 1]
            stack[top + 1] = children[i, 0]
            top += 2
    return order[:size]


@jit
def _ratios(order: Any, children: Any, length: Any, k: float, gamma: float) -> Any:
    n = len(children)
    terminals = np.ones(n, np.int32)
    resistance = np.empty(n)
    ratio = np.ones(n)
    for at in range(len(order) - 1, -1, -1):
        i = order[at]
        resistance[i] = k * length[i]
        a, b = children[i]
        if a < 0:
            continue
        terminals[i] = terminals[a] + terminals[b]
        x = (terminals[a] * resistance[a] / (terminals[b] * resistance[b])) ** 0.25
        ratio[a] = (1.0 + x**-gamma) ** (-1.0 / gamma)
        ratio[b] = (1.0 + x**gamma) ** (-1.0 / gamma)
        resistance[i] += 1.0 / (ratio[a] ** 4 / resistance[a] + ratio[b] ** 4 / resistance[b])
    return terminals, resistance, ratio


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
    """The same tree with its smallest radius at ``radius_mm``: all radii change by one factor.

    The flow stays; the pressure drop follows as the factor to the power of -4. Whether it still
    fits must be checked anew (`check_tree`); growth with ``smallest_radius_mm`` does it itself.

    Raises
    ------
    GrowthError
        When ``radius_mm`` isn't above 0.
    """
    if not radius_mm > 0:
        raise GrowthError(f"smallest radius {radius_mm:g} mm isn't above 0; give a positive one")
    factor = radius_mm / float(tree_radii(tree).min())
    return replace(tree, pressure_drop_pa=tree.pressure_drop_pa / factor**4)
