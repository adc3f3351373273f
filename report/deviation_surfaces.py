"""Split the scanned surface into lumens and the outer faces that hide them, for the 3D view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.measuring.gauging.deviation import near_lumen
from report.surface import ReportSurface


def split_surfaces(
    vertices: FloatArray, faces: NDArray[np.int32], deviation_um: FloatArray, network: VesselNetwork
) -> list[ReportSurface]:
    """Lumens first (the page shows the first coloured surface), then the rest, if there is any."""
    lumen = near_lumen(vertices, network)[faces].all(axis=1)
    return [
        _part(f"{part} as scanned, deviation (scaled fit)", vertices, faces[kept], deviation_um)
        for part, kept in (("Lumens", lumen), ("Outside", ~lumen))
        if kept.any()
    ]


def _part(
    name: str, vertices: FloatArray, faces: NDArray[np.int32], deviation_um: FloatArray
) -> ReportSurface:
    """A surface with the vertices that its faces use."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    renumbered = (np.cumsum(used) - 1).astype(np.int32)[faces]
    return ReportSurface(name, Surface(vertices[used], renumbered), deviation_um[used], "µm")
