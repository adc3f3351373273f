"""Match arterial with venous terminals one to one, with least total distance."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching, min_weight_full_bipartite_matching
from scipy.spatial import KDTree

from design.errors import GrowthError
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray

NEAREST = 12
"""Candidates of each terminal at first; doubled until all can be matched."""

TOO_NEAR = 4.0
"""Weight of what a pair lacks of the least distance."""

ACROSS = 4.0
"""Factor on the distance of two terminals between which the straight way leaves the tissue."""


def match_terminals(
    tissue: Tissue, one: FloatArray, other: FloatArray, nearest_mm: float = 0.0
) -> IntArray:
    """Match points one to one with the least sum of distances, within sparse candidates.

    Squared distances would keep the longest shorter, but where one side is denser than the other
    they make all connections in between long, which then are in each other's way. A pair nearer
    than ``nearest_mm`` counts for that and `TOO_NEAR` times what it lacks: no curve that is wide
    enough turns in so little room. Where the straight connection leaves the tissue, a pair counts
    `ACROSS` times its distance.

    Each point's candidates are its nearest of the other side, and it theirs.

    Parameters
    ----------
    one, other : (n, 3) float64, mm
    nearest_mm : float
        Least distance of a pair that isn't avoided.

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
        weight = _candidates(tissue, one, other, min(nearest, count), nearest_mm)
        # Asked first: without a full matching the search for the cheapest runs for minutes.
        if np.any(maximum_bipartite_matching(weight, "column") < 0):
            nearest *= 2
            continue
        rows, columns = min_weight_full_bipartite_matching(weight)
        partner = np.empty(count, dtype=np.int64)
        partner[rows] = columns
        return partner


def _candidates(
    tissue: Tissue, one: FloatArray, other: FloatArray, nearest: int, nearest_mm: float
) -> csr_array:
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
    apart = np.where(apart < nearest_mm, nearest_mm + TOO_NEAR * (nearest_mm - apart), apart)
    leaves = ~tissue.grid.capsule_inside(start, end, np.zeros(len(start)))
    # Explicit zeros would read as missing candidates.
    cost = np.maximum(apart * np.where(leaves, ACROSS, 1.0), 1e-9)
    return csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
