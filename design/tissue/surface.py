"""From a triangle surface to a tissue: what is checked, and how fine the grid is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.tissue.build import build_grid
from design.tissue.columns import Columns
from design.tissue.spacing import SpacingRule, choose_spacing, wall_thickness
from design.tissue.tissue import Tissue
from design.units import MM_PER, LengthUnit

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SizeLimits:
    """What counts as an absurd size: bounds of the largest extent, mm."""

    smallest_mm: float = 5.0
    largest_mm: float = 400.0


def tissue_from_surface(
    vertices: FloatArray,
    faces: NDArray[np.integer],
    *,
    unit: LengthUnit = "mm",
    limits: SizeLimits | None = None,
    spacing_mm: float | None = None,
    rule: SpacingRule | None = None,
) -> Tissue:
    """Build a tissue from a closed triangle surface.

    Parameters
    ----------
    vertices : (n, 3) float64, ``unit``
    faces : (m, 3) integer
    unit : {"um", "mm", "cm", "m", "in"}
        Of the vertices.
    limits : SizeLimits, optional
    spacing_mm : float, optional
        Between fine samples of the signed distance; chosen from size and thinnest wall
        otherwise.
    rule : SpacingRule, optional
        How it is chosen.

    Raises
    ------
    TissueError
        When the mesh is empty, open, inconsistently oriented, holds NaN, has an absurd size,
        or a wall too thin for the grid.
    """
    points, corners = _merged(np.asarray(vertices, dtype=np.float64), np.asarray(faces))
    check_size(points, unit, limits or SizeLimits())
    _check_closed(corners)
    points = points * MM_PER[unit]
    volume = _volume(points, corners)
    if volume < 0:
        corners, volume = np.ascontiguousarray(corners[:, ::-1]), -volume
    wall = wall_thickness(points[corners])
    spacing = choose_spacing(points[corners], wall, spacing_mm, rule or SpacingRule())
    grid, columns = build_grid(points, corners, spacing)
    if _overlaps(columns):
        volume = _covered(columns, spacing)
    return Tissue(grid, points, corners, volume, wall)


def check_size(vertices: FloatArray, unit: LengthUnit, limits: SizeLimits) -> None:
    """Raise `TissueError` for a mesh without points or extent, or of absurd size."""
    if len(vertices) == 0:
        raise TissueError("mesh is empty: it has no faces; give a closed surface")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise TissueError(f"mesh has {bad} vertices that are NaN or infinite; mend the file")
    extent = float(np.ptp(vertices, axis=0).max())
    size = extent * MM_PER[unit]
    if limits.smallest_mm <= size <= limits.largest_mm:
        return
    fitting = [
        f"{other} ({extent * per:.3g} mm)"
        for other, per in MM_PER.items()
        if limits.smallest_mm <= extent * per <= limits.largest_mm
    ]
    hint = f"with unit {' or '.join(fitting)} it would fit" if fitting else "no unit makes it fit"
    raise TissueError(
        f"mesh is {size:.4g} mm long (read as {unit}), outside {limits.smallest_mm:g} to "
        f"{limits.largest_mm:g} mm; {hint}. State the file's unit, or widen the size limits"
    )


def _merged(
    vertices: FloatArray, faces: NDArray[np.integer]
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Vertices used by faces, each once, and faces without repeated corners."""
    if len(faces) == 0 or len(vertices) == 0:
        raise TissueError("mesh is empty: it has no faces; give a closed surface")
    points, number = np.unique(vertices[faces.ravel()], axis=0, return_inverse=True)
    corners = number.reshape(-1, 3).astype(np.int32)
    repeated = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    return np.ascontiguousarray(points), np.ascontiguousarray(corners[~repeated])


def _check_closed(faces: NDArray[np.int32]) -> None:
    one_way = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    size = int(faces.max()) + 1
    forth = one_way[:, 0] * size + one_way[:, 1]
    back = one_way[:, 1] * size + one_way[:, 0]
    keys, uses = np.unique(np.minimum(forth, back), return_counts=True)
    odd = int((uses % 2 == 1).sum())
    if odd:
        raise TissueError(
            f"mesh is open: {odd} of {len(keys)} edges aren't shared by two faces; close the "
            "holes (for example with a mesh repair tool) and try again"
        )
    signed = np.bincount(
        np.searchsorted(keys, np.minimum(forth, back)), weights=np.where(forth < back, 1, -1)
    )
    turned = int((signed != 0).sum())
    if turned:
        raise TissueError(
            f"mesh isn't consistently oriented: at {turned} of {len(keys)} edges two faces look "
            "opposite ways; make the normals consistent and try again"
        )


def _volume(points: FloatArray, faces: NDArray[np.int32]) -> float:
    a, b, c = (points[faces[:, k]] - points.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _overlaps(columns: Columns) -> bool:
    """Whether some place is enclosed twice (solids that overlap)."""
    return bool(np.cumsum(columns.turn, dtype=np.int64).max(initial=0) > 1)


def _covered(columns: Columns, spacing_mm: float) -> float:
    """Volume with a winding number above 0, by the lengths inside along the grid's lines, mm³."""
    depth = np.cumsum(columns.turn, dtype=np.int64)
    inside = depth[:-1] > 0
    return float((np.diff(columns.where) * inside).sum() * spacing_mm**2)
