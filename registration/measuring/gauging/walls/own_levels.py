"""Correct diameters of short vessels beside thin gel by gel and liquid levels measured there.

A wall lies halfway between gel and liquid. A scan's levels are means over some 0.25 mm of what is
well within either (`segmentation.local_level`). In a tight row of lumens there is no such gel: its
light has come another way, and it is darker or brighter by up to a tenth than the gel around the
row by which it is judged; walls along the light see another than those across it. A step blurred
by σ rises by 1 / (√(2π) σ) of its height at its middle, so that half levels that are off by e move
each wall by √(2π) σ e, and a diameter by twice that.

The gel beside a section is asked for where, by design, it is thick: gel of the thickness g between
liquid keeps of its level, at its middle, erf(g / (2 √2 σ)) under a blur (the difference of two
steps), of which three blurs leave 0.87. Thinner gel doesn't tell its level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ROOT_TWO_PI
from registration.measuring.gauging.sections import RAYS, independent_rays
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import Segmentation

BEHIND = np.array([2.0, 2.5, 3.0])
"""Blurs behind a wall at which gel tells its level: a step has reached 0.98 to 0.999 of it."""
THICK = np.array([2.0, 4.0])
"""Blurs behind a wall at which there must be gel, a blur or more from any surface."""
CORE = np.array([0.0, 0.15, 0.3])
"""Parts of the radius at which liquid tells its level."""
EVERY = 2
"""Of the rays are asked: speckle makes neighbours alike."""
FEWEST = 4
"""Rays, in all of a vessel's sections, for a level."""
THIN_GEL = 0.25
"""Standard uncertainty, in blurs, of a diameter beside thin gel: what is left beyond the error of
vessels apart from others, RMS, of 1,020 sections of 15 scans of the shared generator. Thin gel
doesn't tell its level; and two edges nearer than the blur move apart: round lumens with two to four
others 1.35 to 3 blurs beside them, blurred by 1 to 1.2 times what is known of, come out 0.13 RMS
too wide by that."""
UNTOLD = 0.05
"""Standard deviation of the levels' sum (gel 1, liquid 0) among vessels in rows, which stays where
no gel is thick."""
MOST = 0.2
"""Of that sum: where it is off by more, what lies there isn't as designed."""


def with_own_levels(
    traces: Sequence[VesselTrace],
    segmentation: Segmentation,
    fit: Fit,
    part: ModelSurface | None,
) -> tuple[VesselTrace, ...]:
    """Return traces, diameters of short vessels beside thin gel by levels of their own.

    `part` is the designed part, in whose frame `fit` lays the scan; without it, and without light
    (micro-CT, whose gel is as bright everywhere), nothing changes.
    """
    if part is None or segmentation.strength is None:
        return tuple(traces)
    return tuple(
        _levelled(trace, segmentation, fit, part) if trace.short else trace for trace in traces
    )


def _levelled(
    trace: VesselTrace, segmentation: Segmentation, fit: Fit, part: ModelSurface
) -> VesselTrace:
    """Trace with its whole sections moved by its levels, if there is thin gel beside any."""
    whole = np.flatnonzero(trace.counted & trace.sections.closed_outline)
    if len(whole) == 0:
        return trace
    centre, way, radius = _walls(trace, whole)
    blur = segmentation.field.blur_mm
    met = np.isfinite(radius)
    # Of thin gel a ray may meet no wall: there it is looked for at the section's mean radius.
    mean = np.nanmean(radius, axis=1, keepdims=True)
    wall = np.where(met, radius, mean)
    designed = _gel_at(fit, part, centre, way, wall[..., None] + blur * THICK, blur)
    if designed.all():
        return trace
    level, error = 0.0, UNTOLD
    behind = _values(segmentation, centre, way, wall[..., None] + blur * BEHIND) / ndtr(BEHIND)
    told = behind.mean(axis=-1)
    thick = designed & met & np.isfinite(told)
    if thick.sum() >= FEWEST:
        core = mean[..., None] * CORE
        liquid = _values(segmentation, centre, way, np.broadcast_to(core, (*met.shape, len(CORE))))
        gel = _all_round(told, thick, met, way[..., 0, 2])
        level = float(np.clip(1.0 - gel - np.nanmean(liquid), -MOST, MOST))
        error = 1.0 / (segmentation.contrast * np.sqrt(_independent(trace, thick, radius, blur)))
    return _moved(trace, whole, -ROOT_TWO_PI * blur * level,
                  blur * float(np.hypot(THIN_GEL, ROOT_TWO_PI * error)))  # fmt: skip


def _walls(trace: VesselTrace, which: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where rays start (n, 1, 1, 3), their ways (n, r, 1, 3), lengths (n, r); scan's frame, mm."""
    angle = 2 * np.pi * np.arange(0, RAYS, EVERY) / RAYS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = trace.planes.across[which]
    centre = trace.planes.centre[which]
    centre = centre + np.einsum("ni,nij->nj", trace.sections.shift[which], across)
    way = np.einsum("ri,nij->nrj", circle, across)
    return centre[:, None, None], way[:, :, None], trace.sections.rays[which][:, ::EVERY]


def _gel_at(
    fit: Fit,
    part: ModelSurface,
    centre: FloatArray,
    way: FloatArray,
    away: FloatArray,
    margin: float,
) -> BoolArray:
    """Whether all places so far along each ray, (n, r, k) mm, lie in the designed gel, (n, r)."""
    places = centre + away[..., None] * way
    distance = part.query(fit.apply(places.reshape(-1, 3))).distance
    return np.asarray((distance.reshape(away.shape) < -margin).all(axis=-1))


def _values(
    segmentation: Segmentation, centre: FloatArray, way: FloatArray, away: FloatArray
) -> FloatArray:
    """Share of gel, by the scan's levels, so far along each ray, (n, r, k)."""
    field = segmentation.field
    return field.above_level(centre + away[..., None] * way) + field.level


def _all_round(
    told: FloatArray, thick: BoolArray, met: BoolArray, along_light: FloatArray
) -> float:
    """Mean over walls along the light and across it of what thick gel tells of either."""
    sides = np.broadcast_to(along_light**2 < 0.5, met.shape)
    parts = [(met & side, thick & side) for side in (sides, ~sides)]
    known = [(m.sum(), told[t].mean()) for m, t in parts if t.sum() >= FEWEST]
    weights, levels = zip(*known, strict=True) if known else ((1.0,), (told[thick].mean(),))
    return float(np.average(levels, weights=weights))


def _independent(trace: VesselTrace, thick: BoolArray, radius: FloatArray, blur: float) -> float:
    """Number of places with speckle of their own by which the gel's level is told."""
    around = independent_rays(np.nanmean(radius, axis=1), blur) * thick.mean(axis=1)
    apart = min(trace.spacing / (2 * np.sqrt(np.pi) * blur), 1.0)
    return float(max(apart * around.sum(), 1.0))


def _moved(trace: VesselTrace, which: IntArray, wider: float, level_u: float) -> VesselTrace:
    """Trace with these sections wider by so much, and the standard uncertainty of that, mm."""
    old = trace.sections
    diameter, median = old.diameter.copy(), old.median.copy()
    for values in (diameter, median):
        values[which] = np.where(
            values[which] > 0, np.maximum(values[which] + wider, 0.0), values[which]
        )
    return replace(trace, sections=replace(old, diameter=diameter, median=median), level_u=level_u)
