"""The scanned surface in two parts for the report: lumens, and the outside that would hide them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.network import VesselNetwork
from registration.report.surface import ReportSurface

FloatArray = NDArray[np.float64]

_REACH_MM = 0.2
"""A face belongs to a lumen when it lies within this, or a third of the radius, of its wall."""


def split_surfaces(
    vertices: FloatArray, faces: NDArray[np.int32], deviation_um: FloatArray, network: VesselNetwork
) -> list[ReportSurface]:
    """Lumens first (the page shows the first coloured surface), then the rest, if there is any."""
    lumen = near_lumen(vertices, network)[faces].all(axis=1)
    parts = (("Lumens as scanned, deviation", lumen), ("Outside as scanned, deviation", ~lumen))
    return [_part(name, vertices, faces[kept], deviation_um) for name, kept in parts if kept.any()]


def near_lumen(points: FloatArray, network: VesselNetwork) -> NDArray[np.bool_]:
    """Whether each of ``points`` (n, 3) lies near the wall of a vessel of ``network``, or in it."""
    centre, radius = _samples(network)
    # A few neighbours: of a wide and a thin vessel side by side the nearest axis isn't the one.
    distance, index = KDTree(centre).query(points, k=min(4, len(centre)), workers=1)
    distance, index = distance.reshape(len(points), -1), index.reshape(len(points), -1)
    reach = radius[index] + np.maximum(_REACH_MM, radius[index] / 3)
    near: NDArray[np.bool_] = (distance <= reach).any(axis=1)
    return near


def _samples(network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Points on the axes, closer than half a radius to one another, and their radii."""
    start, end, r0, r1, _ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    counts = np.ceil(2 * length / np.minimum(r0, r1)).astype(np.int64) + 1
    piece = np.repeat(np.arange(len(start)), counts)
    first = np.cumsum(counts) - counts
    share = (np.arange(len(piece)) - first[piece]) / (counts[piece] - 1)
    centre = start[piece] + share[:, None] * (end - start)[piece]
    return centre, r0[piece] + share * (r1 - r0)[piece]


def _part(
    name: str, vertices: FloatArray, faces: NDArray[np.int32], deviation_um: FloatArray
) -> ReportSurface:
    """A surface with the vertices that its faces use."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    renumbered = (np.cumsum(used) - 1).astype(np.int32)[faces]
    return ReportSurface(name, vertices[used], renumbered, deviation_um[used], "µm")
