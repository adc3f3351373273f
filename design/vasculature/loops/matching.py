"""Which arterial terminal is joined to which venous one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching
from scipy.spatial import KDTree

from design.errors import GrowthError
from design.tissue import Tissue

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NEAREST = 12
"""Candidates of each terminal at first; doubled until all can be matched."""

ACROSS = 4.0
"""Factor on the distance of two terminals between which the straight way leaves the tissue."""


def match_terminals(tissue: Tissue, one: FloatArray, other: FloatArray) -> IntArray:
    """Match points one to one with the least sum of squared distances, within sparse candidates.

    Squares keep the longest short: plain distances leave a few pairs far apart.

    Each point's candidates are its nearest of the other side, and it theirs. A pair whose
    straight connection leaves the tissue counts `ACROSS` times its distance.

    Parameters
    ----------
    one, other : (n, 3) float64, mm

    Returns
    -------
    (n,) int64
        Index into ``other`` for each of ``one``.

    Raises
    ------
    GrowthError
        When the numbers differ.
    """
    count = len(one)
    if len(other) != count:
        raise GrowthError(
            f"{count} arterial terminals can't be matched to {len(other)} venous ones; grow both "
            "sides with the same number of terminals"
        )
    nearest = NEAREST
    while True:
        weight = _candidates(tissue, one, other, min(nearest, count))
        try:
            rows, columns = min_weight_full_bipartite_matching(weight)
        except ValueError:
            # SciPy's word for: these candidates allow no full matching.
            if nearest >= count:
                raise
            nearest *= 2
            continue
        partner = np.empty(count, dtype=np.int64)
        partner[rows] = columns
        return partner


def _candidates(tissue: Tissue, one: FloatArray, other: FloatArray, nearest: int) -> csr_array:
    count = len(one)
    every = np.repeat(np.arange(count), nearest)
    _, forth = KDTree(other).query(one, k=nearest)
    _, back = KDTree(one).query(other, k=nearest)
    pairs = np.concatenate(
        [np.column_stack([every, np.ravel(forth)]), np.column_stack([np.ravel(back), every])]
    )
    pairs = np.unique(pairs, axis=0)
    start, end = one[pairs[:, 0]], other[pairs[:, 1]]
    apart = np.linalg.norm(end - start, axis=1)
    leaves = ~tissue.grid.capsule_inside(start, end, np.zeros(len(start)))
    # Explicit zeros would read as missing candidates.
    cost = np.maximum(apart * np.where(leaves, ACROSS, 1.0), 1e-9) ** 2
    return csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
