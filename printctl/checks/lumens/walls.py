"""Thickness of the design's wall where a lumen leaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from printctl.checks.lumens.leaks import OUTSIDE_NAME, Leak

Depth = Callable[[FloatArray], FloatArray]
"""Depth below the part's surface at points (n, 3) of the part, (n,), mm."""

STEP_MM: Final = 0.02
NEAR_RADII: Final = 3.0
"""Of the widest lumen, around a leak, within which its wall is looked for."""


def with_walls(leaks: tuple[Leak, ...], network: VesselNetwork, depth: Depth) -> tuple[Leak, ...]:
    """The leaks with the thickness of the wall that the design has there.

    Parameters
    ----------
    leaks : tuple of Leak
        In the part's frame.
    network : VesselNetwork
    depth : function
    """
    start, end, r0, r1, vessel = network.pieces()
    count = np.ceil(np.linalg.norm(end - start, axis=1) / STEP_MM).astype(np.int64) + 1
    piece = np.repeat(np.arange(len(start)), count)
    part = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)) / np.maximum(
        np.repeat(count, count) - 1, 1
    )
    at = start[piece] + part[:, None] * (end - start)[piece]
    radius = r0[piece] + part * (r1 - r0)[piece]
    tree = network.tree[vessel[piece]].astype(str)
    return tuple(_with_wall(leak, at, radius, tree, depth) for leak in leaks)


def _with_wall(
    leak: Leak, at: FloatArray, radius: FloatArray, tree: np.ndarray, depth: Depth
) -> Leak:
    near = np.linalg.norm(at - leak.at_mm, axis=1) <= NEAR_RADII * radius.max()
    own = near & (tree == leak.tree)
    if not own.any():
        return leak
    if leak.into == OUTSIDE_NAME:
        # Of the lumen's points the one that the leak leaves from: its mouth may be near as well.
        away = np.linalg.norm(at[own] - leak.at_mm, axis=1) - radius[own]
        beside = np.flatnonzero(away <= away.min() + STEP_MM)
        return replace(leak, wall_mm=float((depth(at[own][beside]) - radius[own][beside]).min()))
    other = near & (tree == leak.into)
    return replace(leak, wall_mm=_gap(at, radius, own, other)) if other.any() else leak


def _gap(at: FloatArray, radius: FloatArray, own: BoolArray, other: BoolArray) -> float:
    """Least distance between two lumens' walls, mm."""
    apart = np.linalg.norm(at[own][:, None] - at[other][None], axis=2)
    return float((apart - radius[own][:, None] - radius[other][None]).min())
