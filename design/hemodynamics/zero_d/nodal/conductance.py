"""The linear system Σ y (p_i - p_j) + y_ground p_i = s of a graph, real or complex.

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
from scipy.sparse import coo_array
from scipy.sparse.linalg import SuperLU, splu

from design.errors import FlowError
from design.hemodynamics.zero_d.nodal.elimination import fold, gather, peel, unfold
from design.network import FloatArray, IntArray

Numbers = NDArray[Any]
"""Real or complex."""

_REFINEMENTS = 6
_BALANCED = 4.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Structure:
    """A graph with branches folded onto a core.

    Attributes
    ----------
    first, last : (v,) int64
        Unknowns at the ends of each vessel.
    fixed : (s,) bool
        Unknowns of given pressure.
    order, by : (k,) int64
        Folded unknowns and the vessel each was folded along.
    unfolded : (v - k,) int64
        The other vessels.
    beside : pairs of (h,) int64
        Vessels with one end fixed, by the other, free one: vessels, free unknowns, fixed ones.
    core : (c,) int64
        Unknowns that are left.
    links : (l,) int64
        Vessels between two of them; ``ends`` (l, 2) are those, numbered in the core.
    """

    first: IntArray
    last: IntArray
    fixed: NDArray[np.bool_]
    order: IntArray
    by: IntArray
    unfolded: IntArray
    beside: tuple[IntArray, IntArray, IntArray]
    core: IntArray
    links: IntArray
    ends: IntArray

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
        total += _summed(free, admittance[vessels], len(total))
        share = fold(self.order, self.by, self.first + self.last, admittance, total)
        scale, factors = _core(self.ends, admittance[self.links], total[self.core])
        return NodalSystem(self, admittance, ground, share, total, scale, factors)


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
    scale : (c,)
        Takes the core's matrix to a unit diagonal.
    factors : SuperLU or None
        Of the scaled matrix; None where no two of the core are joined.
    """

    structure: Structure
    conductance: Numbers
    to_ground: Numbers | None
    share: Numbers
    ground: Numbers
    scale: Numbers
    factors: SuperLU | None

    def solve(self, injected: Numbers, given: Numbers) -> tuple[Numbers, Numbers]:
        """Pressures (s,) and flows (v,) for flows in (s,) and pressures at fixed unknowns (s,)."""
        s = self.structure
        pressure = np.where(s.fixed, given, 0.0).astype(self.conductance.dtype, copy=False)
        source = np.array(injected, dtype=self.conductance.dtype)
        vessels, free, held = s.beside
        source += _summed(free, self.conductance[vessels] * pressure[held], len(source))
        ends_sum = s.first + s.last
        gather(s.order, s.by, ends_sum, self.share, source)
        right = self.scale * source[s.core]
        pressure[s.core] = self.scale * (self.factors.solve(right) if self.factors else right)
        flow = np.empty(len(s.first), self.conductance.dtype)
        unfold(
            s.order,
            s.by,
            s.first,
            s.last,
            self.share,
            self.conductance,
            self.ground,
            source,
            pressure,
            flow,
        )
        rest = s.unfolded
        flow[rest] = self.conductance[rest] * (pressure[s.first[rest]] - pressure[s.last[rest]])
        return pressure, flow

    def balanced(self, injected: Numbers, given: Numbers) -> tuple[Numbers, Numbers]:
        """As `solve`, with mass conserved to rounding, relative to the flow through each unknown.

        What a solution leaves over at the unknowns is solved for again and added to the flows
        themselves, however small the pressure differences are beside the pressures.
        """
        pressure, flow = self.solve(injected, given)
        for _ in range(_REFINEMENTS):
            excess, through = self.excess(injected, pressure, flow)
            if np.all(np.abs(excess) <= _BALANCED * through):
                break
            more_pressure, more_flow = self.solve(excess, np.zeros_like(pressure))
            pressure, flow = pressure + more_pressure, flow + more_flow
        return pressure, flow

    def excess(
        self, injected: Numbers, pressure: Numbers, flow: Numbers
    ) -> tuple[Numbers, FloatArray]:
        """What is left over at each unknown, 0 where fixed, and what goes through it, (s,)."""
        s, count = self.structure, len(pressure)
        lost = 0.0 if self.to_ground is None else self.to_ground * pressure
        net = injected - lost - _summed(s.first, flow, count) + _summed(s.last, flow, count)
        size = np.abs(flow)
        through = _summed(s.first, size, count) + _summed(s.last, size, count)
        return np.where(s.fixed, 0.0, net), through + np.abs(injected) + np.abs(lost)


def structure_of(ends: IntArray, fixed: NDArray[np.bool_]) -> Structure:
    """Find what can be folded away of vessels between unknowns ``ends`` (v, 2)."""
    first, last = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])
    inner = ~fixed[first] & ~fixed[last] & (first != last)
    order, by = peel(first, last, inner, len(fixed))
    folded = np.zeros(len(first), dtype=bool)
    folded[by] = True
    is_core = ~fixed
    is_core[order] = False
    unfolded, core = np.flatnonzero(~folded), np.flatnonzero(is_core)
    between = is_core[first[unfolded]] & is_core[last[unfolded]]
    links = unfolded[between & (first[unfolded] != last[unfolded])]
    number = np.zeros(len(fixed), dtype=np.int64)
    number[core] = np.arange(len(core))
    return Structure(
        first,
        last,
        fixed,
        order,
        by,
        unfolded,
        _beside(first, last, fixed),
        core,
        links,
        np.column_stack([number[first[links]], number[last[links]]]),
    )


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


def _core(ends: IntArray, admittance: Numbers, ground: Numbers) -> tuple[Numbers, SuperLU | None]:
    """Scale and LU of the core's matrix.

    It is symmetric and, real, positive definite (complex, its real part is), so no pivoting is
    needed and minimum degree ordering serves; the unit diagonal keeps errors small row by row,
    though conductances span many orders.
    """
    count = len(ground)
    first, last = ends.T
    diagonal = ground + _summed(first, admittance, count) + _summed(last, admittance, count)
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
            options={"SymmetricMode": True},
        )
    except RuntimeError as exc:
        raise FlowError(
            f"the flow problem is singular ({exc}): its vessels' resistances span too many "
            "orders; check radii and lengths"
        ) from exc


def _summed(where: IntArray, values: Numbers, count: int) -> Numbers:
    if np.iscomplexobj(values):
        return _summed(where, values.real, count) + 1j * _summed(where, values.imag, count)
    return np.asarray(np.bincount(where, weights=values, minlength=count), dtype=np.float64)
