"""Sum up which stretches of what was written surely have ink, by all that a picture tells."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray
from registration.inspection.findings import ToldOfInk
from registration.inspection.gaps.gaps import stretch_gap
from registration.inspection.ink.presence import INK
from registration.inspection.over_ink.older_pattern import older_pattern_shows, only_crossed
from registration.inspection.over_ink.thin_change import ThinChange, thin_by_change
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.values import Gap, Unseen
from registration.inspection.ways import stretches_of

_LEAST: Final = 3.0
"""Widths of a stretch that is told as changed or still: change is averaged over as many, so that a
highlight that came or went changes no longer one."""


_DOUBTED: Final = 0.3
"""Of a stretch that changed, at which its level looks bare though that isn't sure: the shade of
lines that touch and glints change a bare one, too, and whether ink came isn't told."""


def thin_without_width(look: SeenLayer) -> ThinChange:
    """What the change tells of thin ink, where no width tells it."""
    none = np.zeros(len(look.ways), dtype=np.bool_)
    if look.change is None:
        return ThinChange(none, none)
    told = thin_by_change(look.change, look.ways, look.seen, look.masks.old)
    by_width = np.isfinite(look.widths.width_mm)[look.group.of]
    return ThinChange(told.thin & ~by_width, told.told | by_width)


def told_by_all(look: SeenLayer, good: BoolArray, faint: BoolArray, thin: ThinChange) -> ToldOfInk:
    """Return it for places that are seen, ``good`` (n,), or shown too faint for short gaps."""
    ways, none = look.ways, np.zeros_like(good)
    ink = (good | faint) & (look.present > INK)
    least = _LEAST * float(np.median(ways.width))
    came = none if look.change is None else look.change.came & ~good & ~faint
    bare = (look.why == Unseen.SEEN) & ~good & (look.present < INK)
    changed = _longer(look, came, least)
    came = _without_doubt(look, changed, bare)
    came &= ~_older_shows(look)
    still = none if look.change is None else look.change.still & ~good & ~faint
    any_ink = ink | came
    rows = np.flatnonzero(any_ink)
    first, last = (int(rows[0]), int(rows[-1])) if len(rows) else (len(ways), -1)
    behind = np.arange(len(ways)) > last
    return ToldOfInk(
        came_mm=float(ways.step[came].sum()),
        ink_mm=float(ways.step[any_ink].sum()),
        head_mm=float(ways.step[:first].sum()),
        still=tuple(one for one in _stretches(look, still) if one.length_mm > least),
        untold=_stretches(look, ~good & ~faint & ~came),
        tail=_stretches(look, behind & ~good),
        unseen=_stretches(look, ~good & ~faint),
        doubted=_stretches(look, _mostly(look, ~good & ~faint & ~came, changed)),
        thin=_stretches(look, _longer(look, thin.thin, least)),
        thin_untold_mm=float(ways.step[came & ~thin.told].sum()),
    )


def _older_shows(look: SeenLayer) -> BoolArray:
    """Places across which the pattern of older lines shows as before, (n,)."""
    change = look.change
    if change is None or change.older is None:
        return np.zeros(len(look.ways), dtype=np.bool_)
    known = change.over_old & np.isfinite(change.anyway)
    crossed = only_crossed(look.moved, change.older)
    return older_pattern_shows(look.work, look.ways, look.seen, crossed & known)


def _longer(look: SeenLayer, rows: BoolArray, least_mm: float) -> BoolArray:
    """Places that lie on stretches of more than ``least_mm``, (n,)."""
    out = np.zeros_like(rows)
    for first, last in stretches_of(rows, look.ways.run):
        out[first : last + 1] = stretch_gap(look.ways, first, last).length_mm > least_mm
    return out


def _without_doubt(look: SeenLayer, rows: BoolArray, bare: BoolArray) -> BoolArray:
    """Places that lie on stretches of which too little looks ``bare``, (n,)."""
    out = rows.copy()
    for first, last in stretches_of(rows, look.ways.run):
        own = slice(first, last + 1)
        out[own] = bare[own].mean() < _DOUBTED
    return out


def _mostly(look: SeenLayer, rows: BoolArray, part: BoolArray) -> BoolArray:
    """Places that lie on stretches at half of which another thing holds, (n,)."""
    out = np.zeros_like(rows)
    for first, last in stretches_of(rows, look.ways.run):
        own = slice(first, last + 1)
        out[own] = 2.0 * part[own].mean() > 1.0
    return out


def _stretches(look: SeenLayer, rows: BoolArray) -> tuple[Gap, ...]:
    return tuple(
        stretch_gap(look.ways, first, last) for first, last in stretches_of(rows, look.ways.run)
    )
