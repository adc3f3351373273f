"""Where the scanned part lies: multistart, exact refinement, and how sure the pose is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.alignment.contest import contest, residuals, winner
from registration.alignment.fit import RIGID, Fit, Freedom, refine
from registration.alignment.intervals import Uncertainty, uncertainty
from registration.alignment.options import AlignmentOptions
from registration.alignment.search import Search
from registration.distance import ModelSurface, distance_grid
from registration.errors import AlignmentError
from registration.uncertainty import ScanErrors

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Alignment:
    """The pose and what speaks for it.

    Attributes
    ----------
    rigid, scaled : Fit
        Without and with per-axis stretch.
    depth_fitted : bool
        Whether the part's z was allowed to stretch.
    margin : float
        Lead over the best wrong pose where the two can be told apart, see `contest`; inf when no
        other pose was found.
    ambiguous : bool
        Margin below the limit.
    uncertainty : Uncertainty
        95 % intervals of the scaled fit.
    """

    rigid: Fit
    scaled: Fit
    depth_fitted: bool
    margin: float
    ambiguous: bool
    uncertainty: Uncertainty


RIVALS = 4
"""Distinct poses that are refined and compared."""
CLOSE_MM = 0.25
"""Surface farther from the model than this after the scaled fit isn't the part's."""
RIM_BLURS = 3.0
"""So many standard deviations of the blur a face is rounded off beside a sharp edge."""
MIRROR_LEAD = 1.5
"""A mirrored fit better than this many times is no chance."""
_MIRROR = np.array([-1.0, 1.0, 1.0])


def align(
    surface: ModelSurface,
    points: FloatArray,
    depth_down: bool,
    options: AlignmentOptions | None = None,
    *,
    blur_mm: float = 0.0,
    depth_standard: bool = False,
    errors: ScanErrors | None = None,
) -> Alignment:
    """Align scanned surface points (n, 3) to a model.

    The part may be turned any way about the vertical, tilted by about 10 degrees and shifted by
    several mm. `depth_down`: the scan's z points into the part's -z. `blur_mm`: standard deviation
    of the blur under which the surface was found, which has narrowed lumens. `depth_standard`:
    depth was measured on something of known height, so its scale may be fitted in any part.
    `errors`: what the scan's measurements share, for the intervals.

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
    grid = distance_grid(surface, 2.5, 0.15)
    few, many = _thinned(points, options.coarse_points), _thinned(points, options.fine_points)
    some = _thinned(points, 4000)
    axes = (0, 1, 2) if depth_standard else _stretching_axes(surface, many, options)
    search = Search(surface, grid, depth_down, axes, options)
    rivals = search.rivals(few, some, RIVALS)
    mirrored = search.rivals(few * _MIRROR, some * _MIRROR, 1)[0]
    wide = _thinned(points, options.contest_points)
    best, margin = winner(surface, wide, rivals)
    straight = residuals(surface, wide, best)
    _refuse_mirrored(straight, residuals(surface, wide * _MIRROR, mirrored))
    free = Freedom(axes, offset=True)
    scaled = refine(surface, many, best, free, blur_mm=blur_mm)
    many = _off_rims(surface, many, scaled, RIM_BLURS * blur_mm)
    scaled = refine(surface, many, scaled, free, blur_mm=blur_mm)
    _refuse_misfit(surface, many, scaled)
    # Least squares over what belongs to the part: a robust fit of a shrunken part would hold on to
    # one end and call the other an outlier.
    kept = np.abs(surface.query(scaled.apply(many)).distance) < CLOSE_MM
    rigid = refine(surface, many[kept], _rigid(scaled), RIGID, kernel_mm=1.0, blur_mm=blur_mm)
    sure = uncertainty(
        surface, many[kept], scaled, free, blur_mm, errors or ScanErrors.of_blur(blur_mm)
    )
    return Alignment(rigid, scaled, 2 in axes, margin, margin < options.ambiguous_below, sure)


def _off_rims(surface: ModelSurface, points: FloatArray, fit: Fit, reach_mm: float) -> FloatArray:
    """Points away from sharp edges, which a blur rounds; all where too few would be left."""
    clear = ~surface.near_rims(fit.apply(points), reach_mm) if reach_mm > 0 else np.array([False])
    return points[clear] if clear.mean() > 0.5 else points


def _rigid(fit: Fit) -> Fit:
    return Fit(fit.rotation, fit.shift, np.ones(3), fit.centre)


def _thinned(points: FloatArray, most: int) -> FloatArray:
    """At most `most` of the points, spread evenly, the same every time."""
    if len(points) <= most:
        return points
    chosen = np.random.default_rng(0).choice(len(points), most, replace=False)
    return np.asarray(points[np.sort(chosen)])


def _stretching_axes(
    surface: ModelSurface, points: FloatArray, options: AlignmentOptions
) -> tuple[int, ...]:
    """The plane's axes, and z when scan and model both show enough depth."""
    seen = float(np.ptp(np.percentile(points[:, 2], (1, 99))))
    model = float(np.ptp(surface.bounds[:, 2]))
    return (0, 1, 2) if min(seen, model) >= options.depth_span_mm else (0, 1)


def _refuse_mirrored(straight: FloatArray, mirrored: FloatArray) -> None:
    lead = contest(mirrored, straight)
    if lead > MIRROR_LEAD:
        raise AlignmentError(
            f"the scan fits the model better as its mirror image (by a factor of {lead:.1f} where "
            f"the two differ, limit {MIRROR_LEAD}); one axis runs the other way: flip the scan's x "
            "or y axis, or set depth_down"
        )


def _refuse_misfit(surface: ModelSurface, points: FloatArray, fit: Fit) -> None:
    close = np.abs(residuals(surface, points, fit)) < CLOSE_MM
    if close.mean() < 0.5:
        raise AlignmentError(
            f"only {100 * close.mean():.0f} % of the scanned surface comes within "
            f"{1e3 * CLOSE_MM:.0f} um of the model (needed: 50 %); "
            "is this the scan of this part, in the right units?"
        )
