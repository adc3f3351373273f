"""Find places in a bath that plainly show ink of the kind that lies elsewhere in the picture.

A short filament has too few places of its own to learn ink from, so that none of it is told by
level and noise; beside a glint, or where bright ink saturates a sensor, pixels are like neither ink
nor bath. Where all of a stretch stands out from the bath at both its sides, as older filaments or
the look's own sure ink do and in their colour, ink lies there. A glint's light is brighter towards
its middle alone: nothing looks darker by it than at both sides, but ink may look brighter.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from scipy.ndimage import uniform_filter1d

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.presence import INK, fake_places
from registration.inspection.pictures.before import with_halos
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.unseen.bare_strokes import STANDS_OUT, TOGETHER, over_each_side
from registration.inspection.values import Unseen
from registration.inspection.ways import stretches_of

_LEAST: Final = 0.4
"""Of the older filaments' usual level: what a needle without ink leaves in the bath shows less."""
_LACKING, _OTHERWISE = 0.2, -0.6
"""Of that level, between which bath shows; what is beyond it the other way is light."""
_MOST: Final = 2.5
_ANOTHER_COLOUR: Final = 0.5
"""Of a level, by which it may point elsewhere than older ink's does."""
_SHORT: Final = 4
"""Times the places of a laid line, below which a gap would be lost between two parts."""
_FEWEST_PX: Final = 100
_FEWEST_OWN: Final = 40
_TOLD: Final = (Unseen.FAINT, Unseen.UNCLEAR, Unseen.GLARE)


