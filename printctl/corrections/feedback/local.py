"""Estimate diameter excess of single vessels and shifts of single nodes, over several prints.

Each is shrunk by how unsure it is (empirical Bayes, e.g. Efron & Morris 1975,
10.1080/01621459.1975.10479864): how much vessels really differ is estimated from all of them, and
each keeps the share τ² / (τ² + σ²) of what was measured of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, stdtrit

from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.corrections.feedback.evidence import LEAST_SECTIONS, Reading
from printctl.corrections.feedback.whole_part import (
    NORMAL_95,
    OFFSET_VOXELS,
    VESSEL_VOXELS,
    Radial,
    projector_across,
)

_STEPS = 50

ACCIDENT = 0.01
"""Probability that, of vessels which all repeat alike, one is taken for an accident's."""


@dataclass(frozen=True)
class Local:
    """Excess width of a single vessel.

    Attributes
    ----------
    vessel : int
    excess_mm, half_mm : float, mm
        Beyond what all have in common, and the half width of its 95 % interval.
    kept : float
        Share left by shrinkage; 0 where the interval includes 0.
    """

    vessel: int
    excess_mm: float
    half_mm: float
    kept: float


def local_excess(
    prints: Sequence[dict[int, Reading]], common: Radial, voxel_mm: float
) -> tuple[Local, ...]:
    """Excess of each vessel's diameter beyond the common one, pooled over prints."""
    table = _table(prints, common)
    vessels = sorted(table)
    if not vessels:
        return ()
    means = np.array([np.mean([value for value, _ in table[v]]) for v in vessels])
    errors, times = _errors([table[v] for v in vessels])
    errors = np.hypot(errors, VESSEL_VOXELS * voxel_mm)
    prior = _prior(means, errors)
    half = times * errors
    kept = np.where(np.abs(means) > half, prior / (prior + errors**2), 0.0)
    return tuple(
        Local(vessel, float(mean), float(wide), float(share))
        for vessel, mean, wide, share in zip(vessels, means, half, kept, strict=True)
    )


def _prior(means: FloatArray, errors: FloatArray) -> float:
    """Variance τ² of the vessels, by moments, each weighted by how well it is known.

    One that had an accident says little of how much the others differ.
    """
    variance = 0.0
    for _ in range(_STEPS):
        weight = 1 / (variance + errors**2) ** 2
        variance = max(0.0, float((weight * (means**2 - errors**2)).sum() / weight.sum()))
    return variance


def _table(
    prints: Sequence[dict[int, Reading]], common: Radial
) -> dict[int, list[tuple[float, float]]]:
    """Residual and error of each vessel in each print; what a whole print has too much is out."""
    table: dict[int, list[tuple[float, float]]] = {}
    for readings in prints:
        over = {
            v: r.excess_mm - common.of(r.diameter_mm)
            for v, r in readings.items()
            if r.sections >= LEAST_SECTIONS
        }
        middle = float(np.median(list(over.values()))) if over else 0.0
        for vessel, value in over.items():
            table.setdefault(vessel, []).append((value - middle, readings[vessel].error_mm))
    return table


def _errors(rows: Sequence[Sequence[tuple[float, float]]]) -> tuple[FloatArray, float]:
    """Standard error of each vessel's mean, and the factor to a 95 % interval.

    Of several prints by their spread, pooled over the vessels or the vessel's own, whichever is
    larger; never below what the sections' scatter makes it. Accidents aren't pooled.
    """
    count = np.array([len(row) for row in rows])
    own = np.array([np.sqrt(np.mean([e**2 for _, e in row])) for row in rows]) / np.sqrt(count)
    apart = np.array([_variance([v for v, _ in row]) for row in rows])
    usual = repeating(apart, count - 1)
    free = int((count - 1)[usual].sum())
    if free == 0:
        return own, NORMAL_95
    between = float((apart * (count - 1))[usual].sum()) / free
    # One print's accident isn't thinned by all the vessels that had none.
    spread = np.sqrt(np.maximum(apart, between) / count)
    return np.maximum(own, spread), -float(stdtrit(free, 0.025))


