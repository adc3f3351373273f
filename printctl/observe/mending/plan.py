"""Plan a mend of a held print's gaps, write it as G-code, return it if it passes the check."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from design.toolpath.gcode.table import decimals_for, dialect_of
from gcode.clearance.check import ShaftContact
from gcode.program.read_program import read_written
from kernels.arrays import FloatArray
from printctl.observe.mending.check import MendCheck, check_mend, needle_rows
from printctl.observe.mending.held_print import WAY_MM, HeldPrint, written_paths
from printctl.observe.mending.laid_ink import Gap, NotMended, check_gaps, laid_ink, merge_gaps
from printctl.observe.mending.obstacles import Voids, open_voids, shaft_contacts
from printctl.observe.mending.patches import CLEARANCE_MM, Patch, Site, patches_of, wipe_way

_MERGE_WIDTHS: Final = 2.0
"""Gaps of a path nearer to each other, in widths of its line, are one."""
_SAME_DEPTH_MM: Final = 0.05
"""Patches that lie no deeper than this are ordered by their travel."""
_MIN_PUSH_E_MM: Final = 1e-6
_MIN_LIFT_MM: Final = 0.2
_BATH_LIFT_MM: Final = 0.5
"""Height of travels above all ink; of layers two of them, if that is more."""


@dataclass(frozen=True, eq=False)
class Mend:
    """G-code insert that mends gaps.

    Attributes
    ----------
    lines : tuple of bytes
        To be inserted where the print is held; none where nothing can be mended.
    patches : tuple of Patch
        In the order in which they are written.
    left : tuple of NotMended
    volume_ul : float, µL
        Ink that comes out of the needle.
    """

    lines: tuple[bytes, ...]
    patches: tuple[Patch, ...]
    left: tuple[NotMended, ...]
    volume_ul: float

    def sentences(self) -> list[str]:
        """Return sentences on the mend for the operator."""
        sentences = [
            f"path {p.path.number}: {p.gap.length_mm:.2f} mm written again, with {p.before_mm:.2f} "
            f"and {p.beyond_mm:.2f} mm on sound ink"
            for p in self.patches
        ]
        if self.patches:
            sentences.append(f"{self.volume_ul:.3f} µL of ink")
        return sentences + [
            f"path {one.path}: {one.length_mm:.2f} mm not mended: {one.reason}" for one in self.left
        ]

    def left_words(self) -> str:
        """Return how much isn't mended, by reason; empty for nothing."""
        ways = defaultdict[str, float](float)
        for one in self.left:
            ways[one.reason] += one.length_mm
        return "; ".join(f"{way:.2f} mm ({reason})" for reason, way in ways.items())


def checked_mend(
    held_print: HeldPrint, gaps: Sequence[Gap], voids: Voids | None = None
) -> tuple[Mend, MendCheck | None]:
    """Return a mend that may be inserted, and its check; no check where nothing is mended.

    A mend that fails its check has no lines: all of its patches are left, with the reason.
    Parameters and errors are those of `plan_mend`.
    """
    mend = plan_mend(held_print, gaps, voids)
    if not mend.lines:
        return mend, None
    check = check_mend(held_print, mend.lines, gaps, voids)
    if check.passed:
        return mend, check
    why = (
        f"the check of its injected G-code failed ({check.failures}); mend by hand, and report this"
    )
    own = [one.gap.left(why) for one in mend.patches]
    return Mend((), (), (*mend.left, *own), 0.0), check


