"""Limits of the repair of a triangle surface."""

from __future__ import annotations

from typing import NamedTuple


class RepairLimits(NamedTuple):
    """How far a surface is mended; lengths are shares of its largest extent."""

    # Height of a flat face, and distance of a vertex from an edge it lies on: some float32
    # steps.
    rounding: float = 2e-6
    gap: float = 1e-4  # Widest gap between open edges that is merged over
    # The same over a short open edge (the fifth percentile): no face may collapse.
    gap_per_edge: float = 0.25
    # One edge of a face is split in each; a face has three, and new ones arise.
    joint_rounds: int = 8
    # Area that closes an open piece's rims, over its own, above which it is a sheet: 0.95 for
    # a bent one, 0.5 for half a ball, 0.2 for a box without lid.
    sheet_lid: float = 0.6
    sheet_compactness: float = 0.002  # 36 π V² / A³ (1 for a ball) below which it is one, too
    hole_width: float = 0.15  # Widest hole that is filled
    hole_area: float = 0.02  # Of all holes, over the surface's
    # Corners of a rim up to which the least patch is searched (its time grows with the cube);
    # beyond, a fan from its middle.
    exact_rim: int = 64
    crossing_faces: float = 0.05  # Share of the faces that may pass through others
    crossing_rounds: int = 5  # Of replacing them, each but the first with one more row of faces


LIMITS = RepairLimits()
