"""Find the patchable stretches of a gap, their wipes, and a free first move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_profiles.bead import BeadSection
from kernels.arrays import BoolArray, FloatArray
from printctl.observe.mending.gap import Gap, NotMended
from printctl.observe.mending.held_print import WAY_MM, HeldPrint, WrittenPath
from printctl.observe.mending.laid_ink import LaidInk, width_with_more
from printctl.observe.mending.mend import MendOptions, Patch, in_whole_steps, nearest_steps
from printctl.observe.mending.needle_way import NeedleRows, shaft_contacts, under_higher_ink
from printctl.observe.mending.voids import Voids, ink_in_voids_mm
from sim.gcode.clearance import ShaftContact
from sim.gcode.program.read_program import read_written

_STATION_MM: Final = 0.1
"""Farthest between places that are looked at, and at most half a line's width."""


@dataclass(frozen=True, eq=False)
class Site:
    """What a patch is planned against.

    Attributes
    ----------
    held : HeldPrint
    paths : tuple of WrittenPath
    ink : LaidInk
        What lies there: paths without their gaps.
    voids : Voids
    options : MendOptions
    gaps : sequence of Gap
        As they were seen, not joined: what lies between them is sound.
    """

    held: HeldPrint
    paths: Sequence[WrittenPath]
    ink: LaidInk
    voids: Voids
    options: MendOptions
    gaps: Sequence[Gap]

    @property
    def layered(self) -> bool:
        """Whether lines are laid in layers."""
        return self.held.style == "layered"


def patches_of(gap: Gap, site: Site) -> tuple[list[Patch], list[NotMended]]:
    """Return the patches that mend a gap, and the stretches that stay as they are."""
    path, options = site.paths[gap.path], site.options
    flow, why = _second_pass(gap, path, site)
    if why:
        return [], [NotMended(gap.path, gap.from_mm, gap.to_mm, why)]
    overlap = options.overlap_widths * path.usual_width(gap.from_mm, gap.to_mm) * gap.whole
    low, high = path.clear_of_corners(
        max(0.0, gap.from_mm - overlap), min(path.length_mm, gap.to_mm + overlap)
    )
    along = _stations(path, low, high, site)
    in_void = _in_voids(along, gap, path, site)
    blocked, backwards, reach = _out_of_reach(along, path, site)
    free = ~in_void & ~blocked
    steps_per_mm = site.held.printer.steps_per_mm.e
    left = [*_left(gap, along, in_void, _VOID), *_left(gap, along, blocked & ~in_void, reach)]
    patches = []
    for begin, end in _runs(free):
        inner = replace(
            gap, from_mm=max(along[begin], gap.from_mm), to_mm=min(along[end], gap.to_mm)
        )
        if inner.length_mm < min(options.least_mm, gap.length_mm) * (1 - 1e-9):
            continue
        one = _patch(inner, path, along[begin], along[end], site)
        if one is None:
            left.append(NotMended(gap.path, inner.from_mm, inner.to_mm, _VOID))
        else:
            one = replace(one, flow=one.flow * flow, backwards=backwards)
            patches.append(one if gap.whole else nearest_steps(one, steps_per_mm))
    if not patches and not left:
        left = [NotMended(gap.path, gap.from_mm, gap.to_mm, _SHORT)]
    return patches, left


_VOID: Final = (
    "ink there would reach into a lumen by more than the tolerance; the lumen stays open instead: "
    "judge by the final scan whether the wall holds"
)
_SHORT: Final = "what could be reached of it is shorter than a patch is worth (least_mm)"
_UNDER_LAYER: Final = (
    "ink of a later layer lies above it, and the needle would go through: mend by hand, or print "
    "the part again; look at every layer to find gaps sooner"
)
_UNDER_OTHER: Final = (
    "another filament lies above it, and the needle would go through: mend by hand, or print the "
    "part again; look at every vessel to find gaps sooner"
)
_UNDER_OWN: Final = (
    "sound ink of the same path stands above it, too steep for the needle: mend by hand, or print "
    "the part again"
)


