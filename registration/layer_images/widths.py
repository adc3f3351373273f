"""Measure line widths at stations, with what scatters and what is common to all.

Edges lie at half of a line's height over the bath beside it, in light and not in its logarithm: a
camera blurs light. What that means for the width follows from the mean profile (`optics`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from registration.layer_images.in_light import LightMix
from registration.layer_images.ink_image import ACROSS, WITHIN, Template
from registration.layer_images.optics import Optics, fit_optics
from registration.layer_images.values import BoolArray, FloatArray, IntArray

_FEWEST = 8
_EDGE_PX = 0.15
"""Of a pixel: what the edge's place may be off by in the picture itself."""
_EDGE_VOXEL = 0.6
"""The same of a voxel, in a map of what an OCT sees first."""
_SLANTED = 0.06
"""Of the slant: light from the side moves edges."""
_OTHER = 0.04
"""Relative doubt of light that no kind of ink models: lit flanks, dark rims, scatter."""
_MISFIT = 0.1
"""Of a profile's height: one that fits worse isn't a line's, and its widths aren't told."""
_FIRST_GAMMA = 1.6
"""By which stations are laid over each other, before the camera's is looked for."""
_MIDDLE = 0.25
"""Half of the part of a profile, in expected widths, by which its height is told."""
_ASIDE = 0.15
"""Of a width: so near to the next ink a profile isn't a line's alone."""
_IN_RIM, _U_IN_RIM = 0.5, 0.29
"""Of the way from a rim's top to half of its height: the bead ends anywhere between."""


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
    optics : Optics or None
        What the beads are like; None where it wasn't fitted.
    """

    width_mm: FloatArray
    random_mm: FloatArray
    offset_mm: FloatArray
    common: float
    common_mm: float
    optics: Optics | None = None

    @staticmethod
    def nothing(count: int) -> Widths:
        """Return that no width is told."""
        none = np.full(count, np.nan)
        return Widths(none, none, none, 0.0, 0.0)

    @property
    def u_mm(self) -> FloatArray:
        """Standard uncertainty of each, (m,), mm."""
        return np.sqrt(self.random_mm**2 + (self.common * self.width_mm) ** 2 + self.common_mm**2)


@dataclass(frozen=True)
class StationProfiles:
    """Mean profiles of stations, the bath beside them taken off.

    Attributes
    ----------
    logs : (m, 61, c) float64
        Channels; bath 0.
    mixed : (m, 61) float64
        Channels by their weights.
    expected_mm : (m,) float64, mm
    stroke : (m,) int64
    tell : (m,) bool
        Present, seen, and free on both sides.
    clear : (m,) float64
        From the middle to the next ink, in expected widths.
    template : Template
    mix : LightMix
        From channels to light.
    px_mm : float, mm
        A working pixel.
    """

    logs: FloatArray
    mixed: FloatArray
    expected_mm: FloatArray
    stroke: IntArray
    tell: BoolArray
    clear: FloatArray
    template: Template
    mix: LightMix
    px_mm: float

    @property
    def filled(self) -> bool:
        """Whether ink is told by its level."""
        return self.template.filled

    def first_level(self) -> FloatArray:
        """Levels (m, 61) about as they are, before the camera's γ is looked for."""
        if not self.filled:
            return self.mixed / self.template.scale
        return self.mix.values(self.logs, _FIRST_GAMMA if self.mix.is_log else 1.0)

    def offset_mm(self) -> FloatArray:
        """Offset of each line's middle to the left, (m,), mm; NaN where not told."""
        edges = Edges.of(self.first_level(), self, self.template.values)
        return np.where(edges.good, edges.offset_mm, np.nan)

    def one(self, mean: FloatArray, expected_mm: float) -> StationProfiles:
        """Return the same of a single profile (61, c)."""
        yes, number = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.int64)
        wide, clear, mixed = np.array([expected_mm]), np.array([1.5]), mean[None, :, 0]
        return replace(
            self, logs=mean[None], mixed=mixed, expected_mm=wide, stroke=number, tell=yes,
            clear=clear,
        )  # fmt: skip

    def noise_of(self, level: FloatArray, use: BoolArray) -> float:
        """Scatter of a single value of levels (m, 61): of the bath beside lines, and of ink."""
        middle = level[use][:, np.abs(ACROSS) < 0.3]
        ink = _spread(middle - np.median(middle, axis=0))
        zone = (np.abs(ACROSS) > 0.8) & (np.abs(ACROSS) < 1.1)
        bath = level[use & (self.clear > 1.2)][:, zone]
        beside = _spread(bath - np.median(bath, axis=0)) if len(bath) > 8 else ink
        return float(np.sqrt(0.5 * (ink**2 + beside**2)))


