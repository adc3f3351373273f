"""Measure tissue supply at sampled points: distance to lumens, vessels per area, oxygen."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from design.errors import DesignError, TissueError
from design.geometry.bvh import DEPTH, build_hierarchy
from design.tissue import Tissue
from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray

BEYOND_UM: Final = (20.0, 100.0, 150.0, 200.0)
"""Distances beyond which the tissue's share is reported: cells live within 100 to 200 µm of a
vessel, in demanding tissue within 20 µm."""
MAX_DRAWS: Final = 2000
"""Batches drawn in the bounds before a tissue counts as too thin to sample (0.05 % of them)."""
Z_ORDER_BITS: Final = 16
"""Of each coordinate on the Z-order curve: 48 bits fit an int64."""
SAMPLE_STREAM: Final = int.from_bytes(b"meas")
"""Separates the points from those to which a tree was grown with the same seed."""


@dataclass(frozen=True)
class OxygenModel:
    """What the cells breathe. The defaults are estimates, to be replaced by a lab's own.

    Attributes
    ----------
    lumen_millimolar : float, mol/m³
        Oxygen at every lumen wall; medium in equilibrium with air at 37 °C holds about 0.2.
    cells_per_ml : float
        10⁸ is within the range of organs, and ten times that of most cell-laden gels.
    mol_per_cell_s : float, mol/s
        Taken up by a cell.
    diffusivity_mm2_s : float, mm²/s
        Of oxygen in the tissue; some 3e-3 in water at 37 °C.
    """

    lumen_millimolar: float = 0.2
    cells_per_ml: float = 1e8
    mol_per_cell_s: float = 5e-17
    diffusivity_mm2_s: float = 2e-3

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise DesignError(f"oxygen: {field.name} is {value:g}; give a value above 0")

    @property
    def uptake_millimolar_s(self) -> float:
        """Oxygen taken up per volume of tissue, mM/s."""
        # mol/(mL s) is 10⁶ mM/s.
        return self.cells_per_ml * self.mol_per_cell_s * 1e6


@dataclass(frozen=True)
class Oxygen:
    """Oxygen at the tissue's sampled points.

    Attributes
    ----------
    model : OxygenModel
    cylinder_mm : float, mm
        Radius of a tissue cylinder around a thin lumen, √(V / π L).
    mean_millimolar, p5_millimolar, least_millimolar : float, mM
        Anoxic points count as 0.
    anoxic : float
        Share of the tissue that the model leaves without oxygen.
    """

    model: OxygenModel
    cylinder_mm: float
    mean_millimolar: float
    p5_millimolar: float
    least_millimolar: float
    anoxic: float


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
    random = np.random.default_rng([SAMPLE_STREAM, seed])
    low, high = tissue.bounds
    kept: list[FloatArray] = []
    inside = 0
    for _ in range(MAX_DRAWS):
        drawn = random.uniform(low, high, (count, 3))
        kept.append(drawn[tissue.contains(drawn)])
        inside += len(kept[-1])
        if inside >= count:
            points = np.concatenate(kept)[:count]
            return np.ascontiguousarray(points[np.argsort(z_order(points), kind="stable")])
    raise TissueError(
        f"only {inside} of {count * MAX_DRAWS:,} points drawn in the tissue's bounds lie in "
        f"it, {count:,} are wanted; lower samples"
    )


def z_order(points: FloatArray) -> NDArray[np.int64]:
    """Place of each of ``points`` (n, 3) on a Z-order curve of 65,536 cells a side."""
    low = points.min(axis=0)
    extent = max(float((points.max(axis=0) - low).max()), 1e-300)
    cell = ((points - low) * ((2**Z_ORDER_BITS - 1) / extent)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(Z_ORDER_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


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


def krogh_erlang(
    radius: FloatArray, lumen: FloatArray, cylinder: FloatArray, model: OxygenModel
) -> FloatArray:
    """Oxygen at ``radius`` (n,) from the axis of a lumen in its tissue cylinder, mM.

    c(r) = c₀ - M / (4 D) · (2 R² ln(r / a) - r² + a²): steady, uptake M whatever the
    concentration, c₀ at the wall r = a, no flux through r = R (Krogh 1919, J Physiol 52, 409,
    doi 10.1113/jphysiol.1919.sp001839, with Erlang's formula). Holds for a ≤ r ≤ R; negative
    where the oxygen doesn't reach.

    Parameters
    ----------
    radius, lumen, cylinder : (n,) float64, mm
        r, a and R.
    model : OxygenModel
    """
    scale = model.uptake_millimolar_s / (4.0 * model.diffusivity_mm2_s)
    falls = 2.0 * cylinder**2 * np.log(radius / lumen) - radius**2 + lumen**2
    oxygen: FloatArray = model.lumen_millimolar - scale * falls
    return oxygen


def krogh_oxygen(
    distance: FloatArray, lumen: FloatArray, area_mm2: float, model: OxygenModel
) -> Oxygen:
    """Estimate the oxygen of tissue points from their nearest lumen alone.

    Every lumen feeds a cylinder of the same cross-section of tissue, ``area_mm2``: the tissue's
    volume over the lumens' length. A point beyond its cylinder is taken to lie on the rim of one
    that reaches it. Not modelled: oxygen used up along the vessels, help from the lumens beyond
    the nearest, uptake that falls with the concentration.

    Parameters
    ----------
    distance : (n,) float64, mm
        Of the points from the nearest wall, at least 0.
    lumen : (n,) float64, mm
        Radius of that lumen.
    area_mm2 : float, mm²
    model : OxygenModel
    """
    radius = lumen + distance
    cylinder = np.maximum(np.sqrt(lumen**2 + area_mm2 / np.pi), radius)
    oxygen = krogh_erlang(radius, lumen, cylinder, model)
    kept = np.maximum(oxygen, 0.0)
    return Oxygen(
        model=model,
        cylinder_mm=float(np.sqrt(area_mm2 / np.pi)),
        mean_millimolar=float(kept.mean()),
        p5_millimolar=float(np.percentile(kept, 5.0)),
        least_millimolar=float(kept.min()),
        anoxic=float((oxygen <= 0.0).mean()),
    )


class Lumens(NamedTuple):
    """Conical pieces of lumens in the order of a tree of boxes (`design.geometry.bvh`).

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    start_radius, end_radius : (n,) float64, mm
    boxes : (k, 6) float64, mm
    nodes : (k, 2) int64
        As `build_hierarchy` returns them.
    """

    start: FloatArray
    end: FloatArray
    start_radius: FloatArray
    end_radius: FloatArray
    boxes: FloatArray
    nodes: IntArray


def build_lumens(
    start: FloatArray, end: FloatArray, start_radius: FloatArray, end_radius: FloatArray
) -> Lumens:
    """Sort pieces (n, 3), mm, with radii at both ends (n,), mm, into a tree; n is above 0."""
    ra, rb = start_radius[:, None], end_radius[:, None]
    low, high = np.minimum(start - ra, end - rb), np.maximum(start + ra, end + rb)
    boxes, nodes, order = build_hierarchy(np.concatenate([low, high], axis=1))
    return Lumens(start[order], end[order], start_radius[order], end_radius[order], boxes, nodes)


@jit
def wall_distance(lumens: Any, i: int, x: float, y: float, z: float) -> tuple[float, float]:
    """Distance of a point from the wall of piece ``i``, and the lumen's radius there, mm.

    The lumen is the union of spheres along the axis whose radius goes linearly from one end to
    the other; inside it the distance is negative. With ξ along the axis, η from it and slope
    s = (r₁ - r₀)/ℓ the nearest sphere is at ξ + η s / √(1 - s²), clipped to the piece: the
    distance from a sphere's surface is convex in its place.
    """
    ax, ay, az = lumens.start[i]
    ra, rb = lumens.start_radius[i], lumens.end_radius[i]
    ux, uy, uz = lumens.end[i, 0] - ax, lumens.end[i, 1] - ay, lumens.end[i, 2] - az
    px, py, pz = x - ax, y - ay, z - az
    length = sqrt(ux * ux + uy * uy + uz * uz)
    if length <= 0.0:
        r = max(ra, rb)
        return sqrt(px * px + py * py + pz * pz) - r, r
    along = (px * ux + py * uy + pz * uz) / length
    cx, cy, cz = py * uz - pz * uy, pz * ux - px * uz, px * uy - py * ux
    across = sqrt(cx * cx + cy * cy + cz * cz) / length
    slope = (rb - ra) / length
    at = length if slope > 0.0 else 0.0
    if abs(slope) < 1.0:
        at = along + across * slope / sqrt(1.0 - slope * slope)
        at = min(length, max(0.0, at))
    r = ra + slope * at
    return sqrt((along - at) ** 2 + across * across) - r, r


@jit
def _box_distance(boxes: Any, node: int, x: float, y: float, z: float) -> float:
    """Return a lower bound of the distance to walls in a box; -inf within it."""
    dx = max(0.0, max(boxes[node, 0] - x, x - boxes[node, 3]))
    dy = max(0.0, max(boxes[node, 1] - y, y - boxes[node, 4]))
    dz = max(0.0, max(boxes[node, 2] - z, z - boxes[node, 5]))
    away = dx * dx + dy * dy + dz * dz
    return sqrt(away) if away > 0.0 else -np.inf


@jit
def _nearest(lumens: Any, x: float, y: float, z: float) -> tuple[float, float]:
    best, radius = np.inf, 0.0
    stack, bound = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    stack[0], bound[0] = 0, -np.inf
    top = 1
    while top > 0:
        top -= 1
        if bound[top] >= best:
            continue
        near, far = lumens.nodes[stack[top]]
        if near < 0:
            for i in range(-1 - near, far):
                away, r = wall_distance(lumens, i, x, y, z)
                if away < best:
                    best, radius = away, r
            continue
        to_near = _box_distance(lumens.boxes, near, x, y, z)
        to_far = _box_distance(lumens.boxes, far, x, y, z)
        if to_far < to_near:
            near, far, to_near, to_far = far, near, to_far, to_near
        stack[top], bound[top] = far, to_far
        stack[top + 1], bound[top + 1] = near, to_near
        top += 2
    return best, radius


@pjit
def nearest_walls(lumens: Any, points: Any) -> Any:
    """Distance of each of ``points`` (n, 3) from the nearest wall, and the radius there, mm.

    Negative within a lumen. Neighbours in ``points`` that are neighbours in space find the tree
    in the cache.
    """
    distance = np.empty(len(points))
    radius = np.empty(len(points))
    for i in prange(len(points)):
        distance[i], radius[i] = _nearest(lumens, points[i, 0], points[i, 1], points[i, 2])
    return distance, radius
