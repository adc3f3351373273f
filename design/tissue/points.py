"""Reconstruct a closed surface from a point cloud: partition of unity of local quadratics.

Around each point the surface is a quadratic height over the tangent plane, fitted to its
neighbours (and to their normals, where they are given); the local functions, blended by compact
weights (Ohtake et al. 2003, doi 10.1145/882262.882293, who blend over cells instead), are sampled
on a lattice finer than the points' spacing, and the surface is where the blend is 0. Places that no
point reaches take the sign around them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, find_objects, label
from scipy.spatial import cKDTree

from design.errors import TissueError
from design.geometry import build_triangle_tree, nearest_distances
from design.geometry.polyline import vectors_across
from design.geometry.surface import Surface
from design.tissue.blend import blend
from design.tissue.closed import format_points
from design.tissue.isosurface import isosurface
from design.tissue.load import check_file
from design.tissue.manifolds import distinct_manifold, surface_of
from design.tissue.normals import estimate_normals
from design.tissue.point_files import POINT_SUFFIXES, read_points
from design.tissue.shells import shells_of
from design.tissue.surface import SizeLimits, check_size
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray

_LEAST = 100
_NEIGHBOURS = 14
_REACH = 2.0
"""Of a local function, in spacings around its point."""

_SAME_SIDE = 0.5
"""Least cosine between normals fitted together; what looks elsewhere is beyond an edge."""

_STEEPEST = np.array([0.5, 0.5, 0.5, 0.12, 0.12, 0.12])
"""Bounds of a height's coefficients, lengths in spacings: beyond an edge a fit says nothing, and
bends tighter than four spacings aren't resolved."""

_NODES = 40_000_000
_CELLS_PER_SPACING = 1.5
_FAR = 1.6
"""Spacings from the nearest point beyond which the surface is made up."""

_MADE_UP = 0.05
"""Largest share of the surface that may be."""

_NOTED = 0.002
_SIMPLIFY = 0.02


@dataclass(frozen=True)
class Cloud:
    """Points with what lies around each.

    Attributes
    ----------
    points, normals : (n, 3) float64, mm
    neighbours : (n, k) int64
    spacing : (n,) float64, mm
        Mean distance between points there, from the density of the neighbours.
    """

    points: FloatArray
    normals: FloatArray
    neighbours: NDArray[np.int64]
    spacing: FloatArray


def load_point_surface(
    path: Path, unit: LengthUnit, *, limits: SizeLimits | None = None
) -> tuple[Surface, tuple[str, ...]]:
    """Read points of a surface (PLY, XYZ, TXT, CSV) and lay a closed surface through them, in mm.

    Parameters
    ----------
    path : Path
    unit : {"um", "mm", "cm", "m", "in"}
        Of the coordinates; never guessed.
    limits : SizeLimits, optional

    Returns
    -------
    Surface
    notes : tuple of str
        The points' spacing, how far they are from the surface, whether normals were estimated.

    Raises
    ------
    TissueError
        When the file can't be used, or the points leave gaps.
    """
    path = Path(path)
    check_file(path, unit, POINT_SUFFIXES)
    points, normals = read_points(path)
    try:
        check_size(points, unit, limits or SizeLimits())
        surface, notes = point_surface(points * MM_PER[unit], normals)
    except TissueError as error:
        raise TissueError(f"{path}: {error}") from error
    return surface, tuple(f"{path.name}: {note}" for note in notes)


