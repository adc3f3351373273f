"""Measure line widths at half level from cross-profiles, with random and common uncertainty.

Edges lie at half of a line's height over the bath beside it. What that means for the width follows
from the mean profile: how much light the ink takes, and how sharp the picture is
(`registration.devices.microscope.ink_absorption`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.devices.microscope.ink_absorption import Shade, fit_shade
from registration.inspection.heights.own_depth import HEIGHTS
from registration.inspection.ink.ink_image import ACROSS, WITHIN, Template
from registration.inspection.values import FloatImage
from registration.inspection.widths.rim_widths import MOST_MISFIT, fit_rim, rim_edges

_FEWEST = 8
_EDGE_PX = 0.15
"""Of a pixel: what the edge's place may be off by in the picture itself."""
_EDGE_VOXEL = 0.6
"""The same of a voxel, in a map of what an OCT sees first."""
_FLANKS: Final = 0.06
"""Relative doubt of what a profiler shows of a line: low flanks are lost or in shadow."""
_MOST_SPREAD = 0.15
_THIN, _THIN_INK = 0.08, 0.5
"""Relative doubt of ink so thin (μ d below the second) that its rims may look like bath."""
_DIM_FLANKS: Final = 0.12
"""Relative doubt of opaque ink that is brighter than its bath: flanks that face away from the light
are dim, and look like blur of a narrower line."""
_SLANTED = 0.15
"""Of the slant: light from the side moves edges."""
_BY_EDGES: Final = 0.08
"""Least relative doubt of lines that are told by their edges."""
_EVEN: Final = 1.0 / math.sqrt(3.0)
"""Standard uncertainty of what lies anywhere between an estimate and its other end."""
_RESPONSE: Final = 0.5
"""Of what another response changes: a camera that measures is linear as a rule."""
_REBOUND: Final = 0.3
"""Widths beyond a line's edge, within which ink that seems to come again is its own."""
_MISFITTING: Final = 1.5
"""Of a misfit, by which edges lie elsewhere: they leave most of it."""
_NO_RIM: Final = 0.01
"""Of a line's level: noise of a mean profile."""
_RIM: Final = 0.1
"""Of a line's level, from which on what its edges show beyond it is a rim's."""
_OFF_MIDDLE: Final = np.linspace(-0.25, 0.25, 41)
"""Expected widths, by which a line may lie beside its expected middle."""
_OF_RIMS: Final = 0.03
"""Relative doubt of widths from rim to rim, beyond what the fit says."""
_LEAST_BLUR: Final = 0.5
"""Pixels: standard deviation of the least blur."""
_MISFIT = 0.1
"""Of a profile's height: one that fits worse isn't a line's, and its widths aren't told."""


@dataclass(frozen=True)
class Widths:
    """Widths at stations.

    Attributes
    ----------
    width_mm, random_mm : (m,) float64, mm
        Width, and what of its uncertainty differs from station to station; NaN where not told.
    offset_mm : (m,) float64, mm
        Of the middle, to the left.
    common : float
        Relative standard uncertainty of all widths together.
    common_mm : float, mm
        The part of it that doesn't grow with the width.
    shade : Shade or None
        The ink's absorption and the picture's blur; None where they weren't fitted.
    """

    width_mm: FloatArray
    random_mm: FloatArray
    offset_mm: FloatArray
    common: float
    common_mm: float
    shade: Shade | None = None

    @property
    def u_mm(self) -> FloatArray:
        """Standard uncertainty of each, (m,), mm."""
        return np.sqrt(self.random_mm**2 + (self.common * self.width_mm) ** 2 + self.common_mm**2)


