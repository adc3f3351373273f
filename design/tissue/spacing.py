"""How thick a tissue's walls are, and how fine a grid they need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.tissue.arrays import BRICK
from design.tissue.columns import cross_columns

FloatArray = NDArray[np.float64]

BRICKS_PER_FACE_AREA = 2.2
"""Bricks that a surface touches, per brick's face area of it (measured: 1.9 to 2.2)."""

_LINES = 160
_OPPOSITE = 0.5
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


def wall_thickness(corners: FloatArray) -> float:
    """Thickness of the thinnest walls of a closed surface, mm.

    Lines along the three axes enter and leave through pairs of faces. Where both faces look
    along the line and away from each other, the wall between them is as thick as the chord times
    the cosine of their slope. The first percentile is taken: a line through the very rim of a
    rounded edge says nothing of walls.

    Parameters
    ----------
    corners : (f, 3, 3) float64, mm
        Counter-clockwise seen from outside.
    """
    flat = corners.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    spacing = float((high - low).max()) / _LINES
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    walls = [_walls_along(corners, axis, low, high, spacing, normal) for axis in range(3)]
    every = np.concatenate(walls)
    return float(np.percentile(every, 1.0)) if len(every) else float("inf")


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
    facing = (slope > _OPPOSITE) & (np.einsum("ij,ij->i", first, last) < -_OPPOSITE)
    chord = columns.where[entry + 1] - columns.where[entry]
    thick: FloatArray = (chord * slope)[facing & (chord > 0)]
    return thick


def choose_spacing(
    corners: FloatArray, wall_mm: float, asked_mm: float | None, rule: SpacingRule
) -> float:
    """Spacing of the fine samples, mm.

    As fine as ``rule.bricks`` allow, finer where a thin wall needs it.

    Raises
    ------
    TissueError
        When the wall needs more than ``rule.bricks_at_most``, or ``asked_mm`` is too coarse
        for it.
    """
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(across, axis=1).sum())
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    needed = wall_mm / rule.cells_per_wall
    if asked_mm is not None:
        if not asked_mm > 0:
            raise TissueError(f"grid spacing {asked_mm:g} mm isn't above 0; give a positive one")
        spacing = asked_mm
        if spacing > 2.0 * needed:
            raise TissueError(
                f"grid spacing {spacing:g} mm is too coarse for walls of {wall_mm:.3g} mm; "
                f"give spacing_mm of at most {2.0 * needed:.3g}"
            )
    else:
        affordable = np.sqrt(BRICKS_PER_FACE_AREA * area / rule.bricks) / BRICK
        spacing = float(min(max(affordable, extent / rule.cells_along), needed))
    bricks = BRICKS_PER_FACE_AREA * area / (BRICK * spacing) ** 2
    if bricks > rule.bricks_at_most:
        raise TissueError(
            f"walls of {wall_mm:.3g} mm need a grid spacing of {spacing:.3g} mm, about "
            f"{bricks * _MB_PER_BRICK:.0f} MB, above the limit of "
            f"{rule.bricks_at_most * _MB_PER_BRICK:.0f} MB (SpacingRule.bricks_at_most); thicken "
            "the thin walls, cut the tissue into parts, or raise the limit"
        )
    return spacing
