"""Patches of a gap: stretches of the job's own path, free of voids and of ink in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.observe.mending.held_print import LEAST_MM, WAY_MM, HeldPrint, WrittenPath
from printctl.observe.mending.laid_ink import Gap, LaidInk, NotMended, width_with_more
from printctl.observe.mending.obstacles import (
    NeedleRows,
    Voids,
    ink_in_voids_mm,
    shaft_contacts,
    under_higher_ink,
)

OVERLAP_WIDTHS: Final = 1.0
"""How far a patch begins and ends on sound ink, and a wipe leads on, in widths of its line."""
VOID_TOLERANCE_MM: Final = 0.05
"""How far ink may reach into a void, rounding of motor steps included."""
CLEARANCE_MM: Final = 0.05
"""Kept between the needle and ink that stands in its way."""
_MAX_PATCH_OFFSET_MM: Final = 0.02
"""Largest offset of a patch from the seen line."""
_MIN_PATCH_MM: Final = 0.05
"""Shorter stretches aren't worth a descent of the needle."""
_MAX_STATION_SPACING_MM: Final = 0.1
"""Largest distance between checked places; half a line's width if that is less."""
_MAX_ROUNDED_STEPS: Final = 40
"""Plunger steps below which a patch is rounded to whole ones: one step shows."""
_MAX_MISSING_STEP: Final = 0.1
"""Share of a step that may be missing."""

_VOID_REASON: Final = (
    "ink there would reach into a lumen by more than the tolerance; the lumen stays open instead: "
    "judge by the final scan whether the wall holds"
)
_SHORT_REASON: Final = "what could be reached of it is shorter than a patch is worth (least_mm)"
_UNDER_LAYER_REASON: Final = (
    "ink of a later layer lies above it, and the needle would go through: mend by hand, or print "
    "the part again; look at every layer to find gaps sooner"
)
_UNDER_OTHER_REASON: Final = (
    "another filament lies above it, and the needle would go through: mend by hand, or print the "
    "part again; look at every vessel to find gaps sooner"
)
_UNDER_OWN_REASON: Final = (
    "sound ink of the same path stands above it, too steep for the needle: mend by hand, or print "
    "the part again"
)


