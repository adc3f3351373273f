"""Fit of a file's radii to Murray's law, and the radii that keep it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.read_network import FloatArray, Pieces
from benchmarks.checkers.tree_order import from_roots, parents


def murray_ratios(net: Pieces, exponent: float = 3.0) -> FloatArray:
    """Σ r^γ leaving over Σ r^γ entering at each node where vessels branch, (b,); 1 is exact."""
    entering = np.bincount(
        net.node[:, 1], weights=net.radius[:, 1] ** exponent, minlength=net.node_count
    )
    leaving = np.bincount(
        net.node[:, 0], weights=net.radius[:, 0] ** exponent, minlength=net.node_count
    )
    degree = np.bincount(net.node.ravel(), minlength=net.node_count)
    branching = (entering > 0) & (leaving > 0) & (degree > 2)
    return leaving[branching] / entering[branching]


def murray_residual(net: Pieces, exponent: float = 3.0) -> float:
    """Largest |Σ r^γ leaving / Σ r^γ entering - 1|."""
    ratios = murray_ratios(net, exponent)
    return float(np.abs(ratios - 1.0).max()) if len(ratios) else 0.0


@dataclass(frozen=True)
class Perfusion:
    """What a tree's radii are derived from."""

    flow_ul_s: float
    drop_pa: float
    viscosity_pa_s: float
    murray_exponent: float = 3.0


def consistent_radii(net: Pieces, perfusion: Perfusion) -> FloatArray:
    """Radii (n,), mm, with which a binary tree keeps Murray's law and feeds all outlets alike.

    Only geometry and topology of ``net`` are used. With equal pressures behind all outlets the
    flow through two branches is in the ratio Q_l / Q_r = (r_l⁴ / R*_l) / (r_r⁴ / R*_r), so that
    (r_l / r_r)⁴ = Q_l R*_l / Q_r R*_r; Murray's law does the rest (Karch et al. 1999,
    doi 10.1016/S0010-4825(98)00045-6). Here a branch's load L = Q R* replaces both:
    r_l / r_r = (L_l / L_r)^¼, and the parent's own is L = 8 μ ℓ Q / π + L_l (r_parent / r_l)⁴.

    Raises
    ------
    ValueError
        When the network isn't one binary tree.
    """
    parent = parents(net)
    children = np.bincount(parent[parent >= 0], minlength=net.count)
    order = from_roots(parent)
    if (parent < 0).sum() != 1 or not np.isin(children, (0, 2)).all() or len(order) < net.count:
        raise ValueError("the network isn't one binary tree")
    each = perfusion.flow_ul_s / len(net.outlets())
    radii: FloatArray = _radii(
        parent,
        order,
        8.0 * perfusion.viscosity_pa_s / np.pi * each * net.length,
        perfusion.drop_pa,
        perfusion.murray_exponent,
    )
    return radii


@compiled
def _radii(parent: Any, order: Any, unit_load: Any, drop_pa: float, gamma: float) -> Any:
    n = len(parent)
    load, share, terminals = np.zeros(n), np.ones(n), np.zeros(n)
    first = np.full(n, -1, np.int64)
    for k in range(n - 1, -1, -1):
        i = order[k]
        terminals[i] = max(1.0, terminals[i])
        load[i] += unit_load[i] * terminals[i]
        p = parent[i]
        if p < 0:
            continue
        terminals[p] += terminals[i]
        if first[p] < 0:
            first[p] = i
            continue
        j = first[p]
        wider = (load[i] / load[j]) ** 0.25
        share[i] = (1.0 + wider**-gamma) ** (-1.0 / gamma)
        share[j] = (1.0 + wider**gamma) ** (-1.0 / gamma)
        load[p] = load[i] / share[i] ** 4
    radius = np.empty(n)
    for i in order:
        p = parent[i]
        radius[i] = (load[i] / drop_pa) ** 0.25 if p < 0 else radius[p] * share[i]
    return radius