def measure_widths(
    profiles: FloatImage,
    expected_mm: FloatArray,
    stroke: IntArray,
    tell: BoolArray,
    template: Template,
    px_mm: float,
    noise: float,
    is_light: bool,
    flanks_lost: bool = False,
    rimmed: bool = False,
    otherwise: FloatImage | None = None,
    bright: bool = False,
) -> Widths:
    """Measure widths where they can be told.

    Parameters
    ----------
    profiles : (m, 61) float32
        Mean over each station, the bath beside it taken off.
    expected_mm : (m,) float64, mm
    stroke : (m,) int64
    tell : (m,) bool
        Present, seen, and free on both sides.
    template : Template
    px_mm : float, mm
        A working pixel.
    noise : float
        Scatter of a station's single value.
    is_light : bool
        Whether the picture is one of light, and not a map of heights.
    flanks_lost : bool
        Whether what measured it loses points on steep flanks.
    rimmed : bool
        Whether they are an OCT's, of ink that shows by its rim (`rim_widths.has_rim`).
    otherwise : (m, 61) float32 or None
        The same by another response of the camera, which may be its own: 1 for ink as well.
    bright : bool
        Whether ink is brighter than the bath.
    """
    count = len(profiles)
    nothing = np.full(count, np.nan)
    if tell.sum() < _FEWEST:
        return Widths(nothing, nothing, nothing, 0.0, 0.0)
    left, right, slope = _rims(profiles, tell) if rimmed else _edges(profiles, template)
    wide = (left + right) * expected_mm
    good = tell & np.isfinite(wide)
    if good.sum() < _FEWEST:
        return Widths(nothing, nothing, nothing, 0.0, 0.0)
    if rimmed:
        told = profiles[good], expected_mm[good], wide[good]
        ratio, common = _from_rim_to_rim(*told, px_mm)
        width, common_mm, shade = wide * ratio, 0.0, None
    else:
        width, common, common_mm, shade = _true_widths(
            profiles,
            expected_mm,
            wide,
            good,
            template,
            px_mm,
            is_light,
            flanks_lost,
            otherwise,
            bright,
        )
    if not np.isfinite(width[good]).any():
        return Widths(nothing, nothing, nothing, 0.0, 0.0)
    by_noise = np.sqrt(2.0) * noise / np.maximum(slope, 0.3) * expected_mm
    random = np.hypot(by_noise, 0.1 * px_mm)
    seen = _scatter(width, stroke, good)
    random = random * max(1.0, seen / float(np.median(random[good])))
    keep = np.where(good, 1.0, np.nan)
    offset = 0.5 * (left - right) * expected_mm
    return Widths(width * keep, random * keep, offset * keep, common, common_mm, shade)


def _by_response(
    wide: FloatArray,
    otherwise: FloatImage | None,
    expected_mm: FloatArray,
    good: BoolArray,
    template: Template,
) -> float:
    """What widths at half level may be off by where the camera's response is another, relative."""
    if otherwise is None:
        return 0.0
    left, right, _ = _edges(otherwise, template)
    ratio = ((left + right) * expected_mm / wide)[good]
    known = ratio[np.isfinite(ratio)]
    return abs(float(np.median(known)) - 1.0) if len(known) else 0.0


def _rims(profiles: FloatImage, tell: BoolArray) -> tuple[FloatArray, ...]:
    return rim_edges(profiles, _even(profiles[tell]))


def _even(profiles: FloatImage) -> FloatArray:
    """Median profile about its own middle, the same to both sides."""
    mean = np.median(profiles, axis=0).astype(np.float64)
    each = [np.interp(ACROSS + by, ACROSS, mean) for by in _OFF_MIDDLE]
    best = max(each, key=lambda one: float(one @ one[::-1]))
    return np.asarray(0.5 * (best + best[::-1]))


def _from_rim_to_rim(
    profiles: FloatImage, expected_mm: FloatArray, wide_mm: FloatArray, px_mm: float
) -> tuple[float, float]:
    """True width over that at half of the rims' height, and its relative uncertainty; NaN."""
    typical = _middle_value(expected_mm)
    alike = np.abs(expected_mm - typical) < 0.15 * typical
    rim = fit_rim(_even(profiles[alike]), _LEAST_BLUR * px_mm / typical, HEIGHTS)
    if rim.misfit > MOST_MISFIT:
        return math.nan, 0.0
    wide = float(np.median(wide_mm[alike] / expected_mm[alike]))
    return rim.diameter / wide, float(np.hypot(_OF_RIMS, rim.u_diameter / rim.diameter))


def _edges(profiles: FloatImage, template: Template) -> tuple[FloatArray, ...]:
    """Distance of the left and right edge in expected widths, and the slope there, (m,) each."""
    height = np.clip(_height(profiles, template), 0.4, 2.5)
    found, slopes = [], []
    step = float(ACROSS[1] - ACROSS[0])
    for way in (1.0, -1.0):
        order = np.argsort(way * ACROSS)
        u, values, shape = way * ACROSS[order], profiles[:, order], template.values[order]
        half = np.abs(u) <= 0.6
        lobe = 0.0 if template.filled else float(u[half & (u > 0)][_peak(shape[half & (u > 0)])])
        top = float(shape[np.argmin(np.abs(u - lobe))])
        level = 0.5 * height * top
        outer = np.flatnonzero(u >= lobe)
        part = values[:, outer] * np.sign(top)
        level = np.abs(level)
        below = part < level[:, None]
        first = np.where(below.any(axis=1), below.argmax(axis=1), 0)
        k = np.maximum(first, 1)
        rows = np.arange(len(part))
        inside, outside = part[rows, k - 1], part[rows, k]
        drop = inside - outside
        at = u[outer][k - 1] + np.clip((inside - level) / np.maximum(drop, 1e-9), 0, 1) * step
        found.append(np.where(first > 0, at, np.nan))
        far = np.minimum(k + 1, part.shape[1] - 1)
        near = np.maximum(k - 2, 0)
        slopes.append((part[rows, near] - part[rows, far]) / (step * np.maximum(far - near, 1)))
    return found[0], found[1], np.minimum(slopes[0], slopes[1])


