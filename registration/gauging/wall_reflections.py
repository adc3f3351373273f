"""Correct section diameters for bright wall reflections, by the wall's roughness or profile.

A reflection no brighter than gel can't be told from a wall that lies a little further out. Smooth
walls send one back only where they face the light; rough ones have ledges that do, whichever way
they stand. How rough walls are is seen in the scatter of each section's rays beyond that of
speckle. Where walls shine so much that their mean profile tells the line (`wall_profile`), that
tells where they lie; where only those shine that lie across the light, how far those may lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kernels.arrays import FloatArray
from registration.gauging.sections import independent_rays
from registration.gauging.trace import VesselTrace
from registration.gauging.wall_profile import wall_profile
from registration.segmentation import Segmentation
from registration.uncertainty import ScanErrors

ACROSS_LIGHT = 0.5 + 1 / np.pi
"""Mean of n², n the normal's part along the light, over walls within 45 degrees of facing it."""
FACING_PRIOR_MM = (0.0045, 0.002)
"""Mean and standard deviation, before their profile is looked at, of how much further into the gel
walls across the light lie: 21 scans of the shared generator with smooth walls need 4 to 6 µm, three
with brighter or finer lines -4 to 19 µm, which their profiles tell."""
ROUGH = 0.375
"""Of the scan's depth voxel: walls that scatter so much have ledges all over (set on the shared
generator's walls with grains of 30 um, 0.375 of 25 um; held against the other two). Less of them
send back less, as the square of the scatter: it goes with the slopes' variance."""


def with_ledges(
    traces: tuple[VesselTrace, ...],
    segmentation: Segmentation,
    errors: ScanErrors,
) -> tuple[tuple[VesselTrace, ...], ScanErrors, float]:
    """Return sections with their walls moved, the errors that are left, and where walls lie.

    The last is how much further into the gel than the field says, mm, for walls along the light.

    `GelField.faint_mm` has moved all walls as if they had ledges all over: what they lack of that
    is taken back, and what the cap on bright voxels moves them by (`GelField.cut_mm`) is added.
    Where the walls' mean profile knows better, its place and error replace both. A calibration of
    walls (`--walls`) is made on diameters moved so.

    Parameters
    ----------
    traces : tuple of VesselTrace
    segmentation : Segmentation
    errors : ScanErrors
    """
    field = segmentation.field
    if field.faint_mm == 0:
        return traces, errors, field.wall_mm
    # The middle of what is possible is half of `UNSEEN_LINE` (a half) of a voxel of depth.
    part = share_of_ledges(traces, field.blur_mm, segmentation.contrast, 4 * field.faint_mm)
    wider = 2 * (field.cut_mm - (1 - part) * field.faint_mm)
    moved = tuple(_widened(trace, wider) for trace in traces)
    left = replace(errors, faint_mm=part * errors.faint_mm)
    profile = wall_profile(moved, segmentation)
    if profile is not None and profile.told and profile.error_mm < left.faint_mm:
        moved = tuple(_widened(trace, 2 * profile.place_mm) for trace in moved)
        wider += 2 * profile.place_mm
        left = replace(left, faint_mm=0.0, facing_mm=0.0, cut_mm=0.0, line_mm=profile.error_mm)
        return moved, left, field.wall_mm + wider / 2
    smooth = wall_profile(moved, segmentation, across_light=True)
    if smooth is not None:
        place, error = smooth.expected(FACING_PRIOR_MM)
        moved = tuple(_widened(t, place / ACROSS_LIGHT * _across_light(t)) for t in moved)
        # A calibration of walls was made on walls moved so: it leaves none of that error.
        if errors.facing_mm:
            left = replace(left, facing_mm=error / ACROSS_LIGHT)
    return moved, left, field.wall_mm + wider / 2


def share_of_ledges(
    traces: Sequence[VesselTrace], blur_mm: float, contrast: float, depth_mm: float
) -> float:
    """Return how far walls are covered with ledges, 0 to 1; 1 where that can't be told.

    A section's rays scatter by speckle as the gel's spread 1/contrast, of which halfway to the gel
    half of the variance is left, over the rise of a step under the blur σ, 1/(√(2π) σ): by
    √π σ / contrast.
    """
    scatter = np.concatenate([np.zeros(0), *(_scatter(trace, blur_mm) for trace in traces)])
    if len(scatter) == 0:
        return 1.0
    rough = float(np.median(scatter**2)) - np.pi * (blur_mm / contrast) ** 2
    return float(np.clip(rough / (ROUGH * depth_mm) ** 2, 0.0, 1.0))


def _scatter(trace: VesselTrace, blur_mm: float) -> FloatArray:
    """Standard deviation of the rays of each measured section, mm (`sections._shape` undone)."""
    measured = trace.counted & trace.sections.closed_outline
    radii = trace.sections.rays[measured]
    if len(radii) == 0:
        return np.zeros(0)
    count = independent_rays(np.nanmean(radii, axis=1), blur_mm)
    return np.asarray(trace.sections.noise[measured] / 2 * np.sqrt(count))


def _across_light(trace: VesselTrace) -> FloatArray:
    """How much wider each section is by walls that lie n² further out, (n,), of that; `cut`."""
    return np.asarray((trace.planes.across[..., 2] ** 2).sum(axis=1))


def _widened(trace: VesselTrace, wider: float | FloatArray) -> VesselTrace:
    """Trace with its open lumens wider by so much, mm."""
    old = trace.sections
    diameter, median = (
        np.where(d > 0, np.maximum(d + wider, 0.0), d) for d in (old.diameter, old.median)
    )
    return replace(trace, sections=replace(old, diameter=diameter, median=median))
