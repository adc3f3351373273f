"""Measure tissue supply at sampled points: distance to lumens, vessels per area, oxygen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.errors import TissueError
from design.measures.lumens import build_lumens, nearest_walls, z_order
from design.measures.oxygen import Oxygen, OxygenModel, krogh_oxygen
from design.tissue import Tissue
from kernels.arrays import FloatArray

BEYOND_UM: Final = (20.0, 100.0, 150.0, 200.0)
"""Distances beyond which the tissue's share is told: cells live within 100 to 200 µm of a
vessel, in demanding tissue within 20 µm."""

_DRAWS_AT_MOST = 2000

_STREAM = 0x6D656173
"""Keeps the points apart from those that a tree was grown to with the same seed: sampled where
its terminals are, every one of them would count as tissue reached."""


@dataclass(frozen=True)
class Supply:
    """Tissue around lumens, from points sampled uniformly in it.

    Points within a lumen count for `lumen_fraction` and are no tissue otherwise. A lumen ends in
    a hemisphere of its own radius.

    Attributes
    ----------
    samples : int
        Points in the tissue, outside lumens; shares have a standard error of √(p (1 - p) / n).
    lumen_fraction : float
        Share of the tissue's volume within lumens.
    distance_mean_mm, distance_p95_mm, distance_max_mm : float, mm
        From the nearest lumen wall; the largest is the largest sampled.
    beyond : tuple of float
        Share of the tissue farther from a wall than each of `BEYOND_UM`.
    length_mm : float, mm
        Of the lumens' axes, what lies outside the tissue included.
    sections_per_mm2 : (float, float, float), 1/mm²
        Axes that cross a plane normal to x, y and z per area of tissue in it, over all such
        planes: Σ|Δx|/V, since the crossings of all planes add up to Σ|Δx| and their areas to V.
    vessels_per_mm2 : float, 1/mm²
        The same over planes of all directions: half the length per volume (stereology's
        Q_A = L_V / 2).
    oxygen : Oxygen
    """

    samples: int
    lumen_fraction: float
    distance_mean_mm: float
    distance_p95_mm: float
    distance_max_mm: float
    beyond: tuple[float, ...]
    length_mm: float
    sections_per_mm2: tuple[float, float, float]
    vessels_per_mm2: float
    oxygen: Oxygen


def sample_tissue(tissue: Tissue, count: int, seed: int) -> FloatArray:
    """``count`` points uniform in the tissue, (n, 3), mm, neighbours in space near each other.

    Raises
    ------
    TissueError
        When the tissue fills next to nothing of its bounds.
    """
    random = np.random.default_rng([_STREAM, seed])
    low, high = tissue.bounds
    kept: list[FloatArray] = []
    inside = 0
    for _ in range(_DRAWS_AT_MOST):
        drawn = random.uniform(low, high, (count, 3))
        kept.append(drawn[tissue.contains(drawn)])
        inside += len(kept[-1])
        if inside >= count:
            points = np.concatenate(kept)[:count]
            return np.ascontiguousarray(points[np.argsort(z_order(points), kind="stable")])
    raise TissueError(
        f"only {inside} of {count * _DRAWS_AT_MOST:,} points drawn in the tissue's bounds lie in "
        f"it, {count:,} are wanted; lower samples"
    )


def measure_supply(
    pieces: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    points: FloatArray,
    volume_mm3: float,
    model: OxygenModel,
) -> Supply | None:
    """Measure the supply of the tissue that ``points`` (n, 3) sample; None without any tissue.

    Parameters
    ----------
    pieces : (start (k, 3), end (k, 3), start radius (k,), end radius (k,)), mm
        At least one.
    points : (n, 3) float64, mm
        Uniform in the tissue.
    volume_mm3 : float
        The tissue's, lumens included.
    model : OxygenModel
    """
    distance, radius = nearest_walls(build_lumens(*pieces), points)
    outside = distance >= 0.0
    if not outside.any():
        return None
    distance, radius = distance[outside], radius[outside]
    step = np.abs(pieces[1] - pieces[0])
    length = float(np.linalg.norm(step, axis=1).sum())
    across = step.sum(axis=0) / volume_mm3
    share = float(outside.mean())
    return Supply(
        samples=len(distance),
        lumen_fraction=1.0 - share,
        distance_mean_mm=float(distance.mean()),
        distance_p95_mm=float(np.percentile(distance, 95.0)),
        distance_max_mm=float(distance.max()),
        beyond=tuple(float((distance > 1e-3 * limit).mean()) for limit in BEYOND_UM),
        length_mm=length,
        sections_per_mm2=(float(across[0]), float(across[1]), float(across[2])),
        vessels_per_mm2=0.5 * length / volume_mm3,
        oxygen=krogh_oxygen(distance, radius, share * volume_mm3 / length, model),
    )