def standing_ink(
    look: SeenLayer, why: IntArray, rng: np.random.Generator
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Return the places over the bath, (n,), that plainly show ink, lack it, or lie in a glint.

    Lacking are places that show none of the older ink, of a line that shows it elsewhere.

    Parameters
    ----------
    look : SeenLayer
    why : (n,) int64
        `Unseen`.
    rng : Generator
    """
    ways = look.ways
    out, lacking, glints = np.zeros((3, len(why)), dtype=np.bool_)
    open_bath = (np.isin(why, _TOLD) | (why == Unseen.SEEN)) & ~look.over_old
    if not np.isin(why[open_bath], _TOLD).any():
        return out, lacking, glints
    level, spread, both = _levels(look, rng)
    if spread is None:
        return out, lacking, glints
    older, own = _older_level(look), _own_level(look, why, level)
    darker = min(float(one.sum()) for one in (older, own, np.zeros(1)) if one is not None) < 0
    glints = _near_glints(look, darker)
    for first, last in stretches_of(open_bath, ways.run):
        rows = np.arange(first, last + 1)
        if len(rows) < _SHORT * TOGETHER and not glints[rows].any():
            out[rows] = _stands_throughout(level[rows], both[rows], spread, older, own)
        else:
            for part in np.array_split(rows, max(1, round(len(rows) / TOGETHER))):
                mean, least = level[part].mean(axis=0), both[part].mean(axis=0)
                clear = not glints[part].any()
                for kind, value in ((older, mean if clear else least), (own, least)):
                    if kind is not None and (clear or darker):
                        out[part] |= _stands(value, spread) and _is_alike(value, kind)
        if older is not None:
            for part in np.array_split(rows, max(1, round(len(rows) / TOGETHER))):
                share = float(level[part].mean(axis=0) @ older / (older @ older))
                lacking[part] = not glints[part].any() and _OTHERWISE < share < _LACKING
        lacking[rows] &= bool(out[rows].any())
    return out, lacking, glints


def _levels(
    look: SeenLayer, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Return places' levels over the mean of their sides, bath's spread of it, and over either.

    Levels are (n, c), the spread (c,), or None where too little bath is seen.
    """
    width_px = float(np.median(look.ways.width)) * look.work.px_per_mm
    step_px = float(np.median(look.ways.step)) * look.work.px_per_mm
    count = look.flat.shape[2] if look.work.earlier is None else look.work.earlier.shape[2]
    flat = look.flat[:, :, :count]  # in what changed since the picture before older ink shows none
    sides = over_each_side(flat, look.seen, look.ways.width)
    level, both = sides.mean(axis=0), _least(sides)
    fakes = fake_places(look.masks.free, width_px, step_px, rng)
    if fakes is None:
        return level, None, both
    usual = over_each_side(flat, fakes, np.full(len(fakes.at), width_px)).mean(axis=0)
    usual = usual.reshape(-1, TOGETHER, count).mean(axis=1)
    return level, 1.4826 * np.median(np.abs(usual), axis=0) + 1e-9, both


def _least(sides: FloatArray) -> FloatArray:
    """What stands out to both sides (2, n, c) alike, by the one that shows less of it, (n, c)."""
    same = np.sign(sides[0]) == np.sign(sides[1])
    return np.asarray(np.where(same, np.sign(sides[0]) * np.abs(sides).min(axis=0), 0.0))


def _near_glints(look: SeenLayer, darker: bool) -> BoolArray:
    """Places in the light around saturated spots, (n,); bright ink may be saturated itself."""
    lines = np.maximum(look.masks.fresh, look.masks.old) > 0
    halos = with_halos(look.work.bad if darker else look.work.bad & ~lines)
    across = look.ways.width[:, None] * np.linspace(-1.2, 1.2, 13)
    return np.asarray(look.seen.profiles(halos, across, nearest=True).any(axis=1))


def _own_level(look: SeenLayer, why: IntArray, level: FloatArray) -> FloatArray | None:
    """Level of the look's own sure ink over the bath, (c,); None where there is too little."""
    sure = (why == Unseen.SEEN) & ~look.over_old & (look.present > INK)
    return np.median(level[sure], axis=0) if sure.sum() >= _FEWEST_OWN else None


def _stands_throughout(
    level: FloatArray,
    both: FloatArray,
    spread: FloatArray,
    older: FloatArray | None,
    own: FloatArray | None,
) -> bool:
    """Whether ink shows wherever one looks along a short line (n, c).

    Where no other ink is known every part of it must show what most of it shows.
    """
    inner = _inner(len(level))
    mean, least = (uniform_filter1d(one, TOGETHER, axis=0)[inner] for one in (level, both))
    usual = np.median(least, axis=0) if older is None and own is None else None
    kinds = ((older, mean), (own, least), (usual, least))
    return any(
        kind is not None and all(_stands(one, spread) and _is_alike(one, kind) for one in values)
        for kind, values in kinds
    )


def _inner(count: int) -> slice:
    """Middles of the windows that lie in a line of so many places."""
    half = min(TOGETHER, count) // 2
    return slice(half, count - half + 1) if count > TOGETHER else slice(half, half + 1)


def _stands(value: FloatArray, spread: FloatArray) -> bool:
    return bool(np.abs(value / spread).max() > STANDS_OUT)


def _is_alike(level: FloatArray, older: FloatArray) -> bool:
    share = float(level @ older / (older @ older))
    beside = float(np.linalg.norm(level - share * older))
    return _LEAST < share < _MOST and beside < _ANOTHER_COLOUR * float(np.linalg.norm(level))


def _older_level(look: SeenLayer) -> FloatArray | None:
    """Level of older ink over the bath, (c,), of the picture itself; None where there is none."""
    inner = cv2.erode(look.masks.old, np.ones((3, 3), np.uint8)) > 0
    inner &= (look.masks.fresh == 0) & ~look.work.bad & ~look.work.hidden
    free = look.masks.free > 0
    if inner.sum() < _FEWEST_PX or free.sum() < _FEWEST_PX:
        return None
    count = look.flat.shape[2] if look.work.earlier is None else look.work.earlier.shape[2]
    flat = look.flat[:, :, :count]
    level = np.median(flat[inner], axis=0) - np.median(flat[free], axis=0)
    return np.asarray(level, dtype=np.float64) if np.abs(level).max() > 0 else None