def _spread(values: FloatArray) -> float:
    return 1.4826 * float(np.median(np.abs(values)))


def measure_widths(profiles: StationProfiles) -> Widths:
    """Measure widths where they can be told."""
    level, count = profiles.first_level(), len(profiles.tell)
    first = Edges.of(level, profiles, profiles.template.values)
    if first.good.sum() < _FEWEST:
        return Widths.nothing(count)
    if not profiles.filled:
        return _of_rims(profiles, level, first)
    if not profiles.mix.is_log:
        return _widths(first, first.wide_mm, profiles, level, 0.03, _EDGE_VOXEL)
    return _of_beads(profiles, level, first)


def _of_beads(profiles: StationProfiles, level: FloatArray, first: Edges) -> Widths:
    """Widths of ink that is told by its level, in a picture of light."""
    mix = profiles.mix
    mean = _mean_profile(profiles, first)
    reach = float(np.clip(np.percentile(profiles.clear[first.good], 20) - _ASIDE, 0.8, 1.2))
    half = (ACROSS >= -1e-9) & (reach >= ACROSS)
    typical = float(np.median(profiles.expected_mm[first.good]))
    noise = profiles.noise_of(level, first.good) / math.sqrt(max(1.0, first.good.sum() / 2.0))
    wide = float(np.median(first.wide_mm[first.good]))
    optics = fit_optics(ACROSS[half] * typical, mean[half], mix, wide, profiles.px_mm, noise)
    shade = optics.shade
    if shade.misfit > _MISFIT:
        return Widths.nothing(len(first.good))
    shape = mix.values(mean, optics.gamma)
    level = mix.values(profiles.logs, optics.gamma)
    edges = Edges.of(level, profiles, shape)
    usual = Edges.of(shape[None], profiles.one(mean, typical), shape).wide_mm
    told = shade.diameter(np.append(edges.wide_mm, usual))
    width = told[:-1] * (optics.diameter_mm / told[-1])
    common = math.hypot(shade.spread, _SLANTED * profiles.template.slant, _OTHER)
    return replace(_widths(edges, width, profiles, level, common, _EDGE_PX), optics=optics)


def _mean_profile(profiles: StationProfiles, edges: Edges) -> FloatArray:
    """Channels of the usual station, (61, c): each moved to its own middle, both sides as one."""
    expected = profiles.expected_mm
    typical = float(np.median(expected[edges.good]))
    rows = np.flatnonzero(edges.good & (np.abs(expected - typical) < 0.15 * typical))
    count = profiles.logs.shape[2]
    moved = np.empty((len(rows), len(ACROSS), count))
    for place, row in enumerate(rows):
        at = ACROSS + edges.offset_mm[row] / expected[row]
        for c in range(count):
            moved[place, :, c] = np.interp(at, ACROSS, profiles.logs[row, :, c])
    mean = np.median(moved, axis=0)
    return np.asarray(0.5 * (mean + mean[::-1]))  # light from the side counts on both alike


def _of_rims(profiles: StationProfiles, level: FloatArray, edges: Edges) -> Widths:
    """Widths of ink that is told by its rims, whose outer side the bead's edge is.

    A rim's top lies within the bead, and half of its height beyond, by the picture's blur. How far
    isn't known of light that ink bends.
    """
    beyond = np.maximum(edges.wide_mm - 2.0 * edges.lobe * profiles.expected_mm, 0.0)
    width = edges.wide_mm - (1.0 - _IN_RIM) * beyond
    doubt = _U_IN_RIM * float(np.median((beyond / width)[edges.good]))
    return _widths(edges, width, profiles, level, math.hypot(0.03, doubt), _EDGE_PX)


