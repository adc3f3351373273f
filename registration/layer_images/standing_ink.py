"""Find places in a bath that plainly show ink of the older filaments' kind.

A short filament has too few places of its own to learn ink from, so that none of it is told by
level and noise. Where all of it stands out from the bath at both its sides, as the older filaments
in the same picture do and in their colour, ink lies there.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from registration.layer_images.bare_strokes import STANDS_OUT, TOGETHER, over_sides
from registration.layer_images.gaps import stretches_of
from registration.layer_images.presence import fake_places
from registration.layer_images.seen_layer import SeenLayer
from registration.layer_images.values import BoolArray, FloatArray, IntArray, Unseen

_LEAST: Final = 0.4
"""Of the older filaments' usual level: what a needle without ink leaves in the bath shows less."""
_LACKING: Final = 0.2
_MOST: Final = 2.5
_ANOTHER_COLOUR: Final = 0.5
"""Of a level, by which it may point elsewhere than older ink's does."""
_FEWEST_PX: Final = 100
_TOLD: Final = (Unseen.FAINT, Unseen.UNCLEAR, Unseen.GLARE)


def standing_ink(
    look: SeenLayer, why: IntArray, rng: np.random.Generator
) -> tuple[BoolArray, BoolArray]:
    """Return the places over the bath, (n,), that show older filaments' ink, and that lack it.

    Lacking are places of a line that shows it elsewhere.

    Parameters
    ----------
    look : SeenLayer
    why : (n,) int64
        `Unseen`.
    rng : Generator
    """
    ways = look.ways
    out, lacking = np.zeros((2, len(why)), dtype=np.bool_)
    open_bath = (np.isin(why, _TOLD) | (why == Unseen.SEEN)) & ~look.over_old
    older = _older_level(look)
    if older is None or not np.isin(why[open_bath], _TOLD).any():
        return out, lacking
    width_px = float(np.median(ways.width)) * look.work.px_per_mm
    step_px = float(np.median(ways.step)) * look.work.px_per_mm
    fakes = fake_places(look.masks.free, width_px, step_px, rng)
    if fakes is None:
        return out, lacking
    flat = look.flat[:, :, : len(older)]
    usual = over_sides(flat, fakes, np.full(len(fakes.at), width_px))
    usual = usual.reshape(-1, TOGETHER, len(older)).mean(axis=1)
    level = over_sides(flat, look.seen, ways.width)
    spread = 1.4826 * np.median(np.abs(usual), axis=0) + 1e-9
    for first, last in stretches_of(open_bath, ways.run):
        rows = np.arange(first, last + 1)
        for part in np.array_split(rows, max(1, round(len(rows) / TOGETHER))):
            mean = level[part].mean(axis=0)
            stands = float(np.abs(mean / spread).max()) > STANDS_OUT
            out[part] = stands and _is_alike(mean, older)
            lacking[part] = float(mean @ older) < _LACKING * float(older @ older)
        lacking[rows] &= bool(out[rows].any())
    return out, lacking


def _is_alike(level: FloatArray, older: FloatArray) -> bool:
    share = float(level @ older / (older @ older))
    beside = float(np.linalg.norm(level - share * older))
    return _LEAST < share < _MOST and beside < _ANOTHER_COLOUR * float(np.linalg.norm(level))


def _older_level(look: SeenLayer) -> FloatArray | None:
    """Level of older ink over the bath, (c,), of the picture itself; None where there is none.

    In what changed since the picture before older ink shows nothing.
    """
    inner = cv2.erode(look.masks.old, np.ones((3, 3), np.uint8)) > 0
    inner &= (look.masks.fresh == 0) & ~look.work.bad & ~look.work.hidden
    free = look.masks.free > 0
    if inner.sum() < _FEWEST_PX or free.sum() < _FEWEST_PX:
        return None
    count = look.flat.shape[2] if look.work.earlier is None else look.work.earlier.shape[2]
    flat = look.flat[:, :, :count]
    level = np.median(flat[inner], axis=0) - np.median(flat[free], axis=0)
    return np.asarray(level, dtype=np.float64) if np.abs(level).max() > 0 else None
