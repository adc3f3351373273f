"""Lumens that a scan's blur leaves visible, and the voxels that the others need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import Segmentation
from registration.segmentation.working import probe

LEAST_KEPT: Final = 0.75
"""Of the step from gel to liquid that must be left on an open lumen's axis: a wall lies at 0.5, and
noise must not cross the other half of that."""
WIDEST_BLUR: Final = 1 / math.sqrt(2 * math.log(1 / (1 - LEAST_KEPT)))
"""Standard deviation of that blur, in radii."""


def kept_depth(radius_mm: FloatArray, blur_mm: float) -> FloatArray:
    """Return the part of the step that a Gaussian blur leaves on a cylinder's axis, (n,).

    A disc of radius r under a Gaussian of standard deviation σ keeps 1 - exp(-r² / 2 σ²) at its
    centre.
    """
    return np.asarray(1 - np.exp(-(radius_mm**2) / (2 * max(blur_mm, 1e-9) ** 2)))


def edge_blur_mm(segmentation: Segmentation) -> float:
    """Return the standard deviation of all that blurs a scan's walls, mm; NaN without a wall.

    Instrument, voxels and smoothing together: across a wall blurred by σ the signal changes by its
    step over √(2 π) σ per length. Rough walls make it larger in places: the median counts.
    """
    field, surface = segmentation.field, segmentation.surface.vertices
    around = 0.5 * float(field.voxel_mm.min()) * segmentation.outward
    change = field.above_level(surface - around) - field.above_level(surface + around)
    slope = change[segmentation.seen] / float(field.voxel_mm.min())
    gel = probe(field.values) * field.sign - field.level
    if not (np.isfinite(slope).any() and (gel > 0).any()):
        return math.nan
    step, steepness = 2 * float(np.median(gel[gel > 0])), float(np.nanmedian(slope))
    return step / (math.sqrt(2 * math.pi) * steepness) if steepness > 0 else math.nan


def resolved_um(blur_mm: float) -> float:
    """Return the diameter, µm, of the narrowest channel that a blur leaves visible."""
    return 2e3 * blur_mm / WIDEST_BLUR


def without_unresolved(traces: Sequence[VesselTrace], blur_mm: float) -> tuple[VesselTrace, ...]:
    """Return traces in which no section is closed that would look closed if it were open."""
    return tuple(_shown(trace, blur_mm) for trace in traces)


def _shown(trace: VesselTrace, blur_mm: float) -> VesselTrace:
    told = trace.sections.open | (kept_depth(trace.radius, blur_mm) >= LEAST_KEPT)
    return replace(trace, seen=trace.seen & told, counted=trace.counted & told)


def needed_voxel_um(thinnest_um: float, blur_mm: float, voxel_mm: Sequence[float]) -> float:
    """Return the largest voxel, µm, that shows the thinnest lumen; NaN where these do.

    Parameters
    ----------
    thinnest_um : float, µm
        Its diameter.
    blur_mm : float, mm
        Standard deviation of binning and smoothing, in proportion to the voxels.
    voxel_mm : sequence of float, mm
        Of the scan; the coarsest counts.
    """
    widest_mm = WIDEST_BLUR * 0.5e-3 * thinnest_um
    if blur_mm <= widest_mm:
        return math.nan
    return 1e3 * max(voxel_mm) * widest_mm / blur_mm
