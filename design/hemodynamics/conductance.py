"""The linear system Σ g (p_i - p_j) = s of a network, factorised once and solved for any s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import SuperLU, splu

from design.errors import FlowError
from design.hemodynamics.elimination import fold, gather, peel, unfold
from design.network import FloatArray, IntArray


@dataclass(frozen=True)
class ConductanceSystem:
    """Branches folded away, and the factors of the core that is left.

    Attributes
    ----------
    first, last : (v,) int64
        Unknowns at the ends of each vessel.
    conductance : (v,) float64, µL/(s·Pa)
    fixed : (s,) bool
        Unknowns of given pressure.
    order, by : (k,) int64
        Folded unknowns and the vessel each was folded along.
    share, ground : (k,), (s,) float64
        σ and G of `design.hemodynamics.elimination`.
    core : (c,) int64
        Unknowns that are left.
    scale : (c,) float64
        Takes the core's matrix to a unit diagonal.
    factors : SuperLU or None
        Of the scaled matrix; None where no two of the core are joined.
    """

    first: IntArray
    last: IntArray
    conductance: FloatArray
    fixed: NDArray[np.bool_]
    order: IntArray
    by: IntArray
    share: FloatArray
    ground: FloatArray
    core: IntArray
    scale: FloatArray
    factors: SuperLU | None

    def solve(self, injected: FloatArray, given: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pressures (s,) and flows (v,) for flows in (s,) and pressures at fixed unknowns (s,)."""
        pressure = np.where(self.fixed, given, 0.0)
        source = injected.copy()
        for here, there in ((self.first, self.last), (self.last, self.first)):
            source += _summed(here, self.conductance * pressure[there], len(source))
        gather(self.order, self.by, self.first + self.last, self.share, source)
        right = self.scale * source[self.core]
        pressure[self.core] = self.scale * (self.factors.solve(right) if self.factors else right)
        flow = np.zeros(len(self.first))
        unfold(
            self.order,
            self.by,
            self.first,
            self.last,
            self.share,
            self.conductance,
            self.ground,
            source,
            pressure,
            flow,
        )
        unfolded = np.ones(len(flow), dtype=bool)
        unfolded[self.by] = False
        across = self.conductance * (pressure[self.first] - pressure[self.last])
        return pressure, np.where(unfolded, across, flow)


def factorise(
    ends: IntArray, conductance: FloatArray, fixed: NDArray[np.bool_]
) -> ConductanceSystem:
    """Fold the branches of a network away and factorise its core.

    Raises
    ------
    FlowError
        When the core is singular to working precision.
    """
    first, last = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])
    inner = ~fixed[first] & ~fixed[last] & (first != last)
    order, by = peel(first, last, inner, len(fixed))
    ground = np.zeros(len(fixed))
    for here, there in ((first, last), (last, first)):
        ground += _summed(here, np.where(fixed[there], conductance, 0.0), len(fixed))
    share = fold(order, by, first + last, conductance, ground)
    is_core = ~fixed
    is_core[order] = False
    core = np.flatnonzero(is_core)
    links = is_core[first] & is_core[last] & (first != last)
    number = np.cumsum(is_core) - 1
    scale, factors = _core(
        number[first[links]], number[last[links]], conductance[links], ground[core]
    )
    return ConductanceSystem(
        first, last, conductance, fixed, order, by, share, ground, core, scale, factors
    )


def _core(
    first: IntArray, last: IntArray, conductance: FloatArray, ground: FloatArray
) -> tuple[FloatArray, SuperLU | None]:
    """Scale and LU of the core's matrix.

    It is symmetric and positive definite, so no pivoting is needed and minimum degree ordering
    serves; the unit diagonal keeps errors small row by row, though conductances span many orders.
    """
    count = len(ground)
    diagonal = ground + _summed(first, conductance, count) + _summed(last, conductance, count)
    scale = 1.0 / np.sqrt(diagonal)
    if len(first) == 0:
        return scale, None
    off = -conductance * scale[first] * scale[last]
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


def _summed(where: IntArray, values: FloatArray, count: int) -> FloatArray:
    return np.asarray(np.bincount(where, weights=values, minlength=count), dtype=np.float64)
