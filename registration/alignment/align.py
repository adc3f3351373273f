"""Run an alignment: pose search, exact rigid and scaled fits, intervals, alternative poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.alignment.choice import PosePoints, residuals, thin_points
from registration.alignment.distance import ModelSurface, distance_grid
from registration.alignment.doubts import LEAST_SEEN, loose_freedoms, misfits, rival_doubts
from registration.alignment.fit import FINEST_SCALE_MM, RIGID, Fit, FitFreedom, refine
from registration.alignment.intervals import Uncertainty, fit_errors, uncertainty
from registration.alignment.rivals import AlternativePose, orientation_words
from registration.alignment.search import AlignmentOptions, Search
from registration.alignment.uncertainty import ScanErrors
from registration.errors import AlignmentError


@dataclass(frozen=True)
class Alignment:
    """The pose and what speaks for it.

    Attributes
    ----------
    rigid, scaled : Fit
        Without and with per-axis stretch.
    depth_axis : int
        The part's axis that lies most along the light.
    depth_fitted : bool
        Whether that axis was allowed to stretch.
    margin : float
        Lead over the best wrong pose where the two can be told apart, see `contest`; inf when no
        other pose was found.
    doubts : tuple of str
        Why the pose isn't sure: sentences with limit and remedy.
    uncertainty : Uncertainty
        95 % intervals of the scaled fit.
    lay : str
        Which way the part lay under the light.
    rivals : tuple of AlternativePose
        Other poses that were tried, the closest first.
    """

    rigid: Fit
    scaled: Fit
    depth_axis: int
    depth_fitted: bool
    margin: float
    doubts: tuple[str, ...]
    uncertainty: Uncertainty
    lay: str
    rivals: tuple[AlternativePose, ...]

    @property
    def ambiguous(self) -> bool:
        """Whether anything speaks against calling the pose sure."""
        return bool(self.doubts)


CLOSE_MM = 0.25
"""Surface farther from the model than this after the scaled fit isn't the part's."""
RIM_BLURS = 3.0
"""So many standard deviations of the blur a face is rounded off beside a sharp edge."""
MIRROR_LEAD = 1.5
"""A mirrored fit better than this many times is no chance."""
BETTER = 0.01
"""Of a robust fit's cost, by which another one has to be better to be taken."""
ENDS = (0.1, 99.9)
"""Percentiles of the points at which a part ends along an axis; a few lie beyond it by noise."""
DEPTH_COSINE = 0.5
"""An axis of the part that lies along the light by more than this is stretched by depth."""


def align(
    surface: ModelSurface,
    points: FloatArray,
    depth_down: bool,
    options: AlignmentOptions | None = None,
    *,
    blur_mm: float = 0.0,
    depth_standard: bool = False,
    errors: ScanErrors | None = None,
    lumens: bool = False,
    lit: float = 1.0,
) -> Alignment:
    """Align scanned surface points (n, 3) to a model.

    The part may lie any way and anywhere, and be in view in part. `depth_down`: light runs along
    the scan's z, else against it. `blur_mm`: standard deviation of the blur under which the surface
    was found, which has narrowed lumens. `depth_standard`: depth was measured on something of known
    height, so its scale may be fitted in any part. `errors`: what the scan's measurements share,
    for the intervals. `lumens`: the model is the lumens, not the gel around them. `lit`: share
    of the scanned surface that light reached.

    Raises
    ------
    AlignmentError
        When there are too few points, when nothing fits, or when the mirrored scan fits better.
    """
    options = options or AlignmentOptions()
    if len(points) < 500:
        raise AlignmentError(
            f"{len(points)} surface points are too few to align (needed: 500); check that the "
            "part lies in the field of view"
        )
    search = Search(surface, distance_grid(surface, 2.5, 0.15), options)
    many = thin_points(points, options.fine_points)
    depth = float(np.inf if depth_standard else np.ptp(np.percentile(many[:, 2], (1, 99))))
    shared = errors or ScanErrors.of_blur(blur_mm)
    free = partial(_freedom, surface, depth, options, shared, lumens)
    choice = PosePoints(search, points, free).choose()
    # Else walls prove nothing: the mirror image is a doubt.
    if np.isfinite(shared.level_mm) and lit >= LEAST_SEEN:
        _refuse_mirrored(choice.mirror_lead)
    freedom = free(choice.best)
    scaled = _at_both_ends(surface, many, choice.best, freedom, blur_mm)
    many = _off_rims(surface, many, scaled, RIM_BLURS * blur_mm)
    scaled = refine(surface, many, scaled, freedom, blur_mm=blur_mm, even=True)
    kept = _refuse_misfit(surface, many, scaled)
    # Least squares over what belongs to the part: a robust fit of a shrunken part would hold on to
    # one end and call the other an outlier.
    rigid = refine(
        surface, many[kept], _rigid(scaled), RIGID, kernel_mm=1.0, blur_mm=blur_mm, even=True
    )
    sure = fit_errors(surface, many[kept], scaled, freedom, shared, lumens=lumens)
    doubts = (
        *rival_doubts(choice.rivals, options.ambiguous_below),
        *loose_freedoms(sure.covariance[:6, :6], surface),
        *misfits(surface, many, scaled, blur_mm),
    )
    depth_axis = int(np.abs(scaled.rotation[:, 2]).argmax())
    return Alignment(
        rigid,
        scaled,
        depth_axis,
        depth_axis in freedom.axes,
        min((r.lead for r in choice.rivals if not r.mirrored), default=float("inf")),
        doubts,
        uncertainty(sure, scaled, freedom, shared),
        orientation_words(scaled.rotation[:, 2] * (1 if depth_down else -1)),
        choice.rivals,
    )


