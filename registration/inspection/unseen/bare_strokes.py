"""Find whole strokes that can't be judged, and where nothing stands out from the bath either.

Ink of one stroke alone has nothing to be learned from but itself: where it grows darker along its
way, is too faint or isn't there, none of it is "seen". Whether anything lies there at all is told
without knowing ink: by the difference of the stroke's middle to the bath at both its sides, against
that of lines laid where there is bath alone.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.inspection.ink.presence import fake_places
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.values import FloatImage, Unseen
from registration.inspection.ways import Seen

_NOT_TOLD: Final = (Unseen.FAINT, Unseen.UNCLEAR, Unseen.GLARE)
_LEAST_MM, _LEAST_WIDTHS = 1.0, 3.0
"""Way over the bath, in the view, from which on a stroke is judged."""
_MIDDLE: Final = np.linspace(-0.3, 0.3, 7)
_SIDE: Final = np.linspace(0.8, 1.2, 5)
"""Of a width, where the bath beside is looked at."""
TOGETHER: Final = 8
"""Places of a line that is laid over bath."""
STANDS_OUT: Final = 4.0
"""Standard deviations of bath."""
_MOST: Final = 0.25
"""Of a stroke, that may stand out by chance, or because of what crosses it."""


def bare_strokes(look: SeenLayer, why: IntArray, rng: np.random.Generator) -> tuple[int, ...]:
    """Return the strokes of which nothing is seen where nothing hides them, and none stands out.

    Parameters
    ----------
    look : SeenLayer
    why : (n,) int64
        `Unseen`.
    rng : Generator
    """
    ways, out = look.ways, []
    width_px = float(np.median(ways.width)) * look.work.px_per_mm
    step_px = float(np.median(ways.step)) * look.work.px_per_mm
    open_bath = np.isin(why, _NOT_TOLD) & ~look.over_old
    strokes = np.unique(ways.stroke)
    unseen = [one for one in strokes if not (why[ways.stroke == one] == Unseen.SEEN).any()]
    fakes = fake_places(look.masks.free, width_px, step_px, rng) if unseen else None
    if fakes is None:
        return ()
    usual = _together(over_sides(look.flat, fakes, np.full(len(fakes.at), width_px)))
    spread = 1.4826 * np.median(np.abs(usual), axis=0) + 1e-9
    for stroke in unseen:
        own = np.flatnonzero((ways.stroke == stroke) & open_bath)
        width, whole = float(ways.width[own].max(initial=0.0)), ways.stroke == stroke
        least = max(_LEAST_MM, _LEAST_WIDTHS * width, 0.5 * float(ways.step[whole].sum()))
        if float(ways.step[own].sum()) < least:
            continue
        here = Seen(look.seen.at[own], look.seen.across[own], look.seen.along[own])
        level = _together(over_sides(look.flat, here, ways.width[own])) / spread
        if (np.abs(level) > STANDS_OUT).any(axis=1).mean() <= _MOST:
            out.append(int(stroke))
    return tuple(out)


def over_sides(image: FloatImage, seen: Seen, width: FloatArray) -> FloatArray:
    """Each channel in the middle of places less what is beside them, (n, c)."""
    return over_each_side(image, seen, width).mean(axis=0)


def over_each_side(image: FloatImage, seen: Seen, width: FloatArray) -> FloatArray:
    """Each channel in the middle of places less what is on the right and left, (2, n, c)."""
    parts = []
    for c in range(image.shape[2]):
        channel = np.ascontiguousarray(image[:, :, c])
        middle = seen.profiles(channel, width[:, None] * _MIDDLE).mean(axis=1)
        parts.append(
            [middle - seen.profiles(channel, w * width[:, None] * _SIDE).mean(axis=1)
             for w in (-1.0, 1.0)]
        )  # fmt: skip
    return np.stack(parts, axis=2).astype(np.float64)


def _together(level: FloatArray) -> FloatArray:
    """Means of neighbours that are together as many as a laid line's places, (k, c)."""
    count = max(1, len(level) // TOGETHER)
    return np.array([part.mean(axis=0) for part in np.array_split(level, count)])
