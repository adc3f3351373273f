r"""Compute a finished tree's exact cost Σ ℓᵘ r^λ and its gradient by branch point positions.

With a mean terminal flow q and a fixed pressure drop Δp the cost Σ ℓᵘ r^λ of a whole tree is
(q/Δp)^(λ/4) K_root (`growth.cost`), the volume for u = 1, λ = 2 times π. It depends on
the branch points through the segments' lengths alone. Differentiating the bifurcation's algebra
from the root down (reverse mode, as for any recursion: Griewank & Walther, Evaluating Derivatives,
2nd ed. 2008, ch. 3) gives with e = λ/4, S = K_l + K_r, A_c = W_c^(γ/4), W̄ = ∂K_root/∂W and
K̄ = ∂K_root/∂K, which is 1 at the root, where W̄ = 0:

- m̄ = W̄ + K̄ (e K/W - e W^e S / m^(e+1))
- W̄_c = m̄ (m / ΣA) (A_c / W_c),   K̄_c = K̄ W^e / m^e
- ∂K_root/∂ℓ = (W̄ + K̄ e K/W) n k v + K̄ W^e u ℓ^(u-1)

Viscosities v are held; each audit takes them anew where they depend on the radii.

One pass up for W and K and one down (`growth.state.spread_down`) are O(n). A branch
point then sees the sum of ∂K_root/∂ℓ times the unit vectors along its three segments: where it
vanishes the point is a weighted Fermat point of its three neighbours.
"""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from design.vasculature.growth.cost import joined_load, to_gamma, to_lambda, to_u
from design.vasculature.growth.state import SEGMENT, Segments, refresh_all, spread_down
from design.vasculature.options import Law
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels import jit


def law_of(tree: VesselTree, length_exponent: float = 1.0, radius_exponent: float = 2.0) -> Law:
    """The constants of the cost Σ ℓᵘ r^λ for a tree."""
    k = 8.0 * tree.viscosity_pa_s / pi
    return Law(k, tree.murray_exponent, radius_exponent, length_exponent, tree.haematocrit)


def segments_of(tree: VesselTree, law: Law) -> Segments:
    """The tree as growing segments, with radii and derivatives of the cost."""
    segments = np.zeros(len(tree.parent), SEGMENT)
    for axis, name in enumerate("xyz"):
        segments[f"p{name}"] = tree.proximal[:, axis]
        segments[f"d{name}"] = tree.distal[:, axis]
    segments["length"] = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    segments["parent"] = tree.parent
    segments["left"], segments["right"] = tree.children.T
    segments["allowed"] = np.inf
    segments["flow"], segments["thick"] = tree.relative_flow, tree.relative_viscosity
    segments["given"] = tree.given
    refresh_all(segments, len(segments), law)
    spread_down(segments, len(segments), float(tree_radii(tree)[0]), 1.0, law)
    return segments


def tree_volume(tree: VesselTree) -> float:
    """Volume of all vessels, mm³: the sum of π r² ℓ."""
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    return float(pi * (tree_radii(tree) ** 2 @ length))


@jit
def child_slope(
    child_load: float, child_spend: float, weight: float, length: float, bar: Any, law: Law
) -> float:
    """Derivative of the cost by a segment's length.

    ``bar`` are the cost's derivatives by the segment's load and spend, ``weight`` its flow times
    its viscosity.
    """
    own = 0.25 * law.lam * child_spend / child_load
    by_length = law.u * to_u(length, law) / length
    return (bar[0] + bar[1] * own) * weight * law.k + bar[1] * to_lambda(
        child_load, law
    ) * by_length


@jit
def walk_up(
    segments: Any, index: int, load: float, spend: float, flow: float, law: Law
) -> tuple[float, float]:
    """Cost of the tree if segment ``index`` had this load, spend and flow; exact, O(depth).

    Returns
    -------
    cost : float
        K_root.
    radius4 : float, Pa·s·mm
        W_root / n_root times the shares on the way down: times Q/Δp, the fourth power of the
        segment's radius, mm⁴. Q is the flow into the root.
    """
    share = 1.0
    n = flow
    here = index
    while segments[here].parent >= 0:
        up = segments[here].parent
        other = segments[up].left
        if other == here:
            other = segments[up].right
        o = segments[other]
        n += o.flow
        weight = n * segments[up].thick
        above, spend, m = joined_load(
            load, spend, o.load, o.spend, segments[up].length, weight, law
        )
        share *= load / m
        load, here = above, up
    return spend, share * load / n


@jit
def relengthened(s: Any, length: float, law: Law) -> tuple[float, float]:
    """Load and spend of a segment whose length alone changes."""
    load = s.load + s.flow * s.thick * law.k * (length - s.length)
    reduced = s.spend / to_lambda(s.load, law) - to_u(s.length, law) + to_u(length, law)
    return load, to_lambda(load, law) * reduced


@jit
def fork_slopes(
    above: Any, lengths: Any, loads: Any, spends: Any, weights: Any, law: Law
) -> tuple[float, float, float]:
    """Derivatives of the cost by the lengths above a fork and of its two branches.

    ``above`` holds the derivatives of the cost by the upper segment's load and spend, ``weights``
    the flow times the viscosity of the upper segment and the two branches.
    """
    e = 0.25 * law.lam
    in0, in1 = to_gamma(loads[0], law), to_gamma(loads[1], law)
    load, spend, m = joined_load(
        loads[0], spends[0], loads[1], spends[1], lengths[0], weights[0], law
    )
    we, me = to_lambda(load, law), to_lambda(m, law)
    both = spends[0] + spends[1]
    by_m = above[0] + above[1] * e * (spend / load - we * both / (me * m))
    by_spend = above[1] * we / me
    by_total = by_m * m / (in0 + in1)
    return (
        child_slope(load, spend, weights[0], lengths[0], above, law),
        child_slope(
            loads[0], spends[0], weights[1], lengths[1], (by_total * in0 / loads[0], by_spend), law
        ),
        child_slope(
            loads[1], spends[1], weights[2], lengths[2], (by_total * in1 / loads[1], by_spend), law
        ),
    )
