"""Measure a leak path's width, with 95 % interval, from the gel signal missing across it."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.special import stdtrit

from design.geometry.polyline import arc_lengths
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.measuring.gauging.sections import cut_sections
from registration.measuring.gauging.trace import across_tangents, to_scan
from registration.measuring.topology.gel_paths import Scene
from registration.segmentation import GelField
from registration.segmentation.evidence import GelEvidence

# The area of a cut is the integral of what evidence lacks there, over what it lacks in liquid; blur
# changes it little (`EDGE`), so that a way as narrow as the resolution is measured too.
_REACH_MM = (0.16, 0.5)
"""Discs are at least and at most so large in radius."""
_BEYOND_MM = 0.06
"""And reach so far beyond the way: blur and a crooked path. Not farther: below a way gel is
brighter than beside it, by what liquid saves of the light."""
_RING_MM = 0.15
"""Of the gel in a ring so wide around the disc a way must stand out."""
EDGE = 0.3
"""Of the scan's coarsest voxel a way is wider than its evidence says. Evidence is capped at gel's
mean (`evidence.BRIGHTEST`): of speckle of mean power p it holds p (1 - exp(-1/p)) / (1 - 1/e), more
than p says, so that the blurred edge of a way (blur σ, about half a voxel) comes out 0.4 σ further
in on each side."""
RELATIVE = 0.06
"""Standard uncertainty of a width, of itself: reflections of the way's walls, and brighter gel
below, hide some of it. Chosen while looking at ways of both generators of the bench."""
_ROUNDS = 4
_STEP_MM = 0.02


def width(
    path: FloatArray, scene: Scene, evidence: GelEvidence, fit: Fit
) -> tuple[float, float, FloatArray]:
    """Return the diameter of a way, half its 95 % interval, and how far its axis lies off the path.

    mm; NaN where no cut is in gel. The cheapest path through a wide way runs along a side of it:
    cuts are laid about the middle of what gel lacks there.

    Parameters
    ----------
    path : (n, 3) float64, mm
        From wall to wall, part frame.
    scene : Scene
        Design on a grid: only what is gel by design counts.
    evidence : GelEvidence
    fit : Fit
        Scan to part.
    """
    centre, tangent = _cuts(path)
    radius, area, shift = 0.25, np.zeros(0), np.zeros(3)
    for _ in range(_ROUNDS):
        area, middle = _areas(centre + shift, tangent, radius, scene, evidence, fit)
        known = np.isfinite(area)
        area = area[known]
        if not len(area):
            return float("nan"), float("nan"), np.zeros(3)
        half = np.sqrt(max(float(np.median(area)), 0.0) / np.pi)
        radius = float(np.clip(half + _BEYOND_MM, *_REACH_MM))
        shift = shift + np.median(middle[known], axis=0)
    return *_with_interval(area, scene.grid.step_mm, float(evidence.voxel_mm.max())), shift


def _with_interval(area: FloatArray, step: float, voxel: float) -> tuple[float, float]:
    """Return diameter and half its 95 % interval, mm, from areas of cuts (n,), mm²."""
    # The median: at its ends a way widens into what it joins.
    middle = max(float(np.median(area)), np.pi * (step / 2) ** 2)
    spread = float(np.std(area, ddof=1)) if len(area) > 2 else middle
    bare, edge = 2 * float(np.sqrt(middle / np.pi)), EDGE * voxel
    # d = 2 √(A/π), so that its relative error is half the area's; of a median π/2 more variance.
    error = np.sqrt(np.pi / 2 / len(area)) * spread * bare / (2 * middle)
    speckle = float(stdtrit(max(len(area) - 1, 1), 0.975)) * error
    shared = 1.96 * np.hypot(RELATIVE * (bare + edge), edge / 2)
    # An interval of two or three cuts would reach far below none.
    return bare + edge, min(float(np.hypot(speckle, shared)), bare + edge)


def outline_width(path: FloatArray, field: GelField, fit: Fit) -> tuple[float, float]:
    """Return the same by outlines at the field's level, where voxels have no speckle; or NaN."""
    centre, tangent = _cuts(path)
    middle = slice(len(centre) // 7, len(centre) - len(centre) // 7)
    reach = np.full(len(centre[middle]), 0.2)
    sections = cut_sections(field, to_scan(centre[middle], tangent[middle], reach, fit))
    diameters = sections.diameter[sections.closed_outline & sections.open]
    if len(diameters) < 3:
        return float("nan"), float("nan")
    scatter = 1.4826 * float(np.median(np.abs(diameters - np.median(diameters))))
    noise = float(np.median(sections.noise[sections.closed_outline & sections.open]))
    return float(np.median(diameters)), 1.96 * float(
        np.hypot(noise, scatter / np.sqrt(len(diameters)))
    )


def _cuts(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places along a smoothed path and its direction there: 0.1 mm apart, in a short one 0.05."""
    along = arc_lengths(path)
    count = max(min(6, int(along[-1] / 0.05)), int(along[-1] / 0.1) + 1, 2)
    even = np.linspace(along[0], along[-1], count)
    # A voxel path zigzags: a parabola through all of it doesn't.
    order = min(2, len(path) - 1)
    fits = [np.polynomial.Polynomial.fit(along, path[:, k], order) for k in range(3)]
    centre = np.stack([f(even) for f in fits], axis=1)
    tangent = np.stack([f.deriv()(even) for f in fits], axis=1)
    return centre, tangent / np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)


def _areas(
    centre: FloatArray,
    tangent: FloatArray,
    radius: float,
    scene: Scene,
    evidence: GelEvidence,
    fit: Fit,
) -> tuple[FloatArray, FloatArray]:
    """Area free of gel in discs across a way, (n,), mm², and its middle from theirs, (n, 3), mm.

    NaN where less than half is gel.
    """
    reach = radius + _RING_MM
    side = np.arange(-reach, reach + _STEP_MM / 2, _STEP_MM)
    flat = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    flat = flat[(flat**2).sum(axis=1) <= reach**2]
    disc = (flat**2).sum(axis=1) <= radius**2
    first, second = across_tangents(tangent).swapaxes(0, 1)
    places = centre[:, None] + flat[:, :1] * first[:, None] + flat[:, 1:] * second[:, None]
    share = evidence.fine_at(fit.invert(places.reshape(-1, 3))).reshape(places.shape[:2])
    counts = scene.is_gel(places) & np.isfinite(share)
    known = np.where(counts, share, np.nan)
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        gel = float(np.nanmean(known[:, ~disc]))
    lacking = (gel - known[:, disc]) / max(gel - scene.liquid, 0.1)
    inside = counts[:, disc].mean(axis=1)
    area = np.nansum(lacking, axis=1) * _STEP_MM**2
    weight = np.nan_to_num(lacking)
    total = np.maximum(weight.sum(axis=1), 1e-9)
    u, v = (weight @ flat[disc] / total[:, None]).T
    reached = np.clip(np.stack([u, v], axis=1), -radius, radius)
    middle = reached[:, :1] * first + reached[:, 1:] * second
    return np.where((inside >= 0.5) & np.isfinite(gel), area, np.nan), middle
