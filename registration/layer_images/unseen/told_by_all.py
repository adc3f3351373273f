"""Sum up which stretches of what was written surely have ink, by all that a picture tells."""

from __future__ import annotations

from typing import Final

import numpy as np

from registration.layer_images.findings import ToldOfInk
from registration.layer_images.gaps.gaps import stretch_gap
from registration.layer_images.ink.presence import INK
from registration.layer_images.seen_layer import SeenLayer
from registration.layer_images.values import BoolArray, Gap
from registration.layer_images.ways import stretches_of

_LEAST: Final = 3.0
"""Widths of a stretch that is told as changed or still: change is averaged over as many, so that a
highlight that came or went changes no longer one."""


def told_by_all(look: SeenLayer, good: BoolArray, faint: BoolArray) -> ToldOfInk:
    """Return it for places that are seen, ``good`` (n,), or shown too faint for short gaps."""
    ways, none = look.ways, np.zeros_like(good)
    ink = (good | faint) & (look.present > INK)
    least = _LEAST * float(np.median(ways.width))
    came = none if look.change is None else look.change.came & ~good & ~faint
    came = _longer(look, came, least)
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
    )


def _longer(look: SeenLayer, rows: BoolArray, least_mm: float) -> BoolArray:
    """Places that lie on stretches of more than ``least_mm``, (n,)."""
    out = np.zeros_like(rows)
    for first, last in stretches_of(rows, look.ways.run):
        out[first : last + 1] = stretch_gap(look.ways, first, last).length_mm > least_mm
    return out


def _stretches(look: SeenLayer, rows: BoolArray) -> tuple[Gap, ...]:
    return tuple(
        stretch_gap(look.ways, first, last) for first, last in stretches_of(rows, look.ways.run)
    )
