"""Build a tissue from a closed triangle surface: check its size, make its distance grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.build import build_grid
from design.tissue.closed import check_closed, enclosed_volume, merged_surface
from design.tissue.grid import BRICK
from design.tissue.grid_lines import Columns, cross_columns
from design.tissue.tissue import Tissue
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray

BRICKS_PER_FACE_AREA = 2.2
"""Bricks that a surface touches, per brick's face area of it (measured: 1.9 to 2.2)."""

LINES_PER_EXTENT = 160
"""Along which walls are measured, over the largest extent: walls as thin as 1/160 of it are met."""
MIN_FACING_COSINE = 0.5
"""Between a wall's face and the line, and between its faces: up to 60° they count as opposite."""
_MB_PER_BRICK = (BRICK + 1) ** 3 * 4 / 1e6


@dataclass(frozen=True)
class SpacingRule:
    """How the grid's spacing is chosen.

    Attributes
    ----------
    bricks : int
        Bricks to spend on any tissue.
    bricks_at_most : int
        Bricks to spend where a thin wall needs them (350 MB by default).
    cells_per_wall : float
        Fine cells across the thinnest wall.
    cells_along : float
        Finest spacing: the largest extent over this.
    """

    bricks: int = 6000
    bricks_at_most: int = 120_000
    cells_per_wall: float = 4.0
    cells_along: float = 300.0


class Walls(NamedTuple):
    """Thickness of a tissue's walls, mm; inf where no two faces are opposite.

    Attributes
    ----------
    thinnest : float
        First percentile.
    thin : float
        Fifth percentile: what is thinner is the rim of a wedge rather than a wall.
    """

    thinnest: float
    thin: float


def wall_thickness(corners: FloatArray) -> Walls:
    """Thickness of the walls of a closed surface.

    Lines along the three axes enter and leave through pairs of faces. Where both faces look
    along the line and away from each other, the wall between them is as thick as the chord times
    the cosine of their slope. Percentiles are taken: a line through the very rim of a rounded
    edge measures no wall.

    Parameters
    ----------
    corners : (f, 3, 3) float64, mm
        Counter-clockwise seen from outside.
    """
    flat = corners.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    spacing = float((high - low).max()) / LINES_PER_EXTENT
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    walls = [_walls_along(corners, axis, low, high, spacing, normal) for axis in range(3)]
    every = np.concatenate(walls)
    if len(every) == 0:
        return Walls(float("inf"), float("inf"))
    thinnest, thin = np.percentile(every, [1.0, 5.0]).tolist()
    return Walls(thinnest, thin)


def _walls_along(
    corners: FloatArray, axis: int, low: FloatArray, high: FloatArray, spacing: float, n: FloatArray
) -> FloatArray:
    across = [(axis + 1) % 3, (axis + 2) % 3]
    shape = (np.ceil((high - low)[across] / spacing)).astype(int)
    # Half a spacing in: the first line isn't along the surface's rim.
    columns = cross_columns(
        corners, axis, low + 0.5 * spacing, spacing, (int(shape[0]), int(shape[1]))
    )
    entry = np.flatnonzero((columns.turn[:-1] > 0) & (columns.turn[1:] < 0))
    first, last = n[columns.face[entry]], n[columns.face[entry + 1]]
    slope = np.minimum(-first[:, axis], last[:, axis])
    facing = (slope > MIN_FACING_COSINE) & (np.einsum("ij,ij->i", first, last) < -MIN_FACING_COSINE)
    chord = columns.where[entry + 1] - columns.where[entry]
    thick: FloatArray = (chord * slope)[facing & (chord > 0)]
    return thick


