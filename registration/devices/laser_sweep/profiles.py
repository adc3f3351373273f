"""Trace a laser's line through a sweep's pictures, to rays."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.devices.camera_frame.frame import CameraFrame, rays
from registration.devices.laser_sweep.pictures import Image, Reader, sweep_pictures
from registration.errors import PictureError

_NEAR_MM: Final = 0.12
_TRIES: Final = 10
"""Places of either side that are joined, evenly spread."""
_JUDGES: Final = 300
"""Places that lines are tried by."""
_CLOSEST_MM: Final = 0.015
_ROUNDS: Final = 4


@dataclass(frozen=True)
class Straight:
    """A line through places.

    Attributes
    ----------
    ends : (2, 2) float64, mm
        Its outermost places.
    off_mm : float, mm
        RMS of the places about it.
    """

    ends: FloatArray
    off_mm: float


def straight_line(at: FloatArray, first: NDArray[np.bool_], fewest: int) -> Straight | None:
    """Return the line that most places are on; None where either part has fewer than ``fewest``.

    Parameters
    ----------
    at : (n, 2) float64, mm
    first : (n,) bool
        One of two parts, both of which it must run through.
    fewest : int
    """
    ends, off_mm, found = _straight(at, first, fewest)
    return Straight(ends, off_mm) if found else None


@jit
def _straight(
    at: FloatArray, first: NDArray[np.bool_], fewest: int
) -> tuple[FloatArray, float, bool]:
    """Ends of the line, RMS of its places about it, and whether there is one."""
    ends = np.zeros((2, 2))
    one, other = np.flatnonzero(first), np.flatnonzero(~first)
    if min(len(one), len(other)) < fewest:
        return ends, 0.0, False
    near = _most_joined(at, one, other)
    middle, along, off = np.zeros(2), np.zeros(2), np.zeros(len(at))
    for _ in range(_ROUNDS):
        count = near.sum()
        if min((near & first).sum(), count - (near & first).sum()) < fewest:
            return ends, 0.0, False
        x, y = at[:, 0], at[:, 1]
        middle[0], middle[1] = x[near].mean(), y[near].mean()
        dx, dy = x - middle[0], y - middle[1]
        u, v = dx[near], dy[near]
        turn = 0.5 * np.arctan2(2.0 * (u * v).sum(), (u * u).sum() - (v * v).sum())
        along[0], along[1] = np.cos(turn), np.sin(turn)
        off = dy * along[0] - dx * along[1]
        spread = 1.4826 * np.median(np.abs(off[near]))
        near = np.abs(off) < min(_NEAR_MM, max(3 * spread, _CLOSEST_MM))
    reach = ((at[:, 0] - middle[0]) * along[0] + (at[:, 1] - middle[1]) * along[1])[near]
    ends[0], ends[1] = middle + reach.min() * along, middle + reach.max() * along
    return ends, np.sqrt(np.mean(off[near] ** 2)), True


@jit
def _most_joined(
    at: FloatArray, one: NDArray[np.int64], other: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which places are near the best of the lines that join two of them, (n,)."""
    step = max(1, len(at) // _JUDGES)
    most, normal_x, normal_y, offset = -1, 0.0, 0.0, 0.0
    for i in range(_TRIES):
        a = at[one[i * (len(one) - 1) // (_TRIES - 1)]]
        for j in range(_TRIES):
            b = at[other[j * (len(other) - 1) // (_TRIES - 1)]]
            size = max(np.hypot(b[0] - a[0], b[1] - a[1]), 1e-9)
            x, y = (a[1] - b[1]) / size, (b[0] - a[0]) / size
            level = x * a[0] + y * a[1]
            count = 0
            for k in range(0, len(at), step):
                count += abs(x * at[k, 0] + y * at[k, 1] - level) < _NEAR_MM
            if count > most:
                most, normal_x, normal_y, offset = count, x, y, level
    return np.abs(at[:, 0] * normal_x + at[:, 1] * normal_y - offset) < _NEAR_MM


_TOGETHER: Final = 32
"""Columns that are looked at together."""


@jit
def line_middles(
    image: NDArray[Any],
    ground: NDArray[Any],
    gain: float,
    least: float,
    widest: int,
    upright: bool = False,
) -> NDArray[np.float64]:
    """Return the row of the line's middle in each column, (columns,); NaN where lost.

    The middle is the centroid of what lies above half of the peak: a saturated line has a flat top,
    and light scattered below the surface a long foot, which neither moves it.

    Parameters
    ----------
    image, ground : (rows, columns)
        The picture, and the same view without the laser.
    gain : float
        Of the picture's light against the ground's.
    least : float
        Least height of a peak over the ground.
    widest : int, px
        A wider line is lost; a second peak so far from the first is another one.
    upright : bool
        Whether the line runs from top to bottom: rows count as columns, and columns as rows.
    """
    high, wide = image.shape
    rows, columns = (wide, high) if upright else (high, wide)
    share = np.float32(gain)
    # A second peak matters above half of the first: darker places are passed by many at once.
    dark = np.float32(0.49 * least)
    best = np.zeros(columns, np.float32)
    second = np.zeros(columns, np.float32)
    at = np.zeros(columns, np.int64)
    for i in range(high):
        for first in range(0, wide, _TOGETHER):
            last = min(first + _TOGETHER, wide)
            light, view = image[i, first:last], ground[i, first:last]
            bright = 0
            for k in range(last - first):
                bright += int(np.float32(light[k]) - share * np.float32(view[k]) > dark)
            if bright == 0:
                continue
            for j in range(first, last):
                over = np.float32(image[i, j]) - share * np.float32(ground[i, j])
                if over <= dark:
                    continue
                row, column = (j, i) if upright else (i, j)
                if over > best[column]:
                    if row - at[column] > widest:
                        second[column] = max(second[column], best[column])
                    best[column] = over
                    at[column] = row
                elif over > second[column] and row - at[column] > widest:
                    second[column] = over
    middle = np.full(columns, np.nan)
    for column in range(columns):
        if best[column] < least or second[column] > 0.5 * best[column]:
            continue
        half = 0.5 * best[column]
        total, moment, count = 0.0, 0.0, 0
        for way in (-1, 1):
            row = at[column] if way == 1 else at[column] - 1
            while 0 <= row < rows and count <= widest:
                i, j = (column, row) if upright else (row, column)
                over = np.float32(image[i, j]) - share * np.float32(ground[i, j]) - half
                if over <= 0:
                    break
                total += over
                moment += over * row
                count += 1
                row += way
        if count > widest or at[column] < 2 or at[column] > rows - 3:
            continue
        middle[column] = moment / total
    return middle


FEWEST: Final = 12
"""Pictures with the line on the insert, and places of the line on either side of the dish."""
_GROUNDS: Final = 7
"""Pictures whose darkest light is the view without the laser; each place is lit in few."""
_WIDEST_MM: Final = 0.6
_NOISES: Final = 6.0
_LEAST: Final = 0.04
"""Of the brightest light: a fainter line is lost."""
_FLAT: Final = 0.25
"""Contrast near a place of the insert from which it is a mark's edge, which draws the line."""
_EDGE_MM: Final = 0.7
_GRID_PX: Final = 8
_AT_ONCE: Final = 8


@dataclass(frozen=True)
class Profile:
    """The laser's line in one picture.

    Attributes
    ----------
    ends : (2, 3) float64, mm
        Two places of its line on the insert's face, left and right of the dish, printer's frame.
    off_mm : float, mm
        RMS of the insert's places about the line.
    slopes : (n, 2) float64
        Rays in the dish: x and y per z.
    """

    ends: FloatArray
    off_mm: float
    slopes: FloatArray


@dataclass(frozen=True)
class Traced:
    """A sweep.

    Attributes
    ----------
    ground : Image
        The view without the laser.
    profiles : tuple of Profile
    pictures : int
        How many there were; those without a line on the insert have no profile.
    """

    ground: Image
    profiles: tuple[Profile, ...]
    pictures: int


def trace(path: Path, frame: CameraFrame) -> Traced:
    """Trace a sweep, in any order of its pictures.

    Parameters
    ----------
    path : Path
        Folder of pictures, TIFF of pages or video.
    frame : CameraFrame
        Of the camera, in air.

    Raises
    ------
    PictureError
        When pictures can't be read, differ in size from the frame's, or too few have a line on the
        insert.
    """
    profiles = list[Profile]()
    count = 0

    def profile(read: Reader) -> Profile | None:
        image = read()
        _check_like(image, tracer.whole, path, frame)
        return tracer.profile(image)

    with sweep_pictures(path) as pictures, ThreadPoolExecutor(2) as pool:
        tracer = _Tracer.of(pictures, path, frame)
        each = iter(pictures)
        while some := list(islice(each, _AT_ONCE)):
            count += len(some)
            profiles += [one for one in pool.map(profile, some) if one is not None]
    if len(profiles) < FEWEST:
        raise PictureError(
            f"{path}: the laser's line is found on both sides of the fiducial plate in "
            f"{len(profiles)} of {count} pictures ({FEWEST} wanted); let it cross the plate's "
            "white left and right of the dish, brighter than the light around, and sweep over the "
            "whole print"
        )
    return Traced(tracer.whole, tuple(profiles), count)


@dataclass(frozen=True)
class _Tracer:
    """What all pictures share; ``even`` and ``grid`` are transposed where the line runs upright."""

    frame: CameraFrame
    whole: Image
    ground: Image
    channel: int
    upright: bool
    least: float
    even: BoolArray
    grid: FloatArray
    middle: float
    widest: int
    eye: FloatArray

    @staticmethod
    def of(pictures: Iterable[Reader], path: Path, frame: CameraFrame) -> _Tracer:
        some = _spread(pictures)
        for one in some:
            _check_like(one, some[0], path, frame)
        whole = some[0]
        for one in some[1:]:
            whole = np.asarray(cv2.min(whole, one))
        channel = _channel(some, whole)
        ground = _one(whole, channel)
        height, width = ground.shape
        over = [_over(_one(one, channel), ground) for one in some]
        noise = float(np.median([1.48 * np.median(np.abs(one[::4, ::4])) for one in over]))
        brightest = max(float(one.max()) for one in over)
        least = max(_NOISES * noise, _LEAST * brightest, 1.0)
        upright = _is_upright(over, 0.5 * brightest)
        grid = _ray_grid(frame, (height, width))
        middle = frame.to_pixels(np.array([frame.middle_mm]))[0, 1 if upright else 0]
        even = _even(np.ascontiguousarray(ground.T) if upright else ground)
        if upright:
            grid = np.ascontiguousarray(grid.transpose(1, 0, 2))
        widest = max(6, round(1e3 * _WIDEST_MM / frame.um_per_px))
        return _Tracer(
            frame, whole, ground, channel, upright, least, even, grid, float(middle), widest,
            np.array(frame.eye_mm),
        )  # fmt: skip

    def profile(self, image: Image) -> Profile | None:
        """Line of one picture; None where the insert doesn't show it."""
        single = _one(image, self.channel)
        gain = _gain(single, self.ground)
        row = line_middles(single, self.ground, gain, self.least, self.widest, self.upright)
        column = np.flatnonzero(np.isfinite(row)).astype(np.float64)
        row = row[np.isfinite(row)]
        slopes = _bilinear(self.grid, row / _GRID_PX, column / _GRID_PX)
        at = self._on_insert(slopes)
        inside, beside = _places(self.frame, at)
        even = self.even[np.rint(row).astype(int), column.astype(int)]
        usable = beside & even
        line = straight_line(at[usable], column[usable] < self.middle, FEWEST)
        if line is None:
            return None
        ends = np.array([self._face(end) for end in line.ends])
        return Profile(ends, line.off_mm, slopes[inside])

    def _on_insert(self, slopes: FloatArray) -> FloatArray:
        """Places (n, 2) of the insert's face that rays meet, mm."""
        eye, (x, y, z) = self.eye, self.frame.middle_mm
        rise = np.array(self.frame.marks_z_slope)
        down = z - eye[2] + (eye[:2] - (x, y)) @ rise
        return np.asarray(eye[:2] + slopes * (down / (1 - slopes @ rise))[:, None])

    def _face(self, at: FloatArray) -> FloatArray:
        middle = np.array(self.frame.middle_mm)
        rise = (at - middle[:2]) @ np.array(self.frame.marks_z_slope)
        return np.append(at, middle[2] + rise)


def _check_like(image: Image, first: Image, path: Path, frame: CameraFrame) -> None:
    """Raise unless a picture has the frame's size, and the first one's colours and depth."""
    width, height = frame.lens.size_px
    if image.shape[1::-1] != (width, height):
        raise PictureError(
            f"{path}: a picture has {image.shape[1]} x {image.shape[0]} px, the frame's have "
            f"{width} x {height}; film at the setting that the frame was fitted at"
        )
    if image.shape != first.shape or image.dtype != first.dtype:
        raise PictureError(
            f"{path}: some pictures are {_kind(first)}, others {_kind(image)}; write all of a "
            "sweep in one format"
        )


def _kind(image: Image) -> str:
    return f"{'grey' if image.ndim == 2 else 'in colour'}, of type {image.dtype}"


def _spread(pictures: Iterable[Reader]) -> list[Image]:
    """Some pictures from all over a sweep."""
    step = max(1, sum(1 for _ in pictures) // _GROUNDS)
    return [read() for read in islice(pictures, step // 2, None, step)][:_GROUNDS]


def _channel(some: list[Image], ground: Image) -> int:
    """Colour in which the line stands out most from the ground."""
    if ground.ndim == 2:
        return 0
    over = np.max([cv2.subtract(one, ground).max(axis=(0, 1)).astype(float) for one in some], 0)
    usual = np.median(ground[::8, ::8].reshape(-1, ground.shape[2]), axis=0)
    return int((over - 0.5 * usual).argmax())


def _one(image: Image, channel: int) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.extractChannel(image, channel))


def _gain(image: Image, ground: Image) -> float:
    """Light of a picture over the ground's: lamps flicker."""
    some = np.s_[::_GRID_PX, ::_GRID_PX]
    return float(image[some].mean() / max(ground[some].mean(), 1.0))


def _over(image: Image, ground: Image) -> Float32Array:
    return np.asarray(image - np.float32(_gain(image, ground)) * ground, dtype=np.float32)


def _is_upright(over: list[Float32Array], bright: float) -> bool:
    """Whether the line runs from top to bottom rather than from left to right."""
    votes = 0
    for one in over:
        row, column = np.nonzero(one > bright)
        if len(row):  # else the laser shines beside the view
            votes += 1 if np.std(row) > np.std(column) else -1
    return votes > 0


def _even(ground: Image) -> BoolArray:
    """Where the ground is of one brightness across the line, (rows, columns)."""
    soft = cv2.GaussianBlur(ground.astype(np.float32), (0, 0), 1.0)
    around = np.ones((11, 5), np.uint8)
    most, least = cv2.dilate(soft, around), cv2.erode(soft, around)
    return np.asarray(most - least < _FLAT * most + 2.0)


def _ray_grid(frame: CameraFrame, shape: tuple[int, int]) -> FloatArray:
    """Rays' x and y per z at each eighth pixel, (rows, columns, 2)."""
    v, u = (np.arange(0, side + 2 * _GRID_PX, _GRID_PX, dtype=np.float64) for side in shape)
    uu, vv = np.meshgrid(u, v)
    way = rays(frame.view, np.column_stack([uu.ravel(), vv.ravel()]))
    return np.asarray((way[:, :2] / way[:, 2:]).reshape(*uu.shape, 2))


@jit
def _bilinear(grid: FloatArray, row: FloatArray, column: FloatArray) -> FloatArray:
    """Values of a grid (rows, columns, 2) between its nodes, (n, 2)."""
    out = np.empty((len(row), 2))
    for k in range(len(row)):
        i, j = int(row[k]), int(column[k])
        down, across = row[k] - i, column[k] - j
        for n in range(2):
            upper = grid[i, j, n] * (1 - across) + grid[i, j + 1, n] * across
            lower = grid[i + 1, j, n] * (1 - across) + grid[i + 1, j + 1, n] * across
            out[k, n] = upper * (1 - down) + lower * down
    return out


def _places(frame: CameraFrame, at: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which places (n, 2) of the insert's plane lie in its hole, and which on its face."""
    off = np.abs(at - np.array(frame.middle_mm[:2]))
    hole, plate = np.array(frame.insert.hole_mm) / 2, np.array(frame.insert.plate_mm) / 2
    round_hole = frame.insert.shape == "round"

    def within(half: FloatArray) -> BoolArray:
        share = off / half
        return np.asarray((np.hypot(*share.T) if round_hole else share.max(axis=1)) < 1)

    return within(hole), ~within(hole + _EDGE_MM) & (off < plate - _EDGE_MM).all(axis=1)