def plan_mend(held_print: HeldPrint, gaps: Sequence[Gap], voids: Voids | None = None) -> Mend:
    """Plan the insert that mends gaps of a held print.

    Each patch is the job's own path of the missing stretch: its height, corners, speed and
    plunger over way, with an overlap on sound ink at both ends. What can't be mended is in
    `Mend.left`, with the reason.

    Parameters
    ----------
    held_print : HeldPrint
    gaps : sequence of Gap
    voids : Voids, optional
        What the design keeps open.

    Raises
    ------
    MendError
        For gaps that aren't on written paths.
    """
    paths = written_paths(held_print)
    check_gaps(gaps, paths)
    joined = merge_gaps(gaps, paths, _MERGE_WIDTHS)
    ink = laid_ink(paths, gaps)  # what lies between joined gaps is in the needle's way
    around = np.vstack([np.zeros((0, 3)), *(paths[gap.path].points for gap in joined)])
    kept_open = open_voids(
        voids or Voids.none(), held_print, around, float(ink.width_mm.max(initial=0))
    )
    site = Site(held_print, paths, ink, kept_open, gaps)
    each = [patches_of(gap, site) for gap in joined]
    patches = _order_patches([patch for own, _ in each for patch in own], held_print)
    left = [one for _, own in each for one in own]
    while patches:
        lines, ends = _write_insert(patches, site)
        found = None if held_print.layered else _first_crossing(lines, patches, ends, site)
        if found is None:
            volume = sum(float(one.moves()[1].sum()) for one in patches) * held_print.ul_per_e
            return Mend(tuple(lines), tuple(patches), tuple(left), volume)
        number, reason = found
        left.append(patches.pop(number).gap.left(reason))
    return Mend((), (), tuple(left), 0.0)


def _order_patches(patches: Sequence[Patch], held_print: HeldPrint) -> list[Patch]:
    """Return patches in order: nearest next; in a bath the deepest first."""
    rest, in_order, at = list(patches), [], held_print.at_mm
    low = {id(one): float(one.path.at(one.cuts)[:, 2].min()) for one in rest}
    while rest:
        near = rest
        if not held_print.layered:
            deepest = min(low[id(one)] for one in rest)
            near = [one for one in rest if low[id(one)] <= deepest + _SAME_DEPTH_MM]
        begins = [one.moves()[0][0] for one in near]
        chosen = near[int(np.argmin([np.linalg.norm(p - at) for p in begins]))]
        in_order.append(chosen)
        at = chosen.moves()[0][-1]
        rest.remove(chosen)
    return in_order


def _write_insert(patches: Sequence[Patch], site: Site) -> tuple[list[bytes], list[int]]:
    """Return the insert's lines and the line behind each patch."""
    held_print = site.held_print
    layer = max(float(one.path.height_mm.max()) for one in patches)
    tops = [float(one.path.points[:, 2].max()) for one in patches]
    top = max(site.ink.top_mm(layered=held_print.layered), float(held_print.at_mm[2]), *tops)
    lift = max(_MIN_LIFT_MM, 2 * layer) if held_print.layered else _BATH_LIFT_MM
    writer = _InsertWriter(held_print, min(top + lift, held_print.printer.z_mm.high))
    ends = [writer.patch(one, wipe_way(one, patches, site)) for one in patches]
    writer.end()
    return writer.lines, ends


def _first_crossing(
    lines: Sequence[bytes], patches: Sequence[Patch], ends: Sequence[int], site: Site
) -> tuple[int, str] | None:
    """Return the first patch whose way takes the needle through ink in a bath, and why.

    None if the whole way is free.
    """
    held_print = site.held_print
    text = b"\n".join([*held_print.lines[: held_print.done], *lines]) + b"\n"
    program = read_written(text, held_print.printer, held_print.start_mm).program
    rows = needle_rows(program, held_print, len(lines), site.paths)
    contacts = shaft_contacts(
        rows, site.ink, site.paths, held_print.needle, CLEARANCE_MM, held_print.at_mm
    )
    if not contacts:
        return None
    row, contact = min(contacts, key=lambda one: one[0])
    number = next((k for k, end in enumerate(ends) if row <= end + 1), len(ends) - 1)
    own = [k for k, one in enumerate(patches) if one.path.number == contact.crossed]
    if row > ends[-1] + 1 and own:
        number = own[-1]  # on the way back it is the patch's ink that is in the way
    return number, _contact_words(contact)


def _contact_words(contact: ShaftContact) -> str:
    x, y, z = contact.place_mm
    return (
        f"the needle would go {contact.depth_mm:.3f} mm into written ink at x {x:.2f}, "
        f"y {y:.2f}, z {z:.2f} mm; mend by hand, or print on"
    )