def _second_pass(gap: Gap, path: WrittenPath, site: Site) -> tuple[float, str]:
    """Flow of a patch over its path's, and why there can be none; empty where there can."""
    if gap.whole:
        return 1.0, ""
    thin = f"{gap.missing:.0%} of the ink is missing, and the rest is in the way of a second pass"
    do = "correct the flow of what is still to be written"
    if not site.layered:
        return 0.0, f"{thin}: a second filament would lie beside the first; {do}"
    piece = path.piece(np.array([gap.from_mm, gap.to_mm]))
    height = path.height_mm[piece].min()
    if gap.seen_height_mm is None:
        return _filling_up(gap, path.width_mm[piece].min(), height, site.held.ink.bead_section)
    room = float(height) - gap.seen_height_mm
    least = site.options.room_for_second_pass * float(height)
    if room < least:
        return 0.0, (
            f"{thin}: {max(room, 0):.3f} mm are free above it, and {least:.3f} mm are needed "
            f"(room_for_second_pass); {do}"
        )
    return gap.missing, ""


def _filling_up(
    gap: Gap, width_mm: float, height_mm: float, section: BeadSection
) -> tuple[float, str]:
    """Flow of a pass along a line whose height isn't seen, and why there can be none.

    A line that is wider than high stands as high as the tip: what a second pass brings goes to its
    sides, which is what the bead model says of more ink. A narrower one may stand lower.
    """
    left = (1.0 - gap.missing) * section.area(width_mm, height_mm)
    if section.width(left, height_mm) >= height_mm:
        return gap.missing, ""
    return 0.0, (
        f"{gap.missing:.0%} of the ink is missing, and a line so narrow may stand lower than its "
        "layer (a camera doesn't see its height); correct the flow of what is still to be written"
    )


def _stations(path: WrittenPath, low: float, high: float, site: Site) -> FloatArray:
    """Ways along a stretch, those where gaps in it begin and end among them, (m,), mm."""
    step = min(_STATION_MM, path.usual_width(low, high) / 2)
    even = np.linspace(low, high, max(2, int(np.ceil((high - low) / step)) + 1))
    ends = [(one.from_mm, one.to_mm) for one in site.gaps if one.path == path.number]
    return np.unique(np.concatenate([even, np.clip(np.ravel(ends), low, high)]))


def _in_voids(
    along: FloatArray, gap: Gap, path: WrittenPath, site: Site, flow: float = 1.0
) -> BoolArray:
    """Stations where ink would reach too far into a void, (m,); sound ink there counts, too."""
    piece = path.piece(along)
    width, height = path.width_mm[piece], path.height_mm[piece]
    sound = np.ones(len(along), dtype=bool)
    for one in site.gaps:
        if one.path == path.number:
            sound &= (along < one.from_mm) | (along > one.to_mm)
    width = width_with_more(width, height, flow + sound, site.held)
    depth = ink_in_voids_mm(site.voids, path.at(along), width, height, layered=site.layered)
    shift = gap.shift_mm + site.options.shift_mm
    return np.asarray(depth + shift > site.options.void_tolerance_mm)


def _out_of_reach(along: FloatArray, path: WrittenPath, site: Site) -> tuple[BoolArray, bool, str]:
    """Stations out of the needle's reach, (m,), whether it goes backwards, and what is in its way.

    In a bath the shaft stands above the tip, so that one direction may be free where the other
    isn't; the path's own is taken where both are alike.
    """
    if site.layered:
        held, clearance = site.held, site.options.clearance_mm
        blocked = under_higher_ink(path.at(along), site.ink, held.needle, clearance)
        return blocked, False, _UNDER_LAYER
    ahead, said = _crossed(along, path, site)
    if not ahead.any():
        return ahead, False, said
    back, other = _crossed(along[::-1], path, site)
    turned = bool(back.sum() < ahead.sum())
    return (back[::-1], True, other) if turned else (ahead, False, said)


