"""Find stretches without ink along strokes, and the chance of each by the picture's noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.presence import END, INK, WindowNoise, averaged
from registration.inspection.values import Gap, Shift, Unseen
from registration.inspection.ways import Ways, stretches_of

LEAST: Final = 0.6
"""Of the tolerated length: shorter ones aren't told (round ends reach into a gap)."""
_HIDDEN: Final = 0.06
_ALIKE: Final = 0.95
_FEWEST_ALIKE: Final = 12
_LEAST_ALIKE: Final = 0.8
_FAINT: Final = (1.0, 2.0, 4.0, 8.0)
"""Tolerated lengths, over which faint ink is averaged."""
_BESIDE: Final = 1.0
"""Widths that must be bare between sound ink and a thing that hides the rest of a gap."""
_SMOOTH: Final = 0.4
"""Of the tolerated length, over which presence is averaged to find where a gap ends."""


def find_gaps(
    present: FloatArray,
    good: BoolArray,
    inferred: BoolArray,
    ways: Ways,
    noise: WindowNoise,
    gap_mm: float,
    p_needed: float,
    strange: FloatArray,
    faint: bool = False,
    strength: FloatArray | None = None,
) -> tuple[list[Gap], BoolArray]:
    """Return gaps, and places whose surroundings contradict a gap there, (n,).

    Parameters
    ----------
    present : (n,) float64
    good : (n,) bool
        Seen, and told from its background; or inferred.
    inferred : (n,) bool
        Of these: they count for no chance.
    ways : Ways
    noise : WindowNoise
    gap_mm : float, mm
    p_needed : float
        A gap's p-value must be below.
    strange : (n,) float64
        Share of each place's surroundings that is neither ink nor bath: what lies on a line there
        hides it (a needle may be as bright as the bath).
    faint : bool
        Whether ink is too faint for a tolerated gap: noise would cut longer ones into pieces, so
        that several lengths are averaged over, and each is tested.
    strength : (n,) float64 or None
        Of what shows a line, over the usual: presence scatters as much more; None for 1.
    """
    strength = np.ones(len(ways)) if strength is None else strength
    levels = (
        [averaged(present, good, ways.run, _count(ways, size * gap_mm)) for size in _FAINT]
        if faint
        else [_along(present, good, ways, gap_mm)]
    )
    unclear = np.zeros(len(ways), dtype=np.bool_)
    found = list[Gap]()
    for smooth in levels:
        places = Tested(
            present, smooth, good, inferred, ways, noise, gap_mm, p_needed / len(levels), strength
        )
        gaps, doubtful = places.gaps(strange)
        found += gaps
        unclear |= doubtful
    return (_surest(found) if faint else found), unclear


def _surest(gaps: list[Gap]) -> list[Gap]:
    """Of gaps that overlap the surest one."""
    out = list[Gap]()
    for gap in sorted(gaps, key=lambda one: one.p_value):
        apart = (
            gap.stroke != one.stroke or gap.to_mm < one.from_mm or one.to_mm < gap.from_mm
            for one in out
        )
        if all(apart):
            out.append(gap)
    return out


