"""Find an insert's first move with the needle shaft in ink; leave that spot out of the mend.

For embedded prints only; `plan.py` calls it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from printctl.observe.mending.gap import NotMended
from printctl.observe.mending.held_print import WAY_MM, HeldPrint
from printctl.observe.mending.needle_way import NeedleRows, shaft_contacts
from printctl.observe.mending.options import MendOptions
from printctl.observe.mending.patch import Patch
from printctl.observe.mending.stretches import Site
from sim.gcode.clearance import ShaftContact
from sim.gcode.program.read_program import read_written

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
