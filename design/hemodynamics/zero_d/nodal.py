"""Solve Σ y (p_i - p_j) + y_ground p_i = s for node pressures of a graph, real or complex.

A graph's `Structure` (what can be folded away, in which order) is found once; its numbers are
factorised for each set of admittances, and solved for any s. Steady flow has the vessels'
conductances for admittances and no ground; a frequency of a pulse has the same form
(`design.hemodynamics.zero_d.pulsatile`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import SuperLU, splu

from design.errors import FlowError
from design.hemodynamics.zero_d.chains import (
    Chains,
    Numbers,
    chains_of,
    fold_chains,
    gather_chains,
    unfold_chains,
)
from kernels import jit
from kernels.arrays import FloatArray, IntArray

_REFINEMENTS = 6
_BALANCED = 16.0 * float(np.finfo(np.float64).eps)
"""Of the flow through an unknown; elimination alone leaves a few roundings of it over."""


class HalfFixed(NamedTuple):
    """Vessels with one end of given pressure; their free and their fixed unknowns, (h,) each."""

    vessel: IntArray
    free: IntArray
    fixed: IntArray


class Structure(NamedTuple):
    """A graph with branches folded onto a core.

    Attributes
    ----------
    first, last : (v,) int64
        Unknowns at the ends of each vessel.
    fixed : (s,) bool
        Unknowns of given pressure.
    order, by, onto : (k,) int64
        Folded unknowns, the vessel each was folded along, and the unknown it was folded onto.
    unfolded : (v - k,) int64
        The other vessels.
    half_fixed : HalfFixed
    core : (c,) int64
        Unknowns that are left.
    links : (l,) int64
        Vessels between two of them.
    plan : Chains
        How these are eliminated.
    """

    first: IntArray
    last: IntArray
    fixed: NDArray[np.bool_]
    order: IntArray
    by: IntArray
    onto: IntArray
    unfolded: IntArray
    half_fixed: HalfFixed
    core: IntArray
    links: IntArray
    plan: Chains

    def factorise(self, admittance: Numbers, ground: Numbers | None = None) -> NodalSystem:
        """Numbers put in: admittances of vessels (v,), µL/(s·Pa), and to ground of unknowns (s,).

        Raises
        ------
        FlowError
            When the core is singular to working precision.
        """
        total = np.zeros(len(self.fixed), admittance.dtype)
        if ground is not None:
            total += ground
        # Of NumPy, which takes large pages for it.
        share = np.empty(len(self.order), admittance.dtype)
        fold(self, admittance, total, share)
        core = factorise_core(self.plan, admittance[self.links], total[self.core])
        return NodalSystem(self, admittance, ground, share, total, core)


@dataclass(frozen=True)
class NodalSystem:
    """A `Structure` with its numbers, ready to be solved.

    Attributes
    ----------
    structure : Structure
    conductance : (v,), µL/(s·Pa)
        Admittances of vessels.
    to_ground : (s,) or None, µL/(s·Pa)
        Admittances of unknowns to ground.
    share, ground : (k,), (s,)
        σ and G of `design.hemodynamics.zero_d.nodal`.
    core : Core
    """

    structure: Structure
    conductance: Numbers
    to_ground: Numbers | None
    share: Numbers
    ground: Numbers
    core: Core

    def solve(self, injected: Numbers, given: Numbers) -> tuple[Numbers, Numbers]:
        """Pressures (s,) and flows (v,) for flows in (s,) and pressures at fixed unknowns (s,)."""
        s, kind = self.structure, self.conductance.dtype
        # The pressure is read where fixed only, and written elsewhere.
        pressure, source = np.empty((2, len(given)), kind)
        pressure[:], source[:] = given, injected
        gather(s, self.conductance, self.share, pressure, source)
        pressure[s.core] = self.core.solve(source[s.core])
        flow = np.empty(len(s.first), kind)
        unfold(s, self.share, self.conductance, self.ground, source, pressure, flow)
        return pressure, flow

    def balanced(self, injected: Numbers, given: Numbers) -> tuple[Numbers, Numbers]:
        """As `solve`, with mass conserved to rounding, relative to the flow through each unknown.

        What a solution leaves over at the unknowns is solved for again and added to the flows
        themselves, however small the pressure differences are beside the pressures.
        """
        pressure, flow = self.solve(injected, given)
        for _ in range(_REFINEMENTS):
            excess, worst = self.excess(injected, pressure, flow)
            if worst <= _BALANCED:
                break
            more_pressure, more_flow = self.solve(excess, np.zeros_like(pressure))
            pressure, flow = pressure + more_pressure, flow + more_flow
        return pressure, flow

    def excess(self, injected: Numbers, pressure: Numbers, flow: Numbers) -> tuple[Numbers, float]:
        """What is left over at each unknown, 0 where fixed, (s,), and the most of it.

        The most relative to what goes through the unknown.
        """
        s = self.structure
        net, through = np.array(injected, dtype=flow.dtype), np.abs(injected)
        if self.to_ground is not None:
            lost = self.to_ground * pressure
            net -= lost
            through += np.abs(lost)
        return net, float(largest_imbalance(s, flow, net, through))


def structure_of(ends: IntArray, fixed: NDArray[np.bool_]) -> Structure:
    """Find what can be folded away of vessels between unknowns ``ends`` (v, 2)."""
    first, last = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])
    order, by, onto = folding_order(first, last, fixed)
    folded = np.zeros(len(first), dtype=bool)
    folded[by] = True
    is_core = ~fixed
    is_core[order] = False
    unfolded, core = np.flatnonzero(~folded), np.flatnonzero(is_core)
    between = is_core[first[unfolded]] & is_core[last[unfolded]]
    links = unfolded[between & (first[unfolded] != last[unfolded])]
    number = np.zeros(len(fixed), dtype=np.int64)
    number[core] = np.arange(len(core))
    plan = chains_of(number[first[links]], number[last[links]], len(core))
    vessel = np.flatnonzero(fixed[first] != fixed[last])
    a, b, b_fixed = first[vessel], last[vessel], fixed[last[vessel]]
    half = HalfFixed(vessel, np.where(b_fixed, a, b), np.where(b_fixed, b, a))
    return Structure(first, last, fixed, order, by, onto, unfolded, half, core, links, plan)


def factorise(ends: IntArray, conductance: FloatArray, fixed: NDArray[np.bool_]) -> NodalSystem:
    """Fold the branches of a network away and factorise its core.

    Raises
    ------
    FlowError
        When the core is singular to working precision.
    """
    return structure_of(ends, fixed).factorise(conductance)


@dataclass(frozen=True)
class Core:
    """Factors of a graph with loops.

    Attributes
    ----------
    plan : Chains
    share, total : (k, 2), (k,)
        Of the plan's steps (`fold_chains`).
    scale : (r,)
        Takes the matrix of what is left to a unit diagonal.
    factors : SuperLU or None
        Of that scaled matrix; None where no two of its unknowns are joined.
    """

    plan: Chains
    share: Numbers
    total: Numbers
    scale: Numbers
    factors: SuperLU | None

    def solve(self, source: Numbers) -> Numbers:
        """Values (n,) for ``source`` (n,), which is changed."""
        p, value = self.plan, np.empty_like(source)
        gather_chains(p, self.share, source)
        right = self.scale * source[p.left]
        value[p.left] = self.scale * (self.factors.solve(right) if self.factors else right)
        unfold_chains(p, self.share, self.total, source, value)
        return value


def factorise_core(plan: Chains, admittance: Numbers, ground: Numbers) -> Core:
    """Put numbers into a plan: admittances of its given links, and to ground (n,).

    Raises
    ------
    FlowError
        When what is left is singular to working precision.
    """
    # Two more than links: for a neighbour that isn't there, and a link that leads nowhere.
    weight = np.zeros(len(admittance) + 2, admittance.dtype)
    weight[: len(admittance)] = admittance
    ground = ground.copy()
    share, total = fold_chains(plan, weight, ground)
    return Core(
        plan, share, total, *_rest(plan.left_ends, weight[plan.left_links], ground[plan.left])
    )


def _rest(ends: IntArray, admittance: Numbers, ground: Numbers) -> tuple[Numbers, SuperLU | None]:
    """Scale and LU of a matrix.

    It is symmetric and, real, positive definite (complex, its real part is), so no pivoting is
    needed and minimum degree ordering serves; the unit diagonal keeps errors small row by row,
    though conductances span many orders. Columns are taken one by one: SuperLU's relaxed supernodes
    and panels cost up to 30 times as much on an artery and a vein joined at 200,000 terminals.
    """
    count = len(ground)
    first, last = ends.T
    diagonal = (
        ground + sum_by_place(first, admittance, count) + sum_by_place(last, admittance, count)
    )
    scale = 1.0 / np.sqrt(diagonal)
    if len(first) == 0:
        return scale, None
    off = -admittance * scale[first] * scale[last]
    every = np.arange(count)
    values = np.concatenate([off, off, np.ones(count)])
    rows, columns = np.concatenate([first, last, every]), np.concatenate([last, first, every])
    matrix = coo_array((values, (rows, columns)), shape=(count, count)).tocsc()
    try:
        return scale, splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            relax=1,
            panel_size=1,
            options={"SymmetricMode": True},
        )
    except RuntimeError as exc:
        raise FlowError(
            f"the flow problem is singular ({exc}): its vessels' resistances span too many "
            "orders; check radii and lengths"
        ) from exc


def sum_by_place(where: NDArray[Any], values: Numbers, count: int) -> Numbers:
    """Values added up by their places, (count,)."""
    if np.iscomplexobj(values):
        return sum_by_place(where, values.real, count) + 1j * sum_by_place(
            where, values.imag, count
        )
    return np.asarray(np.bincount(where, weights=values, minlength=count), dtype=np.float64)


@jit
def folding_order(
    first: IntArray, last: IntArray, fixed: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """Order in which unknowns can be folded away, along which vessel, and onto which unknown.

    The one vessel a node has left is the exclusive or of the numbers of all that it had and has
    lost: no adjacency list is needed.

    A node i of pressure p_i with one vessel left, of conductance g to node j, and with all else on
    it summed up as a conductance G to ground and a source s (Norton's equivalent), obeys

        g (p_j - p_i) = G p_i - s.

    Seen from j it is a conductance G σ and a source s σ with σ = g/(g + G); and once p_j is known,

        p_i = σ p_j + s/(g + G),    Q_{j→i} = σ (G p_j - s).

    Every term is a sum or product of positive numbers where s = 0, so flows come out right to
    rounding however far conductances lie apart. Complex admittances of a frequency obey the same. A
    tree folds up to a single node; of a graph with loops its core remains.
    """
    count = len(fixed)
    degree = np.zeros(count, dtype=np.int64)
    left = np.zeros(count, dtype=np.int64)
    for vessel in range(len(first)):
        a, b = first[vessel], last[vessel]
        if not (fixed[a] or fixed[b] or a == b):
            degree[a] += 1
            left[a] ^= vessel
            degree[b] += 1
            left[b] ^= vessel
    order = np.empty(count, dtype=np.int64)
    by = np.empty(count, dtype=np.int64)
    onto = np.empty(count, dtype=np.int64)
    folded = 0
    # From the last: where parents come before their children, a sweep back meets leaves first.
    for start in range(count - 1, -1, -1):
        node = start
        while degree[node] == 1:
            vessel = left[node]
            other = first[vessel] + last[vessel] - node
            order[folded], by[folded], onto[folded] = node, vessel, other
            folded += 1
            degree[node] = 0
            node = other
            degree[node] -= 1
            left[node] ^= vessel
            # Nodes further down will be met by the outer loop.
            if node < start:
                break
    return order[:folded].copy(), by[:folded].copy(), onto[:folded].copy()


@jit
def fold(s: Structure, conductance: Numbers, ground: Numbers, share: Numbers) -> None:
    """σ of each folded node (k,); ``ground`` (s,) gains what vessels lead to, both in place."""
    half, order, by, onto = s.half_fixed, s.order, s.by, s.onto
    for k in range(len(half.vessel)):
        ground[half.free[k]] += conductance[half.vessel[k]]
    for k in range(len(order)):
        node, g = order[k], conductance[by[k]]
        share[k] = g / (g + ground[node])
        ground[onto[k]] += ground[node] * share[k]


@jit
def gather(
    s: Structure, conductance: Numbers, share: Numbers, pressure: Numbers, source: Numbers
) -> None:
    """Add what given pressures drive; carry sources of folded nodes to what they hang on."""
    half, order, onto = s.half_fixed, s.order, s.onto
    for k in range(len(half.vessel)):
        source[half.free[k]] += conductance[half.vessel[k]] * pressure[half.fixed[k]]
    for k in range(len(order)):
        source[onto[k]] += source[order[k]] * share[k]


@jit
def unfold(
    s: Structure,
    share: Numbers,
    conductance: Numbers,
    ground: Numbers,
    source: Numbers,
    pressure: Numbers,
    flow: Numbers,
) -> None:
    """Pressure of each folded node, from the last folded to the first, and all flows."""
    order, by, onto, first, last = s.order, s.by, s.onto, s.first, s.last
    for k in range(len(order) - 1, -1, -1):
        node, vessel, beyond = order[k], by[k], pressure[onto[k]]
        g, to_ground, here = conductance[vessel], ground[node], source[node]
        pressure[node] = share[k] * beyond + here / (g + to_ground)
        towards_node = share[k] * (to_ground * beyond - here)
        flow[vessel] = towards_node if last[vessel] == node else -towards_node
    for v in s.unfolded:
        flow[v] = conductance[v] * (pressure[first[v]] - pressure[last[v]])


@jit
def largest_imbalance(
    s: Structure, flow: Numbers, net: Numbers, through: NDArray[np.float64]
) -> float:
    """Take flows from what goes into each unknown, in place, and find the most that is left.

    ``net`` and ``through`` (s,) come with what else goes in; where the pressure is given nothing
    is left.
    """
    first, last, fixed = s.first, s.last, s.fixed
    for v in range(len(first)):
        a, b, q = first[v], last[v], flow[v]
        net[a] -= q
        net[b] += q
        through[a] += abs(q)
        through[b] += abs(q)
    worst = 0.0
    for node in range(len(fixed)):
        if fixed[node]:
            net[node] = 0.0
        elif through[node] > 0.0:
            worst = max(worst, abs(net[node]) / through[node])
    return worst
