"""Find places along fresh lines that the view shows over, or under, another fresh line.

Two vessels of one look may cross, or run one over the other: where ink of the lower one is missing
the upper one's shows, and the other way round. Lines that lie in each other (joints of a tree) are
ink to both and cover nothing. Of translucent ink densities add, which tells some of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.heights.line_places import CLEARLY, OVER
from registration.inspection.ink.ink_image import ACROSS, CORE
from registration.inspection.ink.line_levels import lines_of
from registration.inspection.ink.presence import INK, averaged
from registration.inspection.ink.told import Told
from registration.inspection.values import Unseen
from registration.inspection.ways import DETOUR, Seen, Ways, stretches_of

_MOST: Final = 0.3
"""Of a line's width in the view, that another line may cover."""
_ACROSS: Final = np.linspace(-0.5, 0.5, 9)
"""Of a width."""
_WITHIN: Final = 0.5
_OTHER_DEPTH: Final = 0.25
"""Of a line's width: a column shown higher or lower by more doesn't show its middle."""
_MOST_WRONG: Final = 0.15
"""Of a line's width, that may be shown at another line's depth."""
_LEAST: Final = 0.05
"""Of another line's level, that it adds where it touches a place."""
_KNOWN: Final = 2.0
"""Widths of a line's own ink alone, from which on its level is known."""
_ASIDE: Final = 0.1
"""Of another line's width, by which it may lie nearer, or be wider, than expected."""
_THICKER: Final = 1.1
"""Times its level beside a crossing, that another line may have in it."""
_SHOWN: Final = 0.4
"""Of a line's level, that must show over that of the others."""
_LIKELY: Final = 0.5
"""Of a line's level, that shows over that of the others where the line is likely there."""
_SPREADS: Final = 4.0
"""And standard deviations of ink."""


