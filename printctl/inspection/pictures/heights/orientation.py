"""Check if a scan fits better when turned, mirrored or moved far.

Ink correlates best with its expected lines in the right orientation, however much of it is missing;
so a picture that fits better in another one doesn't belong to its frame. A layer that is symmetric
under a turn can't show that turn, and where a move explains as much as a turn does, it is a move.
Gel in a dim bath is brighter than its surroundings, clear ink in a scattering bath darker: where a
picture fits by neither sign, both are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.options import IN_PART
from printctl.inspection.pictures.heights.height import HeightFrame
from printctl.inspection.pictures.heights.moved_part import find_moved_part
from printctl.inspection.pictures.heights.own_depth import ScanByDepth, TurnedMaps
from printctl.inspection.pictures.picture import draw_lines
from printctl.inspection.values import ExpectedLines, FloatImage, Frame
from registration.scan import Scan

_MAX_PIXELS: Final = 1e5
"""Size to which pictures are shrunk for the search."""
_HEIGHT_TOLERANCE_MM: Final = 1e-3
"""Difference of heights that counts as none."""
_MAX_SHIFT_MM: Final = 0.5
"""Largest shift of a layer in place."""
_FAR_SEARCH_MM: Final = 2.0
"""Largest move of a layer that is searched."""
_MIN_CORRELATION: Final = 0.5
"""Least correlation of ink and lines that belong together."""
_MIN_CORRELATION_GAIN: Final = 0.1
"""Least gain in correlation of another orientation."""
_MIN_SIGN_CORRELATION: Final = 0.25
"""Least correlation without a turn that determines whether ink is bright or dark."""

_DEAD_LINE_FACTOR: Final = 3.0
"""Darkness of a dead row or column, relative to the lower quartile's: two standard deviations of a
bath."""
_DEAD_LINE_PERCENTILE: Final = 90
"""Percentile of a row or column that must be dark for it to be dead."""

_TURNS: Final[Mapping[str, Callable[[FloatImage], FloatImage]]] = {
    "turned by 180°": lambda image: image[::-1, ::-1],
    "turned by 90°": lambda image: np.rot90(image),
    "turned by 270°": lambda image: np.rot90(image, 3),
    "mirrored along x": lambda image: image[:, ::-1],
    "mirrored along y": lambda image: image[::-1],
    "with x and y exchanged": lambda image: image.T,
    "with x and y exchanged and turned by 180°": lambda image: image[::-1, ::-1].T,
}


def find_better_orientation(
    picture: FloatImage,
    frame: Frame,
    lines: ExpectedLines,
    scan: Scan | None = None,
    in_parts: bool = True,
) -> str | None:
    """Return the orientation in which a picture fits clearly better; None if it fits as given.

    Words to go behind "the picture fits the layer better".

    Parameters
    ----------
    picture : (rows, columns, 1 or 2) float32
        Of `height_map`; the first channel is scattering.
    frame : Frame
        Of the picture as given.
    lines : ExpectedLines
    scan : Scan or None
        Of a bath: lines are then compared at their own depths, since thin clear ink hardly shows in
        one slab over all of them.
    in_parts : bool
        Whether to check if one end of it is moved against the other: for a `surface_of`.
    """
    rows = _at_its_height(lines)
    ends = np.stack([frame.to_pixels(one[rows]) for one in (lines.start, lines.end)], axis=1)
    flat = np.linalg.norm((lines.end - lines.start)[rows, :2], axis=1)
    px_per_mm = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() / max(flat.sum(), 1e-9)
    shrink = max(1.0, float(np.sqrt(picture[:, :, 0].size / _MAX_PIXELS)))
    maps = None
    if scan is not None and isinstance(frame, HeightFrame):
        by_depth = ScanByDepth.of(scan)
        shaded = _shaded(lines, rows, frame, picture.shape[:2], px_per_mm)
        by_depth = replace(by_depth, unmeasured=by_depth.unmeasured | shaded)
        picture = np.where(shaded[:, :, None], np.float32(np.nan), picture)
        maps = TurnedMaps(*by_depth.smaller(shrink, frame), lines, rows)
    reach = max(1, round(_MAX_SHIFT_MM * px_per_mm / shrink))
    fit = partial(_fit, ends, lines.width_mm[rows] * px_per_mm, reach, shrink)
    flat_ink = _shrunk(picture[:, :, 0], shrink)
    far_px = round((_FAR_SEARCH_MM - _MAX_SHIFT_MM) * px_per_mm / shrink)
    found = _best_place(fit, flat_ink, maps, far_px)
    if isinstance(found, str):
        return found
    if found is not None:
        return _moved_words(found, frame, lines)
    off = find_moved_part(picture, frame, lines) if in_parts and picture.shape[2] == 2 else None
    return None if off is None else f"{_moved_words(off, frame, lines)} {IN_PART}"


def _best_place(
    fit: Callable[..., dict[int, tuple[float, FloatArray]]],
    flat_ink: FloatImage,
    maps: TurnedMaps | None,
    far_px: int,
) -> str | FloatArray | None:
    """Return the turn, or the move in px of the picture, that fits clearly better, or None.

    ``fit`` returns an image's correlation with its lines, moved by so many more pixels; ``maps``
    show ink at the lines' own depths.
    """

    def shown(turn: Callable[[FloatImage], FloatImage]) -> FloatImage:
        return turn(flat_ink) if maps is None else _shrunk(maps.of(turn), 1.0)

    here = fit(shown(np.asarray))
    sign = max(here, key=lambda one: here[one][0])
    as_it_is = here[sign][0]
    # Lines followed in depth fit by their own sign far better than by chance.
    signs = (sign,) if as_it_is > _MIN_SIGN_CORRELATION and maps is None else (1, -1)
    flat = here if maps is None else fit(flat_ink)  # lines far off don't show at any line's depth
    own = tuple(one for one in signs if maps is None or flat[one][0] >= flat[-one][0])
    fits = dict[str, float]()
    for name, turn in _TURNS.items():
        found, slab = fit(shown(turn)), here if maps is None else fit(turn(flat_ink))
        each = [found[one][0] for one in signs]
        fits[name] = max(each + [slab[one][0] for one in signs if maps is not None])
    moved = fit(flat_ink, far_px)
    far, off_px = max((moved[one] for one in own), key=lambda found: found[0])
    best = max(fits, key=lambda name: fits[name])
    # Ink of bright rims fits in one slab far better than at its own depth.
    needed = max(
        _MIN_CORRELATION, max(as_it_is, *(flat[one][0] for one in own)) + _MIN_CORRELATION_GAIN
    )
    if far > max(needed, fits[best] - _MIN_CORRELATION_GAIN):
        return off_px
    return best if fits[best] > needed else None


def _fit(
    ends: FloatArray,
    width_px: FloatArray,
    reach: int,
    shrink: float,
    turned: FloatImage,
    more: int = 0,
) -> dict[int, tuple[float, FloatArray]]:
    """Return the best correlation of lines with bright (1) and dark (-1) ink, and its move, px.

    Moved by ``more`` pixels more than ``reach``.
    """
    shape = tuple(round(count * shrink) for count in turned.shape)
    drawn = draw_lines((shape[0], shape[1]), ends, width_px).astype(np.float32)
    mask = cv2.resize(drawn, turned.shape[::-1], interpolation=cv2.INTER_AREA)
    inner = mask[reach:-reach, reach:-reach]
    if min(inner.shape, default=0) < 8 or inner.std() < 1e-3:
        return dict.fromkeys((1, -1), (0.0, np.zeros(2)))
    usual = float(np.median(turned))
    image = cv2.copyMakeBorder(turned, *(more,) * 4, cv2.BORDER_CONSTANT, value=usual)
    found = cv2.matchTemplate(np.ascontiguousarray(image), inner, cv2.TM_CCOEFF_NORMED)
    least, most, low, high = cv2.minMaxLoc(found)
    both = {1: (most, high), -1: (-least, low)}
    return {
        sign: (size, (np.array(at, dtype=np.float64) - reach - more) * shrink)
        for sign, (size, at) in both.items()
    }


def _moved_words(off_px: FloatArray, frame: Frame, lines: ExpectedLines) -> str:
    """Describe the layer's move by the printer's axes."""
    middle = lines.start[lines.fresh].mean(axis=0)
    places = middle + np.vstack([np.zeros(3), np.eye(3)[:2]])
    origin, *ends = frame.to_pixels(places)
    axes = np.column_stack([one - origin for one in ends])
    x, y = np.round(np.linalg.solve(axes, off_px), 1) + 0.0  # no -0.0
    return f"moved by {x:+.1f} mm along x and {y:+.1f} mm along y"


def _shaded(
    lines: ExpectedLines, rows: BoolArray, frame: HeightFrame, shape: tuple[int, ...], scale: float
) -> BoolArray:
    """Return pixels shaded by lines between the scanner and those of ``rows``."""
    sign = 1.0 if frame.from_above else -1.0
    middle = sign * 0.5 * (lines.start[:, 2] + lines.end[:, 2])
    over = ~rows & (middle > middle[lines.fresh].max())
    ends = np.stack([frame.to_pixels(one[over]) for one in (lines.start, lines.end)], axis=1)
    return draw_lines((shape[0], shape[1]), ends, lines.width_mm[over] * scale) > 0


def _at_its_height(lines: ExpectedLines) -> BoolArray:
    """Return fresh lines, and older ones at their heights, (n,)."""
    ends = np.stack([lines.start[:, 2], lines.end[:, 2]])
    low, high = ends.min(axis=0), ends.max(axis=0)
    above = high >= low[lines.fresh].min() - _HEIGHT_TOLERANCE_MM
    return np.asarray(above & (low <= high[lines.fresh].max() + _HEIGHT_TOLERANCE_MM))


def _shrunk(image: FloatImage, by: float) -> FloatImage:
    """Shrink an image, clip its extremes, and fill unknown pixels with the median."""
    image = np.nan_to_num(image, nan=float(np.nanmedian(image)))
    size = (max(1, round(image.shape[1] / by)), max(1, round(image.shape[0] / by)))
    small = _without_dead_lines(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    low, high = np.percentile(small, [1, 99])
    return np.asarray(np.clip(small, low, high), dtype=np.float32)


def _without_dead_lines(image: FloatImage) -> FloatImage:
    """Fill rows and columns that are dark from end to end with the median."""
    out, usual = image.copy(), float(np.median(image))
    dark = usual - _DEAD_LINE_FACTOR * (usual - float(np.percentile(image, 25)))
    out[:, np.percentile(image, _DEAD_LINE_PERCENTILE, axis=0) < dark] = usual
    out[np.percentile(image, _DEAD_LINE_PERCENTILE, axis=1) < dark] = usual
    return out