@dataclass(frozen=True, eq=False)
class Patch:
    """Stretch of a path to write again.

    Attributes
    ----------
    gap : Gap
    path : WrittenPath
    from_mm, to_mm : float, mm
        Along the path, overlaps included.
    flow : float
        Ink over the path's own; 1 but for a second pass and for whole motor steps.
    backwards : bool
        Whether it is written from its end to its beginning.
    """

    gap: Gap
    path: WrittenPath
    from_mm: float
    to_mm: float
    flow: float = 1.0
    backwards: bool = False

    @property
    def before_mm(self) -> float:
        """Overlap on sound ink before the gap, mm."""
        return max(0.0, self.gap.from_mm - float(self.cuts[0]))

    @property
    def beyond_mm(self) -> float:
        """Overlap on sound ink behind the gap, mm."""
        return max(0.0, float(self.cuts[-1]) - self.gap.to_mm)

    @property
    def cuts(self) -> FloatArray:
        """Ways along the path of its points, in the path's direction, mm."""
        spare = max(0.0, self.gap.from_mm - self.from_mm), max(0.0, self.to_mm - self.gap.to_mm)
        return self.path.cuts(self.from_mm, self.to_mm, LEAST_MM, spare)

    def moves(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return points (m + 1, 3) mm, E (m,) mm and feed (m,) mm/s, in the order of writing."""
        cuts = self.cuts
        piece = self.path.piece((cuts[:-1] + cuts[1:]) / 2)
        points = self.path.at(cuts)
        more = self.flow * self.gap.flow
        e = self.path.e_per_mm[piece] * np.diff(cuts) * more
        feed = self.path.feed_mm_s[piece] / max(more, 1.0)  # the plunger goes no faster
        if self.backwards:
            return points[::-1], e[::-1], feed[::-1]
        return points, e, feed

    def in_whole_steps(self, steps_per_mm: float, low: float, high: float) -> list[Patch]:
        """Return the patch in variants of whole plunger steps, the best first.

        A gap of 0.2 mm is about one step of a usual plunger: between two patches of equal E the
        motor makes one step more or less. Overlaps of a whole gap's patch grow up to ``low`` and
        ``high`` (mm along the path), and what is left over is added to the flow; else a step less
        comes nearer.
        """
        steps = float(self.moves()[1].sum()) * steps_per_mm
        if not 0 < steps < _MAX_ROUNDED_STEPS:
            return [self]
        whole = max(1.0, np.ceil(steps - _MAX_MISSING_STEP))
        last = float(self.path.e_per_mm[self.path.piece(np.array([self.to_mm]))[0]])
        wanted = max(0.0, (whole - steps) / steps_per_mm / (last * self.flow * self.gap.flow))
        begin = max(low, self.from_mm - wanted / 2)
        end = min(high, self.to_mm + wanted - (self.from_mm - begin))
        longer = replace(self, from_mm=begin, to_mm=end) if self.gap.whole else self
        taken = float(longer.moves()[1].sum()) * steps_per_mm
        made = [replace(longer, flow=self.flow * whole / taken)]
        if whole > 1.0:
            made.append(replace(self, flow=self.flow * (whole - 1.0) / steps))
        return sorted(made, key=lambda one: abs(np.log(one.flow / self.flow)))


@dataclass(frozen=True, eq=False)
class Site:
    """Surroundings of a patch: print, paths, ink, voids and gaps.

    Attributes
    ----------
    held_print : HeldPrint
    paths : tuple of WrittenPath
    ink : LaidInk
        What lies there: paths without their gaps.
    voids : Voids
    gaps : sequence of Gap
        As they were seen, not joined: what lies between them is sound.
    """

    held_print: HeldPrint
    paths: Sequence[WrittenPath]
    ink: LaidInk
    voids: Voids
    gaps: Sequence[Gap]


def patches_of(gap: Gap, site: Site) -> tuple[list[Patch], list[NotMended]]:
    """Return the patches that mend a gap, and the stretches that stay as they are."""
    path = site.paths[gap.path]
    if why := _refused_second_pass(gap, path, site.held_print):
        return [], [gap.left(why)]
    overlap = OVERLAP_WIDTHS * path.usual_width(gap.from_mm, gap.to_mm) * gap.whole
    low, high = path.clear_of_corners(
        max(0.0, gap.from_mm - overlap), min(path.length_mm, gap.to_mm + overlap)
    )
    # In layers overlaps may grow to whole motor steps; in a bath flow alone makes them whole.
    spare = OVERLAP_WIDTHS * float(path.width_mm.max()) * (gap.whole and site.held_print.layered)
    along = _stations(path, max(0.0, low - spare), min(path.length_mm, high + spare), site)
    in_void = _in_voids(along, path, site)
    blocked, backwards, reach = _out_of_reach(along, path, site)
    left = [
        *_remaining(gap, along, in_void, _VOID_REASON),
        *_remaining(gap, along, blocked & ~in_void, reach),
    ]
    patches = []
    for begin, end in _runs(~in_void & ~blocked):
        first, last = float(along[begin]), float(along[end])
        inner = replace(gap, from_mm=max(first, gap.from_mm), to_mm=min(last, gap.to_mm))
        if inner.length_mm < min(_MIN_PATCH_MM, gap.length_mm) * (1 - 1e-9):
            continue
        flow = 1.0 if gap.whole else gap.missing
        one = Patch(inner, path, max(first, low), min(last, high), flow, backwards)
        steps = one.in_whole_steps(site.held_print.printer.steps_per_mm.e, first, last)
        free = (each for each in steps if not _reaches_void(each, site))
        if (made := next(free, None)) is not None:
            patches.append(made)
        else:
            left.append(inner.left(_VOID_REASON))
    if not patches and not left:
        left = [gap.left(_SHORT_REASON)]
    return patches, left


def _refused_second_pass(gap: Gap, path: WrittenPath, held_print: HeldPrint) -> str:
    """Return why a thin stretch can't be filled up; empty if it can.

    A line that is wider than high stands as high as the tip: what a second pass brings goes to its
    sides, which is what the bead model says of more ink. A narrower one may stand lower.
    """
    do = "correct the flow of what is still to be written"
    if gap.whole:
        return ""
    if not held_print.layered:
        return (
            f"{gap.missing:.0%} of the ink is missing, and the rest is in the way of a second "
            f"pass: a second filament would lie beside the first; {do}"
        )
    piece = path.piece(np.array([gap.from_mm, gap.to_mm]))
    width, height = path.width_mm[piece].min(), path.height_mm[piece].min()
    section = held_print.ink.bead_section
    if section.width((1.0 - gap.missing) * section.area(width, height), height) >= height:
        return ""
    return (
        f"{gap.missing:.0%} of the ink is missing, and a line so narrow may stand lower than its "
        f"layer (a camera doesn't see its height); {do}"
    )


def _stations(path: WrittenPath, low: float, high: float, site: Site) -> FloatArray:
    """Return ways along a stretch, including the ends of its gaps, (m,), mm."""
    step = min(_MAX_STATION_SPACING_MM, path.usual_width(low, high) / 2)
    even = np.linspace(low, high, max(2, int(np.ceil((high - low) / step)) + 1))
    ends = [(one.from_mm, one.to_mm) for one in site.gaps if one.path == path.number]
    return np.unique(np.concatenate([even, np.clip(np.ravel(ends), low, high)]))


def _in_voids(along: FloatArray, path: WrittenPath, site: Site, flow: float = 1.0) -> BoolArray:
    """Return stations where ink, sound ink included, would reach into a void, (m,)."""
    piece = path.piece(along)
    width, height = path.width_mm[piece], path.height_mm[piece]
    sound = np.ones(len(along), dtype=bool)
    for one in site.gaps:
        if one.path == path.number:
            sound &= (along < one.from_mm) | (along > one.to_mm)
    width = width_with_more(width, height, flow + sound, site.held_print)
    layered = site.held_print.layered
    depth = ink_in_voids_mm(site.voids, path.at(along), width, height, layered=layered)
    return np.asarray(depth + _MAX_PATCH_OFFSET_MM > VOID_TOLERANCE_MM)


def _reaches_void(patch: Patch, site: Site) -> bool:
    along = _stations(patch.path, float(patch.cuts[0]), float(patch.cuts[-1]), site)
    more = patch.flow if patch.gap.whole else 1.0  # a second pass brings what is missing
    return bool(_in_voids(along, patch.path, site, more).any())


def _out_of_reach(along: FloatArray, path: WrittenPath, site: Site) -> tuple[BoolArray, bool, str]:
    """Return stations out of the needle's reach, (m,), whether to go backwards, and why.

    In a bath the shaft stands above the tip, so that one direction may be free where the other
    isn't; the path's own is taken where both are alike.
    """
    if site.held_print.layered:
        needle = site.held_print.needle
        blocked = under_higher_ink(path.at(along), site.ink, needle, CLEARANCE_MM)
        return blocked, False, _UNDER_LAYER_REASON
    ahead, reason = _crossed_stations(along, path, site)
    if not ahead.any():
        return ahead, False, reason
    back, other = _crossed_stations(along[::-1], path, site)
    turned = bool(back.sum() < ahead.sum())
    return (back[::-1], True, other) if turned else (ahead, False, reason)


def _crossed_stations(along: FloatArray, path: WrittenPath, site: Site) -> tuple[BoolArray, str]:
    """Return stations at which the shaft crosses written ink, in the order of writing, (m,)."""
    piece = path.piece((along[:-1] + along[1:]) / 2)
    volume = np.pi / 4 * path.width_mm[piece] ** 2 * np.abs(np.diff(along))
    own = np.full(len(volume), path.number, dtype=np.int64)
    rows = NeedleRows(path.at(along), volume, own)
    crossed, others = np.zeros(len(along), dtype=bool), False
    needle = site.held_print.needle
    for row, contact in shaft_contacts(rows, site.ink, site.paths, needle, CLEARANCE_MM):
        crossed[row : row + 2] = True
        others |= contact.crossed != path.number
    return crossed, _UNDER_OTHER_REASON if others else _UNDER_OWN_REASON


def _remaining(gap: Gap, along: FloatArray, bad: BoolArray, reason: str) -> list[NotMended]:
    """Return the stretches of a gap that stay, each to the middle between its stations."""
    edges = np.concatenate([along[:1], (along[1:] + along[:-1]) / 2, along[-1:]])
    spans = [
        (max(gap.from_mm, float(edges[begin])), min(gap.to_mm, float(edges[end + 1])))
        for begin, end in _runs(bad)
    ]
    return [NotMended(gap.path, low, high, reason) for low, high in spans if high > low]


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def wipe_way(patch: Patch, others: Sequence[Patch], site: Site) -> FloatArray:
    """Return the points of a wipe along sound ink that frees the needle, (k, 3), mm.

    The way is the patch's path behind it, up to the path's end and the next patch; none in a bath,
    or where ink of a later layer stands in the needle's way.
    """
    path, begin, none = patch.path, patch.to_mm, np.zeros((0, 3))
    wanted = begin + OVERLAP_WIDTHS * float(path.width_mm.max())
    ahead = [one.from_mm for one in others if one.path is path and one.from_mm >= begin]
    end = min([wanted, path.length_mm, *ahead])
    if not site.held_print.layered or patch.backwards or end - begin < WAY_MM:
        return none
    along = np.linspace(begin, end, max(2, int((end - begin) / _MAX_STATION_SPACING_MM) + 1))
    if under_higher_ink(path.at(along), site.ink, site.held_print.needle, CLEARANCE_MM).any():
        return none
    return path.at(path.cuts(begin, end)[1:])