def _crossed(along: FloatArray, path: WrittenPath, site: Site) -> tuple[BoolArray, str]:
    """Stations from or to which the shaft crosses written ink, in the order of writing, (m,)."""
    piece = path.piece((along[:-1] + along[1:]) / 2)
    volume = np.pi / 4 * path.width_mm[piece] ** 2 * np.abs(np.diff(along))
    own = np.full(len(volume), path.number, dtype=np.int64)
    rows = NeedleRows(path.at(along), volume, own)
    crossed, others = np.zeros(len(along), dtype=bool), False
    held, clearance = site.held, site.options.clearance_mm
    for row, contact in shaft_contacts(rows, site.ink, site.paths, held.needle, clearance):
        crossed[row : row + 2] = True
        others |= contact.crossed != path.number
    return crossed, _UNDER_OTHER if others else _UNDER_OWN


def _patch(gap: Gap, path: WrittenPath, low: float, high: float, site: Site) -> Patch | None:
    """A patch of a free stretch; None where its whole motor steps would reach into a void."""
    patch = Patch(gap, path, float(low), float(high))
    steps_per_mm = site.held.printer.steps_per_mm.e
    whole = in_whole_steps(patch, steps_per_mm, _room(patch, site)) if gap.whole else (patch,)
    for one in whole:
        along = _stations(path, float(one.cuts[0]), float(one.cuts[-1]), site)
        if not _in_voids(along, gap, path, site, one.flow).any():
            return one
    return None


def _room(patch: Patch, site: Site) -> tuple[float, float]:
    """How far a patch's overlaps may grow, mm along its path: one line's width more."""
    path, more = patch.path, site.options.overlap_widths * patch.path.width_mm.max()
    low = max(0.0, patch.from_mm - more) if patch.before_mm else patch.from_mm
    high = min(path.length_mm, patch.to_mm + more) if patch.beyond_mm else patch.to_mm
    along = _stations(path, low, high, site) if high > low else np.array([low, high])
    bad = _in_voids(along, patch.gap, path, site)
    if site.layered:
        bad |= _out_of_reach(along, path, site)[0]
    below = along[bad & (along < patch.from_mm)]
    above = along[bad & (along > patch.to_mm)]
    return (
        patch.from_mm if len(below) else low,
        patch.to_mm if len(above) or not site.layered else high,
    )


def _left(gap: Gap, along: FloatArray, bad: BoolArray, reason: str) -> list[NotMended]:
    """Stretches of the gap itself that stay, each to the middle between its stations."""
    remaining = []
    edges = np.concatenate([along[:1], (along[1:] + along[:-1]) / 2, along[-1:]])
    for begin, end in _runs(bad):
        low = max(gap.from_mm, edges[begin])
        high = min(gap.to_mm, edges[end + 1])
        if high > low:
            remaining.append(NotMended(gap.path, float(low), float(high), reason))
    return remaining


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last place of each run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


# Plan a wipe along sound ink after a patch that frees the needle of its ink thread.


def wipe_way(patch: Patch, others: Sequence[Patch], site: Site) -> FloatArray:
    """Return the points of a wipe, (k, 3), mm; none without room, or in a bath.

    The way is the patch's path behind it, for `MendOptions.wipe_widths`: up to the path's end, to
    the next patch, and only where no ink of a later layer stands in the needle's way.

    Parameters
    ----------
    patch : Patch
    others : sequence of Patch
        All of the mend.
    site : Site
    """
    path, begin, none = patch.path, patch.to_mm, np.zeros((0, 3))
    wanted = begin + site.options.wipe_widths * float(path.width_mm.max())
    ahead = [one.from_mm for one in others if one.path is path and one.from_mm >= begin]
    end = min([wanted, path.length_mm, *ahead])
    if not site.layered or patch.backwards or end - begin < WAY_MM:
        return none
    along = np.linspace(begin, end, max(2, int((end - begin) / _STATION_MM) + 1))
    held, clearance = site.held, site.options.clearance_mm
    if under_higher_ink(path.at(along), site.ink, held.needle, clearance).any():
        return none
    return path.at(path.cuts(begin, end)[1:])