def _widths(
    edges: Edges,
    width: FloatArray,
    profiles: StationProfiles,
    level: FloatArray,
    common: float,
    edge: float,
) -> Widths:
    """Widths with what scatters: by noise, or as neighbours show where that is more."""
    good = edges.good & np.isfinite(width)
    if good.sum() < _FEWEST:
        return Widths.nothing(len(good))
    noise = profiles.noise_of(level, profiles.tell)
    by_noise = np.sqrt(2.0) * noise / np.maximum(edges.slope, 0.3) * profiles.expected_mm
    random = np.hypot(by_noise, 0.1 * profiles.px_mm)
    seen = _scatter(width, profiles.stroke, good)
    random = random * max(1.0, seen / float(np.median(random[good])))
    keep = np.where(good, 1.0, np.nan)
    return Widths(
        width * keep, random * keep, edges.offset_mm * keep, common, edge * profiles.px_mm
    )


@dataclass(frozen=True)
class Edges:
    """Where stations' profiles fall to half of their height.

    Attributes
    ----------
    wide_mm, offset_mm : (m,) float64, mm
        Width there, and the middle's place to the left; NaN where there is none.
    slope : (m,) float64
        Of the flatter edge, per expected width.
    good : (m,) bool
    lobe : float
        Of the profile's strongest place from its middle, in expected widths.
    """

    wide_mm: FloatArray
    offset_mm: FloatArray
    slope: FloatArray
    good: BoolArray
    lobe: float

    @staticmethod
    def of(level: FloatArray, profiles: StationProfiles, shape: FloatArray) -> Edges:
        """Find them in levels (m, 61) that look about like a shape (61,)."""
        filled = profiles.filled
        height = np.clip(_height(level, shape, filled), 0.4, 2.5)
        found, slopes, lobes = [], [], []
        for way in (1.0, -1.0):
            at, slope, lobe = _edge(way, level, shape, height, filled)
            found.append(at)
            slopes.append(slope)
            lobes.append(lobe)
        wide = (found[0] + found[1]) * profiles.expected_mm
        offset = 0.5 * (found[0] - found[1]) * profiles.expected_mm
        good = profiles.tell & np.isfinite(wide)
        return Edges(wide, offset, np.minimum(*slopes), good, 0.5 * sum(lobes))


def _edge(
    way: float, level: FloatArray, shape: FloatArray, height: FloatArray, filled: bool
) -> tuple[FloatArray, FloatArray, float]:
    """Distance of one side's edge in expected widths, the slope there, (m,), and the lobe's."""
    step = float(ACROSS[1] - ACROSS[0])
    order = np.argsort(way * ACROSS)
    u, values, shape = way * ACROSS[order], level[:, order], shape[order]
    half = (np.abs(u) <= 0.6) & (u > 0)
    lobe = 0.0 if filled else float(u[half][_peak(shape[half])])
    top = float(shape[np.argmin(np.abs(u - lobe))])
    half_level = np.abs(0.5 * height * top)
    outer = np.flatnonzero(u >= lobe)
    part = values[:, outer] * np.sign(top)
    below = part < half_level[:, None]
    first = np.where(below.any(axis=1), below.argmax(axis=1), 0)
    k = np.maximum(first, 1)
    rows = np.arange(len(part))
    inside, outside = part[rows, k - 1], part[rows, k]
    drop = np.maximum(inside - outside, 1e-9)
    at = u[outer][k - 1] + np.clip((inside - half_level) / drop, 0, 1) * step
    far = np.minimum(k + 1, part.shape[1] - 1)
    near = np.maximum(k - 2, 0)
    slope = (part[rows, near] - part[rows, far]) / (step * np.maximum(far - near, 1))
    return np.where(first > 0, at, np.nan), slope, lobe


def _height(level: FloatArray, shape: FloatArray, filled: bool) -> FloatArray:
    """Strength of each profile over the shape's: in the middle, or of its edges, (m,)."""
    inner = np.abs(ACROSS) <= _MIDDLE if filled else WITHIN
    part = shape[inner]
    return np.asarray(level[:, inner] @ (part / float(part @ part)))


def _peak(values: FloatArray) -> int:
    return int(np.argmax(np.abs(values)))


def _scatter(width: FloatArray, stroke: IntArray, good: BoolArray) -> float:
    """Scatter of widths by the differences of neighbours, mm; 0 where there are too few."""
    pair = good[1:] & good[:-1] & (stroke[1:] == stroke[:-1])
    if pair.sum() < _FEWEST:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(width)[pair])) / np.sqrt(2.0))