@dataclass(frozen=True)
class Covers:
    """What lies over or under fresh lines in the view.

    Attributes
    ----------
    places : (n,) bool
        Places over or under which the view shows another line, whose middle is higher or lower by
        more than its radius.
        In a volume: places that a line nearer to the scanner shades, or that are shown at another
        line's depth.
    one, other : (k,) int64
        All pairs of places of lines that the view shows over each other, whatever their height.
    apart : (k, u) float64
        How far the core of ``one``, as of `ACROSS`, lies from ``other``, in widths of that.
    in_volume : bool
        Whether the picture is one of a volume.
    """

    places: BoolArray
    one: IntArray
    other: IntArray
    apart: FloatArray
    in_volume: bool = False

    @staticmethod
    def of(ways: Ways, seen: Seen, scanner: int = 0) -> Covers:
        """Find them among the places ``ways``, which lie in the picture as ``seen`` says.

        ``scanner`` is 1 for a picture of a volume (`filament_map`) scanned from above, -1 from
        below, 0 for others.
        """
        nothing = np.zeros(0, dtype=np.int64)
        height = ways.point[:, 2]
        if np.ptp(height) <= 0.5 * float(ways.width.min()):  # of one layer
            none = np.zeros((0, int(CORE.sum())))
            return Covers(np.zeros(len(ways), dtype=np.bool_), nothing, nothing, none)
        half = 0.5 * ways.width * np.linalg.norm(seen.across, axis=1)
        shown = np.flatnonzero(np.isfinite(seen.at).all(axis=1) & np.isfinite(half))
        within = OVER if scanner else _WITHIN
        reach = 2.0 * (0.5 + within) * float(half[shown].max(initial=0.0))
        pairs = cKDTree(seen.at[shown]).query_pairs(reach, output_type="ndarray")
        one, other = shown[pairs].reshape(-1, 2).T
        one, other = np.concatenate([one, other]), np.concatenate([other, one])
        another = ~_goes_on(ways, one, other)
        one, other = one[another], other[another]
        hit = _apart(seen, half, one, other, _ACROSS) < within
        above = height[other] - height[one]
        apart = (scanner * above if scanner else np.abs(above)) > 0.5 * ways.width[other]
        across = np.zeros((len(ways), len(_ACROSS)), dtype=np.bool_)
        np.logical_or.at(across, one[apart], hit[apart])
        touching = hit.any(axis=1)
        one, other = one[touching], other[touching]
        core = _apart(seen, half, one, other, ACROSS[CORE])
        places = across.mean(axis=1) > _MOST
        if scanner:
            places |= _at_others_depth(ways, seen, half, scanner)
        return Covers(places, one, other, core, bool(scanner))

    def untold(
        self, told: Told | None, over_old: BoolArray, ways: Ways, gap_mm: float
    ) -> BoolArray:
        """Return the places that tell nothing of their own line, (n,).

        In a volume none of `places` tells: the nearer line shades the other one, and columns taken
        at another line's depth show bath or ink of there.

        In a picture other lines' ink only adds: less than the line's own shows that it is missing.
        What is clearly more than the other lines', which grow thin to their sides, shows that it is
        there.

        Parameters
        ----------
        told : Told or None
            Ink over the bath.
        over_old : (n,) bool
            Places over older ink, which adds as well.
        ways : Ways
        gap_mm : float, mm
            Tolerated.
        """
        if self.in_volume or told is None or told.noise is None or not self.places.any():
            return self.places
        ink, line = INK * told.noise.middle, lines_of(ways)
        sure = ~self.places & ~over_old & (told.why == Unseen.SEEN) & (told.present > ink)
        known_mm = np.bincount(line, weights=np.where(sure, ways.step, 0.0))
        known = known_mm[line] > _KNOWN * ways.width
        level = told.level * told.noise.middle
        sums = np.where(known, level, np.inf), ways.run, told.template.values
        others = self._others(*sums, _ASIDE)
        count = max(1, round(gap_mm / float(np.median(ways.step)))) | 1
        shown = averaged(told.present, np.isfinite(told.present), ways.run, count) * told.level
        doubt = _SPREADS * float(told.noise.spread[0]) * told.level
        there = shown > _THICKER * others + np.maximum(_SHOWN * level, doubt)
        bare = told.present < ink
        lacks = self.places & ~bare & ~(shown > self._others(*sums, 0.0) + _LIKELY * level)
        there &= ~self._lacking(lacks, ways, gap_mm)
        shows = known & ~over_old & (bare | there)
        return np.asarray(self.places & ~shows)

    def _lacking(self, lacks: BoolArray, ways: Ways, gap_mm: float) -> BoolArray:
        """Return crossings, (n,), of which more than is tolerated likely lacks the line's ink.

        There the other lines' ink may be thicker than it was taken for, beside that as well.
        """
        out = np.zeros(len(ways), dtype=np.bool_)
        for first, last in stretches_of(self.places, ways.run):
            own = slice(first, last + 1)
            out[own] = float(ways.step[own][lacks[own]].sum()) > gap_mm
        return out

    def _others(
        self, level: FloatArray, run: IntArray, profile: FloatArray, aside: float
    ) -> FloatArray:
        """Presence (n,) of other lines at each place, by their levels (n,) and profile (61,).

        They may lie so much nearer, of their widths, than expected.
        """
        count = int(run.max(initial=0)) + 1
        key, each = np.unique(self.one * count + run[self.other], return_inverse=True)
        apart, most = np.full((len(key), self.apart.shape[1]), np.inf), np.zeros(len(key))
        np.minimum.at(apart, each, self.apart)
        np.maximum.at(most, each, level[self.other])
        half = ACROSS >= 0
        light = np.interp(np.maximum(apart - aside, 0.0), ACROSS[half], profile[half], right=0.0)
        own = profile[CORE]
        share = np.maximum(light @ own / float(own @ own), _LEAST)
        return np.asarray(np.bincount(key // count, most * share, len(level)), dtype=np.float64)


def _at_others_depth(ways: Ways, seen: Seen, half: FloatArray, scanner: int) -> BoolArray:
    """Places, (n,), of which a part is nearer to another line, of another height, in the view.

    Over one that lies clearly below, a line is shown at its own depth (`line_places`).
    """
    out = np.zeros(len(ways), dtype=np.bool_)
    shown = np.flatnonzero(np.isfinite(seen.at).all(axis=1) & np.isfinite(half))
    way = seen.across[shown] / np.linalg.norm(seen.across[shown], axis=1, keepdims=True)
    part = (2.0 * half[shown, None] * _ACROSS)[:, :, None]
    near = shown[cKDTree(seen.at[shown]).query(seen.at[shown][:, None] + part * way[:, None])[1]]
    own = np.broadcast_to(shown[:, None], near.shape)
    above = scanner * (ways.point[own, 2] - ways.point[near, 2]) / ways.width[own]
    off = (np.abs(above) > _OTHER_DEPTH) & (above < CLEARLY)
    wrong = off & ~_goes_on(ways, own.ravel(), near.ravel()).reshape(near.shape)
    out[shown] = wrong.mean(axis=1) > _MOST_WRONG
    return out


def _goes_on(ways: Ways, one: IntArray, other: IntArray) -> BoolArray:
    """Whether a line leads from one place to the other without a turn back."""
    along = np.abs(ways.along[one] - ways.along[other])
    apart = np.linalg.norm(ways.point[one] - ways.point[other], axis=1)
    return np.asarray((ways.stroke[one] == ways.stroke[other]) & (along <= DETOUR * apart))


def _apart(
    seen: Seen, half: FloatArray, one: IntArray, other: IntArray, across: FloatArray
) -> FloatArray:
    """How far parts across a place lie from another line's middle, its widths, (k, u)."""
    way = seen.across[one] / np.linalg.norm(seen.across[one], axis=1, keepdims=True)
    off = seen.at[other] - seen.at[one]
    part = 2.0 * half[one, None] * across
    x, y = off[:, :1] - part * way[:, :1], off[:, 1:] - part * way[:, 1:]
    return np.asarray(np.hypot(x, y) / (2.0 * half[other, None]))