def point_surface(
    points: FloatArray, normals: FloatArray | None = None
) -> tuple[Surface, tuple[str, ...]]:
    """Closed surface through points (n, 3), mm, with outward ``normals`` (n, 3) or without.

    Raises
    ------
    TissueError
        When there are too few points, normals are 0 or NaN, or the points leave gaps.
    """
    cloud, notes = _cloud(points, normals)
    height = _fit(cloud, hermite=normals is not None)
    origin, h, shape = _lattice(cloud)
    total, weight = np.zeros(shape), np.zeros(shape)
    frame = _frames(cloud.normals)
    reach = np.maximum(_REACH * cloud.spacing, 2.0 * h)
    blend(cloud.points, frame, height, reach, origin, h, total, weight)
    shell = isosurface(-_filled(total, weight, h), 0.0)
    surface = Surface(shell.vertices * h + origin, shell.faces)
    kept, more = _checked(surface, cloud)
    notes += more
    solid = distinct_manifold(kept, "the surface of the points")
    typical = float(np.median(cloud.spacing))
    final = surface_of(solid.simplify(_SIMPLIFY * typical), "the surface of the points")
    away = nearest_distances(build_triangle_tree(final.vertices, final.faces), cloud.points)
    notes.append(
        f"surface laid through {len(cloud.points)} points about {typical:.3g} mm apart; they lie "
        f"{1e3 * np.sqrt(np.mean(away**2)):.3g} µm (rms) and at most {1e3 * away.max():.3g} µm "
        "from it"
    )
    return final, tuple(notes)


def _cloud(points: FloatArray, normals: FloatArray | None) -> tuple[Cloud, list[str]]:
    """Distinct points, their neighbours, spacing and unit normals."""
    places, first = np.unique(points, axis=0, return_index=True)
    if len(places) < _LEAST:
        raise TissueError(f"{len(places)} points aren't a surface; give at least {_LEAST}")
    away, near = cKDTree(places).query(places, _NEIGHBOURS + 1)
    neighbours = near[:, 1:].astype(np.int64)
    # Of a plane with points d apart, k lie within d √(k / π).
    spacing = away[:, -1] * np.sqrt(np.pi / _NEIGHBOURS)
    if normals is None:
        directions, parts = estimate_normals(places, neighbours)
        notes = ["points have no normals; they were estimated, each part's looking outward"]
        if parts > 1:
            notes.append(
                f"points fall into {parts} separate parts; if one is a cavity's, give normals"
            )
        return Cloud(places, directions, neighbours, spacing), notes
    length = np.linalg.norm(normals[first], axis=1)
    if not (np.isfinite(length).all() and (length > 0).all()):
        bad = np.flatnonzero(~(np.isfinite(length) & (length > 0)))
        raise TissueError(
            f"{len(bad)} normals are 0 or NaN ({format_points(places[bad])}); "
            "mend or leave them out"
        )
    return Cloud(places, normals[first] / length[:, None], neighbours, spacing), []


def _frames(normals: FloatArray) -> FloatArray:
    """Two tangents and the normal of each point, (n, 3, 3), as rows."""
    return np.stack([*vectors_across(normals), normals], axis=1)


def _fit(cloud: Cloud, hermite: bool) -> FloatArray:
    """Heights' coefficients (n, 6) by weighted least squares; lengths in spacings while solving.

    Each neighbour's height counts and, with ``hermite``, its normal's slope as well.
    """
    frame, s = _frames(cloud.normals), cloud.spacing
    there = np.concatenate([np.arange(len(s))[:, None], cloud.neighbours], axis=1)
    offset = (cloud.points[there] - cloud.points[:, None]) / s[:, None, None]
    u, v, w = (np.einsum("nki,ni->nk", offset, frame[:, axis]) for axis in range(3))
    nu, nv, nw = (np.einsum("nki,ni->nk", cloud.normals[there], frame[:, a]) for a in range(3))
    weight = np.exp(-0.25 * (offset**2).sum(axis=2))
    weight *= np.clip((nw - _SAME_SIDE) / (1.0 - _SAME_SIDE), 0.0, 1.0)
    zero, one = np.zeros_like(u), np.ones_like(u)
    rows = [np.stack([one, u, v, u * u, u * v, v * v], axis=2)]
    aims, weights = [w], [weight]
    if hermite:
        slope = np.maximum(nw, _SAME_SIDE)
        rows.append(np.stack([zero, one, zero, 2 * u, v, zero], axis=2))
        rows.append(np.stack([zero, zero, one, zero, u, 2 * v], axis=2))
        aims += [-nu / slope, -nv / slope]
        weights += [0.5 * weight, 0.5 * weight]
    a, b, p = (np.concatenate(parts, axis=1) for parts in (rows, aims, weights))
    left = np.einsum("nki,nk,nkj->nij", a, p, a) + 1e-6 * np.eye(6)
    right = np.einsum("nki,nk,nk->ni", a, p, b)
    solved: FloatArray = np.linalg.solve(left, right[..., None])[..., 0]
    coefficients = np.clip(solved, -_STEEPEST, _STEEPEST)
    return coefficients * np.stack([s, one[:, 0], one[:, 0], 1 / s, 1 / s, 1 / s], axis=1)


