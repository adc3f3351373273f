"""Measure new lines' widths between older lines, in the difference to the earlier picture."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.ink_image import ACROSS
from registration.inspection.ink.presence import Sides
from registration.inspection.ink.told import Ground, tell_ink
from registration.inspection.pictures.working import Mask
from registration.inspection.ways import Seen, Ways
from registration.inspection.widths.stations import Grouping, station_widths
from registration.inspection.widths.widths import Widths

_RIMS: Final = 0.08
"""Of widths by the change alone: rims of lines, new and older, move its edges by up to 17 %."""
_IN_SLOTS: Final = 0.3
"""Of a station, that may suffice where bath shows between older lines alone."""


def widths_by_change(
    ground: Ground,
    ways: Ways,
    seen: Seen,
    fresh: Mask,
    over_old: BoolArray,
    present: FloatArray,
    shown: BoolArray,
    group: Grouping,
    rng: np.random.Generator,
) -> Widths:
    """Widths between older lines, which the difference to the picture before doesn't show.

    Bath beside such a line is too narrow for its edges to be told from those of older lines.

    Parameters
    ----------
    ground : Ground
        Its channels, and behind them as many of the difference.
    ways, seen
    fresh : (h, w) uint8
    over_old : (n,) bool
        Places over older ink.
    present, shown : (n,) float64 and bool
        Presence of ink, and where it is told.
    group : Grouping
    rng : Generator
    """
    count = ground.flat.shape[2] // 2
    parts = [np.ascontiguousarray(each[:, :, count:]) for each in (ground.smooth, ground.flat)]
    sides = Sides.of(seen, ways, fresh, ground.work.px_per_mm)
    change = replace(ground, smooth=parts[0], flat=parts[1], known=None)
    told = tell_ink(change, ways, seen, sides, ~over_old, rng) if parts[1].any() else None
    profiles = np.zeros((len(ways), len(ACROSS)), np.float32) if told is None else told.profiles
    widths = station_widths(
        group, ways, profiles, sides, told, over_old, present, shown, ground.work, _IN_SLOTS
    )
    return replace(widths, common=float(np.hypot(widths.common, _RIMS)))
