"""Solve Σ y (p_i - p_j) + y_ground p_i = s for node pressures of a graph, real or complex.

A graph's `Structure` (what can be folded away, in which order) is found once; its numbers are
factorised for each set of admittances, and solved for any s. Steady flow has the vessels'
conductances for admittances and no ground; a step in time and a frequency of a pulse have the
same form (`design.hemodynamics.zero_d.pulsatile`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.zero_d.nodal.chains import Chains, chains_of
from design.hemodynamics.zero_d.nodal.core import Core, factorise_core
from design.hemodynamics.zero_d.nodal.elimination import (
    add_driven_sources,
    flows_between_known,
    fold,
    folding_order,
    gather,
    ground_given_pressures,
    largest_imbalance,
    unfold,
)
from kernels.arrays import FloatArray, IntArray

Numbers = NDArray[Any]
"""Real or complex."""

_REFINEMENTS = 6
_BALANCED = 16.0 * float(np.finfo(np.float64).eps)
"""Of the flow through an unknown; elimination alone leaves a few roundings of it over."""


@dataclass(frozen=True)
class Structure:
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
    beside : three of (h,) int64
        Vessels with one end fixed, by the other, free one: vessels, free unknowns, fixed ones.
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
    beside: tuple[IntArray, IntArray, IntArray]
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
        vessels, free, _ = self.beside
        ground_given_pressures(vessels, free, admittance, total)
        # Of NumPy, which takes large pages for it.
        share = np.empty(len(self.order), admittance.dtype)
        fold(self.order, self.by, self.onto, admittance, total, share)
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
        σ and G of `design.hemodynamics.zero_d.nodal.elimination`.
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
        add_driven_sources(*s.beside, self.conductance, pressure, source)
        gather(s.order, s.onto, self.share, source)
        pressure[s.core] = self.core.solve(source[s.core])
        flow = np.empty(len(s.first), kind)
        unfold(
            s.order,
            s.by,
            s.onto,
            s.last,
            self.share,
            self.conductance,
            self.ground,
            source,
            pressure,
            flow,
        )
        flows_between_known(s.unfolded, s.first, s.last, self.conductance, pressure, flow)
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
        worst = largest_imbalance(s.first, s.last, s.fixed, flow, net, through)
        return net, float(worst)


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
    beside = _beside(first, last, fixed)
    return Structure(first, last, fixed, order, by, onto, unfolded, beside, core, links, plan)


def factorise(ends: IntArray, conductance: FloatArray, fixed: NDArray[np.bool_]) -> NodalSystem:
    """Fold the branches of a network away and factorise its core.

    Raises
    ------
    FlowError
        When the core is singular to working precision.
    """
    return structure_of(ends, fixed).factorise(conductance)


def _beside(
    first: IntArray, last: IntArray, fixed: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    vessels = np.flatnonzero(fixed[first] != fixed[last])
    first, last = first[vessels], last[vessels]
    after = fixed[last]
    return vessels, np.where(after, first, last), np.where(after, last, first)