@dataclass(frozen=True)
class Tested:
    """Places along lines, of which stretches without ink are tested; as of `find_gaps`.

    Attributes
    ----------
    smooth : (n,) float64
        Presence averaged over some neighbours: where it is low a gap is looked for.
    """

    present: FloatArray
    smooth: FloatArray
    good: BoolArray
    inferred: BoolArray
    ways: Ways
    noise: WindowNoise
    gap_mm: float
    p_needed: float
    strength: FloatArray

    def gaps(self, strange: FloatArray) -> tuple[list[Gap], BoolArray]:
        """Gaps, and places that are neither ink nor bath."""
        unclear = np.zeros(len(self.ways), dtype=np.bool_)
        found = list[Gap]()
        low = self.good & (self.smooth < INK * self.noise.middle)
        for first, last in stretches_of(low, self.ways.run):
            own = slice(first, last + 1)
            shown = ~self.inferred[own]
            least = -max(0.6, 5.0 * self.noise.bath) * self.noise.middle
            if shown.any() and float(self.present[own][shown].mean()) < least:
                unclear[own] = True
                continue
            parts = [(first, last)]
            if strange[own].mean() > _HIDDEN:
                unclear[own] = True
                parts = self._open_parts(strange, first, last)
            for part in parts:
                gap = self._gap(*part)
                if gap is not None:
                    unclear[part[0] : part[1] + 1] = False
                    found.append(gap)
        return found, unclear

    def _open_parts(self, strange: FloatArray, first: int, last: int) -> list[tuple[int, int]]:
        """Return what a low stretch has between sound ink and a strange thing that hides the rest.

        What lies between two strange places may be the middle of a thing as bright as the bath (a
        needle between its edges).
        """
        odd = first + np.flatnonzero(strange[first : last + 1] > 0)
        parts = []
        for begin, end, beside in (
            (first, int(odd[0]) - 1, first - 1),
            (int(odd[-1]) + 1, last, last + 1),
        ):
            inside = 0 <= beside < len(self.ways) and self.ways.run[beside] == self.ways.run[first]
            width = float(self.ways.width[first])
            long = (end - begin + 1) * float(self.ways.step[first]) > _BESIDE * width
            if inside and long and self.good[beside] and self.smooth[beside] > INK:
                parts.append((begin, end))
        return parts

    def _gap(self, first: int, last: int) -> Gap | None:
        """Return a stretch as a gap; None where it may be ink by chance, or a line's end."""
        ways, noise, rows = self.ways, self.noise, slice(first, last + 1)
        level = INK * noise.middle
        begin, end = _ends(self.smooth, self.good, ways, first, last, level)
        shown = ~self.inferred[rows]
        if not shown.any() or _only_an_end(ways, rows, end - begin, self.gap_mm):
            return None
        told_mm = end - begin - float(ways.step[rows][~shown].sum())
        evened = noise.middle + self.strength[rows] * (self.present[rows] - noise.middle)
        p_value = noise.p_value(float(evened[shown].mean()), told_mm)
        if end - begin < LEAST * self.gap_mm or p_value > self.p_needed:
            return None
        u = float(np.hypot(ways.step[first] / np.sqrt(12), _end_noise(noise) * self.gap_mm))
        return _gap(ways, first, last, begin, end, u, p_value)


def _count(ways: Ways, length_mm: float) -> int:
    """Places in a stretch, an odd number."""
    return max(1, round(length_mm / float(np.median(ways.step)))) | 1


def _along(present: FloatArray, good: BoolArray, ways: Ways, gap_mm: float) -> FloatArray:
    """Presence averaged over a few neighbours of the same run that are seen."""
    count = max(1, round(_SMOOTH * gap_mm / float(np.median(ways.step)))) | 1
    if count == 1:
        return present
    out = np.array(present)
    weight = good.astype(np.float64)
    total = uniform_filter1d(np.where(good, present, 0.0), count, mode="nearest")
    share = uniform_filter1d(weight, count, mode="nearest")
    half = count // 2
    same = np.ones(len(ways), dtype=np.bool_)
    same[half:] &= ways.run[half:] == ways.run[: len(ways) - half]
    same[: len(ways) - half] &= ways.run[half:] == ways.run[: len(ways) - half]
    use = same & (share > 0.3)
    out[use] = total[use] / share[use]
    return out


def _ends(
    smooth: FloatArray, good: BoolArray, ways: Ways, first: int, last: int, level: float
) -> tuple[float, float]:
    """Where presence crosses the level, mm along the stroke; the run's end where it doesn't."""
    ends = []
    for row, by in ((first, -1), (last, 1)):
        beside = row + by
        half = 0.5 * float(ways.step[row])
        if 0 <= beside < len(ways) and ways.run[beside] == ways.run[row] and good[beside]:
            rise = float(smooth[beside] - smooth[row])
            part = (level - float(smooth[row])) / rise if rise > 0 else 0.5
            ends.append(float(ways.along[row]) + by * 2 * half * min(max(part, 0.0), 1.0))
        else:
            ends.append(float(ways.along[row]) + by * half)
    return ends[0], ends[1]


