"""Measure how much a picture changed along lines since the one before, against unwritten ground.

Fresh ink changes a picture by its density, its ridges or their shades, even where its level is that
of older ink. The change is the root mean square across a line and some widths along it. Ground on
which nothing was written in between (other older lines, for places over older ink; else bath) says
how much camera, light and drying change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.errors import PictureError
from registration.inspection.ink.place_reasons import reasons
from registration.inspection.ink.presence import averaged, fake_places, window_means
from registration.inspection.over_ink.changed import light_less
from registration.inspection.pictures.working import Mask, Working, WorkingFrame
from registration.inspection.values import ExpectedLines, FloatImage, Unseen
from registration.inspection.ways import Seen, Ways, lay_ways

ACROSS: Final = np.linspace(-0.55, 0.55, 12)
"""Of a width, where the change is taken."""
_WINDOW: Final = 3.0
"""Widths along a line."""
_FEWEST: Final = 12
"""Windows on ground: of fewer nothing is known."""
_FAR: Final = 95.0
"""Percentile of the ground's windows, up to which a change may be the ground's own."""
_HIGHEST: Final = 95.0
"""Percentile of the places that stands for ink's change: nearly all may be missing."""
_CAME: Final = 2.0
"""Times what the ground's reaches, beyond which something was written."""
_DRYING: Final = 0.015
"""And more than older ink changes by drying, otherwise than the ground does (0.008 was seen)."""
_STILL: Final = 1.5
"""Times the ground's, below which nothing was, where ink's is `_SHOWS` times that."""
_SHOWS: Final = 10.0
_HARDLY: Final = 0.05
"""And of what ink changes it by: what lies beside a bare line shades it (by 0.04 of that in a
stranger's prints, of whose sound lines 2.6 mm changed by 0.08)."""
_DRAWS: Final = 200
_ALIKE: Final = 0.6
"""Of the most change on older ink, that lines of one height and direction must show somewhere;
where it is less nothing is still: ridges along the light, and opaque ink, may show none."""
_DIRECTIONS: Final = 12
"""Of lines, among which they are compared."""
_BY_LIGHT: Final = 1 / 3
"""Of a place's change, which ground beside it may show; more is a shadow that came or went."""
_BESIDE: Final = 1.5
"""Widths around a place, over which that ground is averaged."""
_LEAST: Final = 1e-12
_PARALLEL: Final = 0.95
"""Cosine of the angle between lines of one direction."""