def _at_both_ends(
    surface: ModelSurface, points: FloatArray, start: Fit, freedom: FitFreedom, blur_mm: float
) -> Fit:
    """Return the better of two robust fits: from the start, and from its ends laid on the design's.

    Where little but its ends tells a part's length, as of a straight vessel, a fit from full length
    holds on to one end: what is printed of the other lies nearer to the side walls than to its end.
    """
    ends = _ends_on_ends(surface, points, start, freedom.axes)
    fits = [refine(surface, points, one, freedom, blur_mm=blur_mm) for one in (start, ends)]
    off = np.abs([residuals(surface, points, fit) for fit in fits])
    kernel = 3 * max(1.4826 * float(np.median(off, axis=1).min()), FINEST_SCALE_MM)
    cost = (off**2 / (kernel**2 + off**2)).sum(axis=1)
    return fits[int(cost[1] < (1 - BETTER) * cost[0])]


def _ends_on_ends(
    surface: ModelSurface, points: FloatArray, fit: Fit, axes: tuple[int, ...]
) -> Fit:
    """Return a fit stretched along `axes` so that points reach from end to end of the design."""
    low, high = np.percentile(fit.apply(points), ENDS, axis=0)
    first, last = surface.bounds
    free = np.isin(np.arange(3), axes)
    more = np.where(free, (last - first) / np.maximum(high - low, 1e-9), 1.0)
    begin = np.where(free, first, low)
    stretch = more * fit.stretch
    return replace(
        fit,
        stretch=stretch,
        shift=fit.shift + (begin + more * (fit.centre - low) - fit.centre) / stretch,
    )


def _off_rims(surface: ModelSurface, points: FloatArray, fit: Fit, reach_mm: float) -> FloatArray:
    """Points away from sharp edges, which a blur rounds; all where too few would be left."""
    clear = ~surface.near_rims(fit.apply(points), reach_mm) if reach_mm > 0 else np.array([False])
    return points[clear] if clear.mean() > 0.5 else points


def _rigid(fit: Fit) -> Fit:
    return Fit(fit.rotation, fit.shift, np.ones(3), fit.centre)


def _freedom(
    surface: ModelSurface,
    depth_mm: float,
    options: AlignmentOptions,
    errors: ScanErrors,
    lumens: bool,
    fit: Fit,
) -> FitFreedom:
    """All axes across the light, and along it where scan and model both show enough depth.

    What light adds to the place of some walls is free where the scan's errors say that it may.
    """
    span = np.minimum(np.ptp(surface.bounds, axis=0), depth_mm)
    deep = np.abs(fit.rotation[:, 2]) > DEPTH_COSINE
    known = ~deep | (span >= options.depth_span_mm) | np.isinf(depth_mm)
    axes = tuple(np.flatnonzero(known).tolist())
    outer = errors.outer_mm if errors.outer_mm > errors.level_mm and not lumens else 0.0
    return FitFreedom(axes, True, (errors.facing_mm, outer), errors.beam)


def _refuse_mirrored(lead: float) -> None:
    if lead > MIRROR_LEAD:
        raise AlignmentError(
            f"the scan fits the model better as its mirror image (by a factor of {lead:.1f} where "
            f"the two differ, limit {MIRROR_LEAD}): either the file stores one axis the other way "
            "round (then --mirrored, --depth-up or --depth-down; scan.mirrored, scan.depth_down in "
            "a recipe), or the part was printed as a mirror image and isn't the design. Look at a "
            "mark whose side is known before telling which"
        )


def _refuse_misfit(surface: ModelSurface, points: FloatArray, fit: Fit) -> BoolArray:
    """Return which points lie near the design, (n,); an offset all over isn't taken off."""
    close = np.abs(surface.query(fit.apply(points)).distance) < CLOSE_MM
    if close.mean() < 0.5:
        raise AlignmentError(
            f"no pose fits: in the best one {100 * close.mean():.0f} % of the scanned surface lies "
            f"within {1e3 * CLOSE_MM:.0f} µm of the design (needed: 50 %), with a fitted size of "
            f"{' × '.join(f'{100 * one:.0f}' for one in fit.scale)} % of the design's along x, y, "
            "z; check which part was scanned, the voxel size (--voxel-um; scan.voxel_um in a "
            "recipe) and the model's unit (--unit)"
        )
    return np.asarray(close)