def repeating(variance: FloatArray, free: IntArray) -> BoolArray:
    """Which vessels vary from print to print as the others do; the rest had accidents.

    Cochran's test of the largest variance, repeated, in its form for unequal counts (the largest
    against all others by the F distribution, Bonferroni; ISO 5725-2:2019, 7.3.3; 't Lam 2010,
    10.1016/j.jspi.2009.09.010).

    Parameters
    ----------
    variance : (n,) float64
    free : (n,) int64
        Degrees of freedom of each: prints less one.
    """
    kept = np.ones(len(variance), dtype=np.bool_)
    while True:
        worst = int(np.argmax(np.where(kept & (free > 0), variance, -1.0)))
        rest = kept.copy()
        rest[worst] = False
        others = int(free[rest].sum())
        if others == 0 or free[worst] == 0:
            return kept
        ratio = variance[worst] / max(float((variance * free)[rest].sum()) / others, 1e-12)
        if kept.sum() * float(fdtrc(free[worst], others, ratio)) > ACCIDENT:
            return kept
        kept = rest


def _variance(values: Sequence[float]) -> float:
    return float(np.var(values, ddof=1)) if len(values) > 1 else 0.0


@dataclass(frozen=True)
class NodeOffset:
    """Offset of a single node.

    Attributes
    ----------
    node : int
    offset_mm, half_mm : (3,) float64, mm
        Shrunk, and half widths of 95 % intervals.
    """

    node: int
    offset_mm: FloatArray
    half_mm: FloatArray


def node_offsets(
    network: VesselNetwork, prints: Sequence[dict[int, Reading]], voxel_mm: float
) -> tuple[NodeOffset, ...]:
    """Where nodes went, from the offsets of the vessels that meet there.

    A vessel tells its offset across itself only: of each it counts as the plane across its end.
    What nobody tells (along a lone vessel) stays 0.
    """
    matrix, pull = _equations(network, prints, voxel_mm)
    nodes = np.flatnonzero(np.trace(matrix, axis1=1, axis2=2) > 0)
    if len(nodes) == 0:
        return ()
    variance = np.full(3, 1e-4)
    for _ in range(_STEPS):  # expectation maximisation of the nodes' variances, depth by itself
        spread = np.linalg.inv(matrix[nodes] + np.diag(1 / variance))
        mean = np.einsum("nij,nj->ni", spread, pull[nodes])
        size = np.maximum((mean**2 + spread[:, range(3), range(3)]).mean(axis=0), 1e-12)
        variance = np.array([size[:2].mean(), size[:2].mean(), size[2]])
    half = NORMAL_95 * np.sqrt(spread[:, range(3), range(3)])
    return tuple(NodeOffset(int(n), m, h) for n, m, h in zip(nodes, mean, half, strict=True))


def _equations(
    network: VesselNetwork, prints: Sequence[dict[int, Reading]], voxel_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Normal matrix (m, 3, 3) and right side (m, 3) of each node."""
    measured: dict[tuple[int, int], list[tuple[FloatArray, float]]] = {}
    for readings in prints:
        for vessel, reading in readings.items():
            if reading.ends_mm is not None:
                for end in (0, 1):
                    error = float(reading.ends_error_mm[end])
                    measured.setdefault((vessel, end), []).append((reading.ends_mm[end], error))
    between = _between([[offset for offset, _ in rows] for rows in measured.values()])
    matrix = np.zeros((len(network.nodes), 3, 3))
    pull = np.zeros((len(network.nodes), 3))
    for (vessel, end), rows in measured.items():
        own = float(np.mean([error**2 for _, error in rows]))
        apart = _between([[offset for offset, _ in rows]])
        square = max(own, between, apart) / len(rows) + (OFFSET_VOXELS * voxel_mm) ** 2
        plane = projector_across(network, vessel, end) / square
        node = network.vessel_nodes[vessel, end]
        matrix[node] += plane
        pull[node] += plane @ np.mean([offset for offset, _ in rows], axis=0)
    return matrix, pull


def _between(rows: Sequence[Sequence[FloatArray]]) -> float:
    """Variance from print to print of an offset's component, pooled; 0 of single prints."""
    free = sum(2 * (len(row) - 1) for row in rows)
    if free == 0:
        return 0.0
    return sum(float(np.var(row, axis=0).sum()) * len(row) for row in rows) / free
