"""Solve node pressures in a graph's looped core: fold chains, then factorise what is left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import SuperLU, splu

from design.errors import FlowError
from design.hemodynamics.zero_d.nodal.chains import (
    Chains,
    fold_chains,
    gather_chains,
    unfold_chains,
)
from kernels.arrays import IntArray

Numbers = NDArray[Any]


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
        gather_chains(p.order, p.neighbour, self.share, source)
        right = self.scale * source[p.left]
        value[p.left] = self.scale * (self.factors.solve(right) if self.factors else right)
        unfold_chains(p.order, p.neighbour, self.share, self.total, source, value)
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
    share, total = fold_chains(plan.order, plan.neighbour, plan.link, plan.onto, weight, ground)
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
