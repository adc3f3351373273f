"""Build a tissue from a closed triangle surface: check its size, make its distance grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.build import build_grid
from design.tissue.closed import check_closed, enclosed_volume, merge_vertices
from design.tissue.columns import Columns
from design.tissue.spacing import SpacingRule, choose_spacing, wall_thickness
from design.tissue.tissue import Tissue
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray


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
    notes: Sequence[str] = (),
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
    notes : sequence of str, optional
        What the surface's maker has to say to the user; the tissue carries it on.

    Raises
    ------
    TissueError
        When the mesh is empty, open, inconsistently oriented, holds NaN, has an absurd size,
        or a wall too thin for the grid.
    """
    points, corners = merge_vertices(np.asarray(vertices, dtype=np.float64), np.asarray(faces))
    check_size(points, unit, limits or SizeLimits())
    check_closed(points, corners)
    points = points * MM_PER[unit]
    volume = enclosed_volume(points, corners)
    if volume < 0:
        corners, volume = np.ascontiguousarray(corners[:, ::-1]), -volume
    walls = wall_thickness(points[corners])
    spacing, more = choose_spacing(points[corners], walls, spacing_mm, rule or SpacingRule())
    grid, columns = build_grid(points, corners, spacing)
    if _overlaps(columns):
        volume = _covered(columns, spacing)
    return Tissue(grid, Surface(points, corners), volume, walls.thinnest, (*notes, *more))


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
        f"tissue is {size:.4g} mm long (read as {unit}), outside {limits.smallest_mm:g} to "
        f"{limits.largest_mm:g} mm; {hint}. Of a file, state its unit or widen its size limits; of "
        "a shape, correct its lengths"
    )


def _overlaps(columns: Columns) -> bool:
    """Whether some place is enclosed twice (solids that overlap)."""
    return bool(np.cumsum(columns.turn, dtype=np.int64).max(initial=0) > 1)


def _covered(columns: Columns, spacing_mm: float) -> float:
    """Volume with a winding number above 0, by the lengths inside along the grid's lines, mm³."""
    depth = np.cumsum(columns.turn, dtype=np.int64)
    inside = depth[:-1] > 0
    return float((np.diff(columns.where) * inside).sum() * spacing_mm**2)