def _only_an_end(ways: Ways, rows: slice, length: float, gap_mm: float) -> bool:
    """Whether a stretch is no more than a bead that ends a little early, within tolerance."""
    nearest = float(ways.to_end[rows].min())
    width = float(ways.width[rows].max())
    return nearest < END * width and length < min(END * width + LEAST * gap_mm, gap_mm)


def _end_noise(noise: WindowNoise) -> float:
    """Of a gap's tolerated length, by which noise moves its end."""
    return float(noise.spread[0]) * _SMOOTH


def _gap(
    ways: Ways, first: int, last: int, begin: float, end: float, u: float, p_value: float
) -> Gap:
    places = []
    for row, at in ((first, begin), (last, end)):
        ahead = np.array([ways.normal[row, 1], -ways.normal[row, 0]])
        x, y = ways.point[row, :2] + (at - ways.along[row]) * ahead
        places.append((float(x), float(y)))
    return Gap(int(ways.stroke[first]), begin, end, places[0], places[1], u, p_value)


def stretch_gap(ways: Ways, first: int, last: int) -> Gap:
    """Places from ``first`` to ``last`` as a stretch, of which no chance is known."""
    begin, end = (
        float(ways.along[k] + by * ways.step[k]) for k, by in ((first, -0.5), (last, 0.5))
    )
    return _gap(ways, first, last, begin, end, float(ways.step[first]), 1.0)


def merged(gaps: list[Gap], ways: Ways) -> tuple[Gap, ...]:
    """Gaps in order, those of one stroke that are nearer than half a width as one."""
    out: list[Gap] = []
    for gap in sorted(gaps, key=lambda one: (one.stroke, one.from_mm)):
        before = out[-1] if out else None
        if before and before.stroke == gap.stroke:
            near = 0.5 * float(ways.width[ways.stroke == gap.stroke].max())
            if gap.from_mm - before.to_mm < near:
                out[-1] = Gap(
                    gap.stroke, before.from_mm, gap.to_mm, before.start_mm, gap.end_mm,
                    max(before.u_tip_mm, gap.u_tip_mm), min(before.p_value, gap.p_value),
                    shaded=before.shaded or gap.shaded,
                )  # fmt: skip
                continue
        out.append(gap)
    return tuple(out)


def inside(gaps: list[Gap], ways: Ways) -> BoolArray:
    """Places inside gaps, (n,)."""
    out = np.zeros(len(ways), dtype=np.bool_)
    for gap in gaps:
        own = ways.stroke == gap.stroke
        out |= own & (ways.along > gap.from_mm) & (ways.along < gap.to_mm)
    return out


def lit_along(
    gap: Gap,
    ways: Ways,
    angle: FloatArray,
    present: FloatArray,
    clear: BoolArray,
    why: IntArray,
) -> bool:
    """Whether other lines of the gap's direction show no ink either; marks that as unclear.

    Under light from the side a line of one direction may be as bright as the bath.
    """
    rows = (ways.stroke == gap.stroke) & (ways.along > gap.from_mm) & (ways.along < gap.to_mm)
    if not rows.any():
        return False
    own = np.exp(1j * angle[rows]).mean()
    alike = clear & ~rows & (np.real(np.exp(1j * angle) * np.conj(own)) > _ALIKE * abs(own))
    if alike.sum() >= _FEWEST_ALIKE and (present[alike] > INK).mean() > _LEAST_ALIKE:
        return False
    why[rows] = int(Unseen.UNCLEAR)
    return True


def shift_along(gap: Gap, ways: Ways, shift: Shift) -> float:
    """Standard uncertainty of the layer's place along the line at a gap's ends, the larger, mm."""
    own = np.flatnonzero(ways.stroke == gap.stroke)
    at = [own[np.abs(ways.along[own] - end).argmin()] for end in (gap.from_mm, gap.to_mm)]
    ahead = np.column_stack([ways.normal[at, 1], -ways.normal[at, 0]])
    power = np.einsum("ij,jk,ik->i", ahead, shift.covariance_mm2, ahead)
    return float(np.sqrt(max(power.max(), 0.0)))