def _lattice(cloud: Cloud) -> tuple[FloatArray, float, tuple[int, int, int]]:
    """Origin, spacing and size of the lattice."""
    margin = (_REACH + 1.0) * float(cloud.spacing.max())
    low, high = cloud.points.min(axis=0) - margin, cloud.points.max(axis=0) + margin
    typical = float(np.percentile(cloud.spacing, 20))
    h = typical / _CELLS_PER_SPACING
    count = float(np.prod((high - low) / h + 2))
    if count > _NODES:
        h *= (count / _NODES) ** (1 / 3)
    if h > typical:
        raise TissueError(
            f"points {typical:.3g} mm apart need a lattice of {count:.2g} nodes, above "
            f"{_NODES:.2g}; thin the points out or cut the cloud into parts"
        )
    size = np.ceil((high - low) / h).astype(int) + 2
    return low, h, (int(size[0]), int(size[1]), int(size[2]))


def _filled(total: FloatArray, weight: FloatArray, h: float) -> FloatArray:
    """The blend, negative inside, with the sign of what is around where no point reaches."""
    covered = weight > 0
    value = np.divide(total, weight, out=np.full_like(total, np.inf), where=covered)
    parts, count = label(~covered)
    outer = int(parts[0, 0, 0])
    if count == 0 or outer == 0:
        raise TissueError("points leave no outside around them; check for stray points")
    if (value[covered & binary_dilation(parts == outer)] < 0).mean() > 0.5:
        # The normals look inward.
        value = np.where(covered, -value, value)
    for part, box in enumerate(find_objects(parts), start=1):
        if part != outer:
            around = tuple(slice(max(0, side.start - 1), side.stop + 1) for side in box)
            here = parts[around] == part
            rim = covered[around] & binary_dilation(here)
            value[around][here] = -np.inf if (value[around][rim] < 0).mean() > 0.5 else np.inf
    return np.clip(value, -4.0 * h, 4.0 * h)


def _checked(surface: Surface, cloud: Cloud) -> tuple[Surface, list[str]]:
    """The shells that points lie on, and a note where they are made up; raises if too much is.

    At the far end of its reach a quadratic may bend back through 0: such shells have no points.
    """
    if len(surface.faces) == 0:
        raise TissueError("points enclose nothing; check them, and that their normals agree")
    middle = surface.vertices[surface.faces].mean(axis=1)
    away, near = cKDTree(cloud.points).query(middle)
    far = away / cloud.spacing[near]
    shell = shells_of(surface.vertices, surface.faces)
    mean = np.bincount(shell, weights=far) / np.bincount(shell)
    kept = mean[shell] < _FAR
    made_up = np.flatnonzero((far > _FAR) & (kept | (not kept.any())))
    share = len(made_up) / max(1, int(kept.sum()))
    worst = middle[made_up[np.argsort(-far[made_up])]]
    where = f"is farther than {_FAR:g} spacings from any point ({format_points(worst)})"
    if share > _MADE_UP:
        raise TissueError(
            f"points leave gaps, or their normals disagree: {100 * share:.2g} % of the surface "
            f"{where}; add points there, or give normals"
        )
    notes = [f"{100 * share:.2g} % of the surface {where}"] if share > _NOTED else []
    number = np.cumsum(np.bincount(surface.faces[kept].ravel()) > 0) - 1
    used = np.unique(surface.faces[kept])
    return Surface(surface.vertices[used], number[surface.faces[kept]].astype(np.int32)), notes
