"""Find what is thin and lies across a lumen: films of gel, or reflections that look like them.

A film thinner than the blur never reaches half of the gel's level, so the sections it lies in look
open. But it brightens the whole core of the lumen at one place along it, where a sound lumen's mean
varies by a hundredth of the step from liquid to gel. Whether that is gel isn't known: what it
crosses is neither open nor closed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from registration.alignment import Fit
from registration.gauging.trace import VesselTrace
from registration.segmentation import GelField

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_SHARE = 0.25
"""Of the step from liquid to gel, in the mean over the core. Sound lumens stay below 0.17 (specular
walls at a mouth); a film as thick as the blur's standard deviation has 0.38."""
_LEAST_SPREADS = 6.0
"""Robust standard deviations of a vessel's own profile, which rises where contrast is low."""
_MOST_OF_CORE = 0.8
"""Share of the core that must be brightened by half of that: a bubble's rim covers less."""
_CORE = 0.5
"""Of the lumen's radius: clear of walls and of their blur."""
_TILTS = (0.0, 0.4, 0.8)
"""Slopes of a film against the section, from square to the axis to that of a slanted face."""
_WINDOW_MM = 0.8
"""The profile is held against its running median over this length."""
_ANGLE = 2 * np.pi * np.arange(12) / 12
_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)
_PATTERN = np.concatenate([np.zeros((1, 2)), 0.5 * _CIRCLE[::2], _CIRCLE])


def without_films(
    traces: tuple[VesselTrace, ...], field: GelField, fit: Fit
) -> tuple[VesselTrace, ...]:
    """Return traces in which open sections that something thin crosses are `crossed`, not seen.

    Parameters
    ----------
    traces : tuple of VesselTrace
        One a vessel.
    field : GelField
        The scan's gel.
    fit : Fit
        Scan to part, with which the traces were made.
    """
    return tuple(_without_films(trace, field, fit) for trace in traces)


def _without_films(trace: VesselTrace, field: GelField, fit: Fit) -> VesselTrace:
    sound = trace.seen & trace.sections.open
    if len(trace.along) < 2 or not sound.any():
        return trace
    step = float(field.voxel_mm.min()) / 2
    along = np.arange(0.0, trace.length + step, step)
    films = _films(_shares(trace, field, fit, along), step, trace)
    ends = trace.spacing * np.arange(len(trace.along) + 1)
    crossed = np.zeros(len(trace.along), dtype=np.bool_)
    for first, last in films:
        touched = (ends[:-1] <= along[last]) & (ends[1:] >= along[first])
        # What closes a section is an occlusion, and so are its blurred edges.
        beside = touched | np.roll(touched, 1) | np.roll(touched, -1)
        if not (beside & trace.seen & ~trace.sections.open).any():
            crossed |= touched
    crossed &= sound & (trace.to_end > -trace.spacing)
    return replace(
        trace, crossed=crossed, seen=trace.seen & ~crossed, counted=trace.counted & ~crossed
    )


def _shares(trace: VesselTrace, field: GelField, fit: Fit, along: FloatArray) -> FloatArray:
    """Brightness over the local liquid's in steps from liquid to gel, (n, points of the core)."""
    known = trace.counted & trace.sections.open & np.isfinite(trace.sections.shift).all(axis=1)
    shift, radius = np.zeros((len(along), 2)), np.interp(along, trace.along, trace.radius)
    if known.any():
        measured = np.interp(along, trace.along[known], trace.sections.diameter[known] / 2)
        radius = np.minimum(radius, measured)
        for axis in range(2):
            shift[:, axis] = np.interp(along, trace.along[known], trace.sections.shift[known, axis])
    axis_points = np.stack(
        [np.interp(along, trace.along, trace.centre[:, k]) for k in range(3)], axis=1
    )
    nearest = np.clip((along / trace.spacing).astype(np.int64), 0, len(trace.along) - 1)
    flat = shift[:, None] + _CORE * radius[:, None, None] * _PATTERN
    places = fit.invert(axis_points)[:, None] + flat @ trace.planes.across[nearest]
    above = field.above_level(places)
    size = int(_WINDOW_MM / (along[1] - along[0])) | 1
    liquid = median_filter(np.nan_to_num(above), size=(size, 1), mode="reflect")
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (above - liquid) / (-2 * liquid)
    return np.where((liquid < 0) & np.isfinite(share), share, 0.0)


def _films(share: FloatArray, step: float, trace: VesselTrace) -> list[tuple[int, int]]:
    """First and last sample of each stretch that something thin brightens."""
    mean = share.mean(axis=1)
    spread = 1.4826 * float(np.median(np.abs(mean - np.median(mean))))
    least = max(LEAST_SHARE, _LEAST_SPREADS * spread)
    reach = _CORE * float(trace.radius.mean()) / step
    bright = np.zeros(len(share), dtype=np.bool_)
    # No tilted mean exceeds that of the brightest samples in reach.
    most = maximum_filter1d(share, 2 * int(np.ceil(max(_TILTS) * reach)) + 1, axis=0)
    if most.mean(axis=1).max() <= least:
        return []
    for slope in _TILTS:
        for towards in _CIRCLE[:: 12 if slope == 0 else 1]:
            moved = np.rint(slope * reach * (_PATTERN @ towards)).astype(np.int64)
            rows = np.clip(np.arange(len(share))[:, None] + moved, 0, len(share) - 1)
            tilted = np.take_along_axis(share, rows, axis=0)
            covered = (tilted > least / 2).mean(axis=1) >= _MOST_OF_CORE
            bright |= covered & (tilted.mean(axis=1) > least)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bright, [False]]).astype(np.int8)))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]