@dataclass(frozen=True)
class Change:
    """How much the picture changed along lines.

    Attributes
    ----------
    energy : (n,) float64
        Mean square across each place, logarithms; NaN where it isn't known.
    rms : (n,) float64
        Of a window around it, above the ground's own; NaN where it isn't known, or light that
        changed beside it may have done it.
    anyway : (n,) float64
        The same whatever did it.
    usual, limit : (n,) float64
        Of ink on such places, and what the ground's reaches; NaN where it isn't known.
    own : (n,) float64
        The ground's usual mean square.
    alike : (n,) bool
        Where ink changes about as much as anywhere over such ground, on lines of a direction.
    over_old : (n,) bool
    ground : (k,) float64 or None
        Mean squares of the ground's windows, for places over older ink.
    count : int
        Places of a window.
    profiles : (n, u, c) float32
        Change across each place, at `ACROSS`.
    older : Ways or None
        Places along older lines.
    """

    energy: FloatArray
    rms: FloatArray
    anyway: FloatArray
    usual: FloatArray
    limit: FloatArray
    own: FloatArray
    alike: BoolArray
    over_old: BoolArray
    ground: FloatArray | None
    count: int
    profiles: FloatImage
    older: Ways | None

    @property
    def came(self) -> BoolArray:
        """Places that changed by far more than ground does, (n,)."""
        return np.asarray(self.rms > np.maximum(_CAME * self.limit, _DRYING))

    @property
    def still(self) -> BoolArray:
        """Places that changed as ground does, though others like them by far more, (n,).

        Where light changed as well, ink would have changed them all the more.
        """
        sure = self.alike & (self.usual > _SHOWS * self.limit)
        least = np.maximum(_STILL * self.limit, _HARDLY * self.usual)
        return np.asarray(sure & (self.anyway < least))

    def share(self, rows: BoolArray, normal: FloatArray) -> float:
        """Change of some places over that of ink on lines of their direction (``normal`` (n, 2)).

        Ridges along the light show least. NaN where nothing is known of either.
        """
        known = rows & np.isfinite(self.rms)
        if not known.any():
            return math.nan
        turned = np.abs(normal @ normal[known].T) > _PARALLEL
        beside = ~rows & np.isfinite(self.rms) & turned.any(axis=1)
        if beside.sum() < _FEWEST:
            return math.nan
        inner = _inner(known)  # ink shows at its ends
        above = float((self.energy[inner] - self.own[inner]).mean())
        usual = float(np.percentile(self.rms[beside], _HIGHEST))
        return math.sqrt(max(above, 0.0)) / max(usual, 1e-9)

    def over_older(self) -> tuple[float, float]:
        """Ink's change over older ink, and what as many windows of ground reach, or NaN."""
        known = self.over_old & np.isfinite(self.rms)
        if not known.any() or self.ground is None:
            return math.nan, math.nan
        drawn = np.random.default_rng(38).choice(
            self.ground, (_DRAWS, max(1, int(known.sum()) // self.count))
        )
        above = np.percentile(drawn, _HIGHEST, axis=1) - float(np.median(self.ground))
        limit = math.sqrt(max(float(np.percentile(above, _FAR)), _LEAST))
        return float(np.percentile(self.rms[known], _HIGHEST)), limit


@dataclass(frozen=True)
class Unwritten:
    """What was written, and what not, since the picture before.

    Attributes
    ----------
    settled : (n,) bool
        Nothing but the layer was written there.
    ground : (h, w) uint8
        Where nothing was.
    old : (h, w) uint8
        Older ink.
    over_old : (n,) bool
    onto : (n,) int64
        Rank of the height of the topmost older ink.
    """

    settled: BoolArray
    ground: Mask
    old: Mask
    over_old: BoolArray
    onto: IntArray


def change_along(
    work: Working,
    frame: WorkingFrame,
    ways: Ways,
    seen: Seen,
    older: Ways | None,
    bare: Unwritten,
) -> Change:
    """Measure it along places ``ways``; ``older`` are those along older lines."""
    width_px = float(np.median(ways.width)) * work.px_per_mm
    image, _ = light_less(work, bare.ground, width_px)
    shown = bare.settled & (reasons(work, seen, ways, work.bad) == Unseen.SEEN)
    profiles, count = _profiles(image, seen, ways.width), _count(ways)
    energy = _mean_square(profiles)
    nothing = np.full(len(ways), np.nan)
    usual, limit, own = nothing.copy(), nothing.copy(), nothing.copy()
    alike = np.ones(len(ways), dtype=np.bool_)
    on_bath = _on_bath(image, bare, width_px, count * float(np.median(ways.step)), work)
    on_old = None if older is None else _on_older(image, frame, older, bare.ground, work)
    on_old = on_bath if on_old is None else on_old
    kinds = [(bare.over_old, on_old), (~bare.over_old, on_bath)]
    for kind, ground in kinds:
        if ground is not None:
            own[kind], far = float(np.median(ground)), float(np.percentile(ground, _FAR))
            limit[kind] = math.sqrt(max(far - float(np.median(ground)), _LEAST))
    anyway = _windows(energy, shown, ways, count, own)
    shown &= ~_by_light(image, energy, limit, bare.ground, seen, ways, width_px)
    rms = _windows(energy, shown, ways, count, own)
    energy = np.where(shown, energy, np.nan)
    for kind, _ in kinds:
        rows = kind & np.isfinite(rms)
        if rows.any():
            usual[kind] = float(np.percentile(rms[rows], _HIGHEST))
    for own_kind, like in _kinds(ways, bare, np.isfinite(rms)):
        alike[own_kind] = np.percentile(rms[like], _HIGHEST) > _ALIKE * usual[own_kind][0]
    return Change(
        energy, rms, anyway, usual, limit, own, alike, bare.over_old, on_old, count, profiles, older
    )


def _windows(
    energy: FloatArray, shown: BoolArray, ways: Ways, count: int, own: FloatArray
) -> FloatArray:
    """Change of windows around places that are shown, above the ground's own, (n,)."""
    logs = np.log(np.where(shown, energy, 1.0))
    mean = np.exp(averaged(logs, shown, ways.run, count))
    return np.asarray(np.where(shown, np.sqrt(np.maximum(mean - own, 0.0)), np.nan))


def _by_light(
    image: FloatImage,
    energy: FloatArray,
    limit: FloatArray,
    ground: Mask,
    seen: Seen,
    ways: Ways,
    width_px: float,
) -> BoolArray:
    """Places whose change is that of the ground beside them: a shadow that came or went, (n,).

    A change that counts as neither ink's nor more than ground's ``limit`` (n,) is none.
    """
    free = ground.astype(np.float32)
    square = np.mean(image**2, axis=2)
    square -= np.median(square[ground > 0]) if ground.any() else 0.0
    sigma = _BESIDE * width_px
    share = np.maximum(cv2.GaussianBlur(free, (0, 0), sigma), _LEAST)
    around = cv2.GaussianBlur(np.asarray(square * free), (0, 0), sigma) / share
    beside = seen.profiles(around, ways.width[:, None] * ACROSS).mean(axis=1)
    least = np.maximum(_BY_LIGHT**2 * np.maximum(energy, _DRYING**2), limit**2)
    return np.asarray(beside > least)


def _kinds(ways: Ways, bare: Unwritten, known: BoolArray) -> Iterator[tuple[BoolArray, BoolArray]]:
    """Yield places over older ink of one height and direction, and those to compare them with.

    These are ``known`` (n,) ones of directions up to `_PARALLEL`; both are (n,).
    """
    angle = np.arctan2(ways.normal[:, 1], ways.normal[:, 0])
    part = np.round(angle / math.pi * _DIRECTIONS).astype(int) % _DIRECTIONS
    for rank in np.unique(bare.onto[bare.over_old]):
        rows = bare.over_old & (bare.onto == rank)
        for one in np.unique(part[rows & known]):
            near = np.abs(np.cos(angle - one * math.pi / _DIRECTIONS)) > _PARALLEL
            yield rows & (part == one), rows & near & known


def lay_older(lines: ExpectedLines, late: BoolArray, ways: Ways) -> Ways | None:
    """Return places along older lines, but for those written ``late``; None where there are none.

    They are as far apart as those of ``ways``.
    """
    older = replace(lines, fresh=~lines.fresh & ~late)
    try:
        return lay_ways(older, float(np.median(ways.step)))
    except PictureError:  # none can be seen from above
        return None


def _count(ways: Ways) -> int:
    """Places of a window, an odd number."""
    return max(1, round(_WINDOW * float(np.median(ways.width / ways.step)))) | 1


def _inner(rows: BoolArray) -> IntArray:
    """Rows without a sixth of them at either end."""
    own = np.flatnonzero(rows)
    return own[len(own) // 6 : len(own) - len(own) // 6]


def _profiles(image: FloatImage, seen: Seen, width: FloatArray) -> FloatImage:
    """Change across each place, (n, u, c)."""
    channels = range(image.shape[2])
    each = [seen.profiles(np.ascontiguousarray(image[:, :, c]), width[:, None] * ACROSS)
            for c in channels]  # fmt: skip
    return np.stack(each, axis=2)


def _mean_square(profiles: FloatImage) -> FloatArray:
    """Of the change across each place, (n,)."""
    return np.asarray((profiles.astype(np.float64) ** 2).mean(axis=(1, 2)) + _LEAST)


def _energy(image: FloatImage, seen: Seen, width: FloatArray) -> FloatArray:
    """Mean square of the change across each place, (n,)."""
    return _mean_square(_profiles(image, seen, width))


def _on_bath(
    image: FloatImage,
    bare: Unwritten,
    width_px: float,
    window_mm: float,
    work: Working,
) -> FloatArray | None:
    """Mean squares of windows on bath, (k,); None where there is too little of it."""
    free = (bare.ground & (1 - bare.old)).astype(np.uint8)
    lines = fake_places(free, width_px, window_mm * work.px_per_mm / 8, np.random.default_rng(37))
    if lines is None:
        return None
    inside = lines.profiles(free, width_px * ACROSS, nearest=True).all(axis=1)
    energy = _energy(image, lines, np.full(len(lines.at), width_px)).reshape(-1, 8)
    found = np.exp(np.log(energy[inside.reshape(-1, 8).all(axis=1)]).mean(axis=1))
    return found if len(found) >= _FEWEST else None


def _on_older(
    image: FloatImage, frame: WorkingFrame, older: Ways, ground: Mask, work: Working
) -> FloatArray | None:
    """Mean squares of windows along older lines on which nothing was written, (k,)."""
    seen = Seen.of(older, frame)
    free = seen.profiles(ground, older.width[:, None] * ACROSS, nearest=True).all(axis=1)
    free &= seen.inside(work.shape, 0.5 * older.width)
    count = _count(older)
    logs = np.log(_energy(image, seen, older.width))
    found = np.exp(window_means(logs, free, older.run, count, False))
    return found if len(found) >= _FEWEST * count // 2 else None