# Find an insert's first move with the needle shaft in ink; leave that spot out of the mend.
#
# For embedded prints only; `plan.py` calls it.

Spans = list[tuple[int, int]]
"""Lines of an insert that write each patch: the first, and the one behind the last."""
_CUT_MM: Final = 0.2
"""Cut out of a patch to either side of a contact."""


@dataclass(frozen=True)
class Crossing:
    """Move of an insert that would take the needle through ink.

    Attributes
    ----------
    patch : int
        On whose account it is made.
    while_writing : bool
        Whether it writes that patch; else it is on the way there or back.
    contact : ShaftContact
    """

    patch: int
    while_writing: bool
    contact: ShaftContact

    @property
    def reason(self) -> str:
        """Return it in words, for the operator."""
        x, y, z = self.contact.place_mm
        return (
            f"the needle would go {self.contact.depth_mm:.3f} mm into written ink at x {x:.2f}, "
            f"y {y:.2f}, z {z:.2f} mm; mend by hand, or print on"
        )


def insert_rows(
    held: HeldPrint, lines: Sequence[bytes], patches: Sequence[Patch], spans: Spans
) -> NeedleRows:
    """Return an insert's lines as the needle's moves, read back from their text: a row each."""
    text = b"\n".join([*held.lines[: held.done], *lines]) + b"\n"
    program = read_written(text, held.printer, held.start_mm).program
    rows = np.flatnonzero(program.command >= held.done)
    tips = np.vstack([held.at_mm, program.target[rows, :3]])
    way = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    volume = np.where(way > WAY_MM, np.maximum(program.pushed[rows], 0.0) * held.ul_per_e, 0.0)
    path = np.full(len(rows), -1, dtype=np.int64)
    for one, (first, last) in zip(patches, spans, strict=True):
        path[first:last] = one.path.number
    return NeedleRows(tips, volume, path)


def first_crossing(
    lines: Sequence[bytes], patches: Sequence[Patch], spans: Spans, site: Site
) -> Crossing | None:
    """Return the first move that would take the needle through ink; None where none does."""
    held = site.held
    rows = insert_rows(held, lines, patches, spans)
    clearance = site.options.clearance_mm
    contacts = shaft_contacts(rows, site.ink, site.paths, held.needle, clearance, held.at_mm)
    if not contacts:
        return None
    row, contact = min(contacts, key=lambda one: one[0])
    number = next((k for k, span in enumerate(spans) if row <= span[1] + 1), len(spans) - 1)
    own = [k for k, one in enumerate(patches) if one.path.number == contact.crossed]
    if row > spans[-1][1] + 1 and own:
        number = own[-1]  # on the way back it is the patch's ink that is in the way
    return Crossing(number, spans[number][0] <= row < spans[number][1], contact)


def cut_out(
    patch: Patch, crossing: Crossing, options: MendOptions
) -> tuple[list[Patch], NotMended]:
    """Return what can still be written of a patch, and what is left of its gap."""
    gap = patch.gap
    whole = NotMended(gap.path, gap.from_mm, gap.to_mm, crossing.reason)
    if not crossing.while_writing:
        return [], whole
    along, _ = patch.path.nearest_mm(np.array(crossing.contact.tip_mm))
    pieces = []
    for low, high in ((patch.from_mm, along - _CUT_MM), (along + _CUT_MM, patch.to_mm)):
        inner = replace(gap, from_mm=max(low, gap.from_mm), to_mm=min(high, gap.to_mm))
        if inner.length_mm >= max(options.least_mm, WAY_MM):
            pieces.append(replace(patch, gap=inner, from_mm=low, to_mm=high))
    if not pieces:
        return [], whole
    low, high = max(gap.from_mm, along - _CUT_MM), min(gap.to_mm, along + _CUT_MM)
    return pieces, NotMended(gap.path, low, max(low, high), crossing.reason)