class _InsertWriter:
    """Writer of an insert's lines, travelling at a height, mm."""

    def __init__(self, held_print: HeldPrint, high_mm: float) -> None:
        self.lines: list[bytes] = []
        self._held, self._high = held_print, high_mm
        self._digits = decimals_for(held_print.printer)
        self._dialect = dialect_of(held_print.printer)
        self._at, self._e = held_print.at_mm.copy(), held_print.e_mm
        self._relief = max(held_print.relief_e, held_print.relieved_e)
        self._feed = ""
        self._push(held_print.relieved_e - self._relief)
        self._rise()

    def patch(self, patch: Patch, wipe: FloatArray) -> int:
        """Write a patch and a wipe with the plunger relieved; return the line behind its ink."""
        points, e, feed = patch.moves()
        length = np.linalg.norm(np.diff(points, axis=0), axis=1)
        pressure = self._held.lag_s * e * feed / length
        self._go_xy(points[0])
        self._go_z(float(points[0, 2]))
        self._push(self._relief + float(pressure[0]))
        for place, more, speed in zip(points[1:], e, feed, strict=True):
            self._e += float(more)
            self._move(1, place, self._e, float(speed))
        end = len(self.lines)
        self._push(-self._relief - float(pressure[-1]))
        for place in wipe:
            self._move(1, place, None, float(feed[-1]))
        self._rise()
        return end

    def end(self) -> None:
        """Return to the held position, with plunger, count and feed as they were."""
        held_print = self._held
        self._go_xy(held_print.at_mm)
        self._go_z(float(held_print.at_mm[2]))
        self._push(self._relief - held_print.relieved_e)
        self.lines.append(b"G92 E%b" % self._number(held_print.e_mm, self._digits.e))
        if held_print.place.f is not None:
            self.lines.append(b"G1 F%b" % f"{held_print.place.f:.10g}".encode())

    def _rise(self) -> None:
        self._go_z(max(self._high, self._at[2]))

    def _go_xy(self, place: FloatArray) -> None:
        """Go across to a place at the height that the tip has."""
        target = np.array([place[0], place[1], self._at[2]])
        self._move(0, target, None, self._held.travel_mm_s)

    def _go_z(self, z_mm: float) -> None:
        target = np.array([self._at[0], self._at[1], z_mm])
        self._move(0, target, None, self._held.lift_mm_s)

    def _push(self, e_mm: float) -> None:
        """Move the plunger while the needle stands; back where it is below 0."""
        if abs(e_mm) > _MIN_PUSH_E_MM:
            self._e += e_mm
            self._add(1, b"E%b" % self._number(self._e, self._digits.e), self._held.plunger_mm_s)

    def _move(self, code: int, place: FloatArray, e: float | None, speed: float) -> None:
        """Move along the axes that change; nothing where none does."""
        digits = (self._digits.x, self._digits.y, self._digits.z)
        words = [
            axis + self._number(float(to), places)
            for axis, to, now, places in zip(
                (b"X", b"Y", b"Z"), place, self._at, digits, strict=True
            )
            if abs(to - now) > WAY_MM
        ]
        if not words and e is None:
            return
        if e is not None:
            words.append(b"E" + self._number(e, self._digits.e))
        self._at = np.asarray(place, dtype=np.float64).copy()
        self._add(code, b" ".join(words), speed)

    def _add(self, code: int, words: bytes, speed: float) -> None:
        """Add a line; its feed is never above a limit by its last digit."""
        places = self._dialect.feed_decimals
        whole = math.floor(speed * self._dialect.feed_s * 10**places + 1e-6)
        feed = f"{whole / 10**places:.{places}f}".rstrip("0").rstrip(".")
        changed = b"" if feed == self._feed else b" F" + feed.encode()
        self._feed = feed
        self.lines.append(b"G%d %b%b" % (code, words, changed))

    @staticmethod
    def _number(value: float, places: int) -> bytes:
        text = f"{value:.{places}f}"
        if places:
            text = text.rstrip("0").rstrip(".")
        return b"0" if text in ("-0", "") else text.encode()
