"""Cut a raw picture of the scan through a defect, with designed and found contours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from kernels.arrays import FloatArray
from registration.overlay.cut import Shades
from registration.scan import Scan
from report.views.mesh_cut import cut_mesh, lines_within

_LEAST_MM, _MOST_MM = 0.8, 2.5
"""Half a window's edge."""
_RADII = 3.0


@dataclass(frozen=True)
class Contours:
    """Two surfaces in the scan's frame.

    Attributes
    ----------
    design, measured : Surface
        The design at the fitted pose and scales, and the scan's segmented surface.
    """

    design: Surface
    measured: Surface


@dataclass(frozen=True)
class Panel:
    """One picture of voxels.

    Attributes
    ----------
    title : str
    grey : (ny, nx) uint8
        The scan's own voxels, rows along depth.
    extent_mm : (left, right, bottom, top), mm
        Outer edges in the scan's frame; bottom is deeper.
    mark_mm : (across, depth), mm
        The finding.
    design, measured : (k, 2, 2) float64, mm
        Contours as lines.
    """

    title: str
    grey: NDArray[np.uint8]
    extent_mm: tuple[float, float, float, float]
    mark_mm: tuple[float, float]
    design: FloatArray
    measured: FloatArray


@dataclass(frozen=True)
class FindingView:
    """What is shown beside a finding.

    Attributes
    ----------
    finding : int
        Place in the list of findings, from 0.
    b_scan : Panel
        The scan's own B-scan through the finding (x and depth).
    reslice : Panel
        The plane of y and depth through it.
    section : int or None
        The section across the vessel at the finding, its place in the stack of pictures.
    """

    finding: int
    b_scan: Panel
    reslice: Panel
    section: int | None


def panel(
    scan: Scan, shades: Shades, contours: Contours, axis: int, voxel: tuple[int, int, int],
    half_mm: tuple[float, float],
) -> Panel:  # fmt: skip
    """Cut a window out of the plane across `axis` (0: x, 1: y) through a voxel.

    Parameters
    ----------
    voxel : (i, j, k)
        Along x, y, z.
    half_mm : (across, depth), mm
        Half of the window's edges.
    """
    size = np.array(scan.geometric_voxel_mm[::-1])
    along = 1 - axis
    reach = [max(1, round(half_mm[0] / size[along])), max(1, round(half_mm[1] / size[2]))]
    count = scan.volume.shape[::-1]
    first = [max(0, voxel[a] - r) for a, r in zip((along, 2), reach, strict=True)]
    last = [min(count[a], voxel[a] + r + 1) for a, r in zip((along, 2), reach, strict=True)]
    across, deep = slice(first[0], last[0]), slice(first[1], last[1])
    where = (deep, voxel[1], across) if axis == 1 else (deep, across, voxel[0])
    grey = shades.grey(scan.volume[where])
    low = (np.array(first) - 0.5) * size[[along, 2]]
    high = (np.array(last) - 0.5) * size[[along, 2]]
    place = voxel[axis] * float(size[axis])
    lines = [
        lines_within(cut_mesh(surface.vertices, surface.faces, axis, place), low, high)
        for surface in (contours.design, contours.measured)
    ]
    # The light comes from above, also where depth is counted upwards.
    top, bottom = (low[1], high[1]) if scan.depth_down else (high[1], low[1])
    return Panel(
        _title(axis, voxel, count),
        grey if scan.depth_down else grey[::-1],
        (float(low[0]), float(high[0]), float(bottom), float(top)),
        (voxel[along] * float(size[along]), voxel[2] * float(size[2])),
        *lines,
    )


def _title(axis: int, voxel: tuple[int, int, int], count: tuple[int, ...]) -> str:
    if axis == 1:
        return f"B-scan {voxel[1]} of {count[1]} (from 0)"
    return f"across the B-scans, A-scan {voxel[0]} of {count[0]}"


def half_window(radius_mm: float, extent_mm: float) -> tuple[float, float]:
    """Half edges of a finding's window, mm: three radii or three quarters of its extent."""
    wide = float(np.clip(max(_RADII * radius_mm, 0.75 * extent_mm), _LEAST_MM, _MOST_MM))
    return wide, float(np.clip(_RADII * radius_mm, 0.75 * _LEAST_MM, 0.75 * _MOST_MM))