def _height(profiles: FloatImage, template: Template) -> FloatArray:
    """Strength of each profile over the template's: in the middle, or of its edges, (m,)."""
    if not template.filled:
        shape = np.where(WITHIN, template.values, 0.0)
        return np.asarray(profiles @ shape / float(shape @ shape))
    inner = np.abs(ACROSS) <= 0.25
    shape = template.values[inner]
    return np.asarray(profiles[:, inner] @ (shape / float(shape @ shape)))


def _peak(values: FloatArray) -> int:
    return int(np.argmax(np.abs(values)))


def _true_widths(
    profiles: FloatImage,
    expected_mm: FloatArray,
    wide: FloatArray,
    good: BoolArray,
    template: Template,
    px_mm: float,
    is_light: bool,
    flanks_lost: bool,
    otherwise: FloatImage | None,
    bright: bool,
) -> tuple[FloatArray, float, float, Shade | None]:
    """Widths from widths at half level, and the uncertainty of all, relative and absolute."""
    typical = _middle_value(expected_mm[good])
    edge_px = _EDGE_PX if is_light else _EDGE_VOXEL
    if not template.filled:
        common = max(_BY_EDGES, _EVEN * _beyond_rim(wide, expected_mm, good, template))
        return wide, common, edge_px * px_mm, None
    if flanks_lost:
        return wide, _FLANKS, px_mm, None
    if not is_light:
        return wide, 0.03, edge_px * px_mm, None
    alike = good & (np.abs(expected_mm - typical) < 0.15 * typical)
    mean = np.median(profiles[alike], axis=0).astype(np.float64)
    mean = 0.5 * (mean + mean[::-1])  # light from the side counts on both alike
    near = np.abs(ACROSS) <= 1.2
    shade = fit_shade(ACROSS[near] * typical, [mean[near]], [float(np.median(wide[alike]))], px_mm)
    if shade.misfit > _MISFIT:
        return np.full(len(wide), np.nan), 0.0, 0.0, None
    width = np.where(good, shade.diameter(np.where(good, wide, np.nan)), np.nan)
    bent = float(np.nanmedian(np.abs(width / wide - 1.0)))
    # An opaque line's μ is free: its spread says nothing.
    spread = min(shade.spread, 0.05 if shade.opaque(typical) else _MOST_SPREAD)
    half = 0.5 * float(np.median(wide[alike] / expected_mm[alike]))
    response = _RESPONSE * _by_response(wide, otherwise, expected_mm, good, template)
    edges = _EVEN * max(bent, response, _by_rims(mean, half))
    thin = _THIN if shade.per_mm * typical < _THIN_INK else 0.0
    dim = _DIM_FLANKS if bright and shade.opaque(typical) else 0.0
    slant = _SLANTED * template.slant
    common = math.hypot(spread, edges, _MISFITTING * shade.misfit, slant, thin, dim)
    return width, common, edge_px * px_mm, shade


def _beyond_rim(
    wide: FloatArray, expected_mm: FloatArray, good: BoolArray, template: Template
) -> float:
    """How far beyond their strongest place edges are taken, over half of a width."""
    right = (ACROSS > 0) & (ACROSS <= 0.6)
    rim = float(ACROSS[right][_peak(template.values[right])])
    half = 0.5 * float(np.median(wide[good] / expected_mm[good]))
    return abs(half - rim) / half


def _by_rims(mean: FloatArray, half: float) -> float:
    """What light at a line's edges may put its width off by, relative.

    Edges that are stronger than the middle, or beside which ink seems to come again, are no blur's,
    halo's or absorption's, but of slopes in the light. The true edge lies between the place where
    they are strongest and that at half level.

    Parameters
    ----------
    mean : (61,) float64
        Even; linear in light.
    half : float
        Half of the width at half level, expected widths.
    """
    right = (ACROSS > 0.15) & (ACROSS < 1.0)
    u, values = ACROSS[right], mean[right]
    middle = float(mean[np.abs(ACROSS) <= 0.15].mean())
    beside = np.array([mean[(one < ACROSS) & (one + _REBOUND >= ACROSS)].max() for one in u])
    shines, shades = (
        values - middle,
        np.where((u > half) & (u < half + _REBOUND), beside - values, 0.0),
    )
    found = 0.0
    for over in (shines, shades):
        place = int(np.argmax(over))
        more = float(over[place]) / max(abs(middle), 1e-9) - _NO_RIM
        share = min(max(more, 0.0) / _RIM, 1.0)
        found = max(found, share * abs(half - float(u[place])) / half)
    return found


def _middle_value(values: FloatArray) -> float:
    """Return the upper median: one of the values, so that it lies beside itself at least."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _scatter(width: FloatArray, stroke: IntArray, good: BoolArray) -> float:
    """Scatter of widths by the differences of neighbours, mm; 0 where there are too few."""
    pair = good[1:] & good[:-1] & (stroke[1:] == stroke[:-1])
    if pair.sum() < _FEWEST:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(width)[pair])) / np.sqrt(2.0))