def choose_spacing(
    corners: FloatArray, walls: Walls, given_mm: float | None, rule: SpacingRule
) -> tuple[float, tuple[str, ...]]:
    """Spacing of the fine samples, mm, and what it doesn't resolve.

    As fine as ``rule.bricks`` allow, finer where a thin wall needs it. Where the thinnest walls
    need more than ``rule.bricks_at_most`` but are few (the rims of wedges), the grid resolves the
    others, and that is noted: whether a vessel fits is decided by exact distances, so that it
    keeps clear of what the grid doesn't resolve.

    Raises
    ------
    TissueError
        When the walls need more than ``rule.bricks_at_most``, or ``given_mm`` is too coarse for
        them.
    """
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(across, axis=1).sum())
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    wall_mm, needed = walls.thinnest, walls.thinnest / rule.cells_per_wall
    if given_mm is not None:
        return _given(given_mm, wall_mm, needed, area, rule), ()
    affordable = np.sqrt(BRICKS_PER_FACE_AREA * area / rule.bricks) / BRICK
    easy = max(float(affordable), extent / rule.cells_along)
    spacing = min(easy, needed)
    if _bricks(area, spacing) <= rule.bricks_at_most:
        return spacing, ()
    coarser = min(easy, walls.thin / rule.cells_per_wall)
    _require_affordable(wall_mm, spacing, area, coarser, rule)
    return coarser, (
        f"few walls, the thinnest {wall_mm:.3g} mm, are thinner than the grid of {coarser:.3g} mm "
        f"resolves; walls of {walls.thin:.3g} mm and more are resolved, and no vessel leaves the "
        "thinner ones either",
    )


def _given(given_mm: float, wall_mm: float, needed: float, area: float, rule: SpacingRule) -> float:
    if not given_mm > 0:
        raise TissueError(f"grid spacing {given_mm:g} mm isn't above 0; give a positive one")
    if given_mm > 2.0 * needed:
        raise TissueError(
            f"grid spacing {given_mm:g} mm is too coarse for walls of {wall_mm:.3g} mm; "
            f"give spacing_mm of at most {2.0 * needed:.3g}"
        )
    _require_affordable(wall_mm, given_mm, area, given_mm, rule)
    return given_mm


def _require_affordable(
    wall_mm: float, wanted_mm: float, area: float, spacing_mm: float, rule: SpacingRule
) -> None:
    """Raise with the figure wanted unless ``spacing_mm`` can be afforded."""
    if _bricks(area, spacing_mm) <= rule.bricks_at_most:
        return
    raise TissueError(
        f"walls of {wall_mm:.3g} mm need a grid spacing of {wanted_mm:.3g} mm, about "
        f"{_bricks(area, wanted_mm) * _MB_PER_BRICK:.0f} MB, above the limit of "
        f"{rule.bricks_at_most * _MB_PER_BRICK:.0f} MB (SpacingRule.bricks_at_most); thicken "
        "the thin walls, cut the tissue into parts, or raise the limit"
    )


def _bricks(area: float, spacing_mm: float) -> float:
    """Bricks along a surface of this area, mm²."""
    return BRICKS_PER_FACE_AREA * area / (BRICK * spacing_mm) ** 2


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
        Of the surface's origin, for the user; the tissue keeps them.

    Raises
    ------
    TissueError
        When the mesh is empty, open, inconsistently oriented, holds NaN, has an absurd size,
        or a wall too thin for the grid.
    """
    points, corners = merged_surface(np.asarray(vertices, dtype=np.float64), np.asarray(faces))
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
    long = np.format_float_positional(size, 4, unique=False, fractional=False, trim="-")
    raise TissueError(
        f"tissue is {long} mm long (read as {unit}), outside {limits.smallest_mm:g} to "
        f"{limits.largest_mm:g} mm; {hint}. Of a file, state its unit, or widen size_limits_mm in "
        "the recipe; of a shape, correct its lengths"
    )


def _overlaps(columns: Columns) -> bool:
    """Whether some place is enclosed twice (solids that overlap)."""
    return bool(np.cumsum(columns.turn, dtype=np.int64).max(initial=0) > 1)


def _covered(columns: Columns, spacing_mm: float) -> float:
    """Volume with a winding number above 0, by the lengths inside along the grid's lines, mm³."""
    depth = np.cumsum(columns.turn, dtype=np.int64)
    inside = depth[:-1] > 0
    return float((np.diff(columns.where) * inside).sum() * spacing_mm**2)
