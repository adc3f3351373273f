"""Read a dye video into dye over time along vessels, shake and drift removed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from design.network import VesselNetwork
from kernels.arrays import Float32Array, FloatArray
from registration.devices.lens import Lens
from registration.dye.stations import DyeStations, place_stations
from registration.dye.view import View
from registration.errors import DyeError

Frame = NDArray[np.uint8]
FEWEST_FRAMES = 20


def film_frames(path: Path) -> Iterator[tuple[float, Frame]]:
    """Time in s and picture (height, width, 3; blue, green, red) of each frame.

    Times are the file's own for each frame; where a file has none that rise, frames are taken as
    evenly spaced at its rate.

    Raises
    ------
    DyeError
        When the file isn't there, isn't a film, or has no rate.
    """
    if not path.is_file():
        raise DyeError(f"{path} doesn't exist; give a film (.mp4, .avi, .mov)")
    # What ffmpeg has to say of a broken file is said by our message; it reads this once.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    film = cv2.VideoCapture(str(path))
    try:
        rate = float(film.get(cv2.CAP_PROP_FPS)) if film.isOpened() else 0.0
        yield from _timed(film, cv2.CAP_PROP_POS_MSEC, rate, path)
    finally:
        film.release()


def _timed(film: Any, clock: int, rate: float, path: Path) -> Iterator[tuple[float, Frame]]:
    index, last = 0, -np.inf
    while True:
        frame = film.read()[1] if film.isOpened() else None
        if frame is None:
            break
        time = float(film.get(clock)) / 1000.0
        if not time > last:
            if not rate > 0.0:
                raise DyeError(f"{path}: frames have no times and no rate; convert it to .mp4")
            time = index / rate if index == 0 else last + 1.0 / rate
        yield time, frame
        index, last = index + 1, time
    if index == 0:
        raise DyeError(f"{path}: no frame can be read; is it a film (.mp4, .avi, .mov), and whole?")
    if index < FEWEST_FRAMES:
        raise DyeError(f"{path}: {index} frames, fewer than {FEWEST_FRAMES}; film for longer")


_MARGIN_PX, _MOST_PIXELS, _ROUNDS, _RIM = 5.0, 12_000, 3, 12
_SMALL_PX, _SLOW_PX, _FARTHEST_PX = 480, 8.0, 3.0
_LEAST_OFF = 0.02
_SHIFT = 8
"""Drawing counts in so many binary places of a pixel."""


class Steadier:
    """Finds how each frame lies on the first, and how its light differs.

    Parameters
    ----------
    first : (height, width, 3) float32
    off : (height, width) bool
        Pixels off the vessels.
    """

    def __init__(self, first: Float32Array, off: NDArray[np.bool_]):
        self._small = min(1.0, _SMALL_PX / max(first.shape[:2]))
        self._off = self._reduced(off.astype(np.float32)) > 0.99
        grey = cv2.cvtColor(first, cv2.COLOR_BGR2GRAY)
        self._weight = np.maximum(self._blurred(self._off.astype(np.float32)), 1e-3)
        self._reference = self._ground(grey)
        self._window = cv2.createHanningWindow(self._reference.shape[::-1], cv2.CV_32F)
        rows, columns = np.nonzero(_without_rim(off))
        keep = np.linspace(0, len(rows) - 1, min(len(rows), _MOST_PIXELS)).astype(int)
        rows, columns = rows[keep], columns[keep]
        slope = np.gradient(ndimage.gaussian_filter(np.log(grey), 0.7))
        self._at = np.stack([columns, rows], axis=1).astype(np.float32)
        self._size = np.array([first.shape[1], first.shape[0]])
        self._basis = np.column_stack([np.ones(len(keep)), 2.0 * self._at / self._size - 1.0])
        moves = np.column_stack([slope[1][rows, columns], slope[0][rows, columns], self._basis])
        self._solve = np.linalg.pinv(moves)
        self._moves = moves
        self._grey = np.log(grey[rows, columns]).astype(np.float64)
        self._colours = np.log(first[rows, columns]).astype(np.float64)
        self._last = np.zeros(2)

    def _reduced(self, image: Float32Array) -> Float32Array:
        size = [max(round(self._small * n), 1) for n in image.shape[1::-1]]
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))

    def _ground(self, grey: Float32Array) -> Float32Array:
        """A small grey picture with the vessels painted over, so that dye doesn't pull.

        Light that varies slowly is taken out: it stands still when the picture moves.
        """
        small = np.log(self._reduced(grey))
        slow = self._blurred(np.where(self._off, small, 0.0).astype(np.float32))
        return np.where(self._off, small - slow / self._weight, 0.0).astype(np.float32)

    def _blurred(self, image: Float32Array) -> Float32Array:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), _SLOW_PX))

    def shift(self, frame: Float32Array) -> FloatArray:
        """How far right and down the picture has moved against the first, (2,), px.

        From the last frame's place and from phase correlation by Gauss-Newton on log intensity
        off the vessels, with a plane of light of its own; what fits best counts.
        """
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        moved, _ = cv2.phaseCorrelate(self._reference, self._ground(grey), self._window)
        tried = [
            self._refined(grey, start) for start in (self._last, np.array(moved) / self._small)
        ]
        self._last = min(tried, key=lambda one: one[0])[1]
        return self._last

    def _refined(self, grey: Float32Array, shift: FloatArray) -> tuple[float, FloatArray]:
        """Misfit at a place refined from a first guess, and that place."""
        for _ in range(_ROUNDS):
            solved = self._solve @ self._changed(grey, shift)
            shift = shift - np.clip(solved[:2], -_FARTHEST_PX, _FARTHEST_PX)
        rest = self._changed(grey, shift)
        return float(np.median(np.abs(rest - self._moves @ (self._solve @ rest)))), shift

    def _changed(self, grey: Float32Array, shift: FloatArray) -> FloatArray:
        there = sample_picture(grey[:, :, None], self._at + shift)[:, 0]
        return np.asarray(np.log(np.maximum(there, 1.0)) - self._grey)

    def light(self, frame: Float32Array, shift: FloatArray) -> FloatArray:
        """Plane through the log of the light's change, per colour, (3 coefficients, 3 colours).

        Least squares, twice: what lies off by more than three median deviations (a hand, a
        bubble) is left out the second time.
        """
        changed = np.log(sample_picture(frame, self._at + shift)) - self._colours
        plane = np.linalg.lstsq(self._basis, changed, rcond=None)[0]
        rest = np.abs(changed - self._basis @ plane).mean(axis=1)
        kept = rest <= 3.0 * np.median(rest)
        return np.asarray(np.linalg.lstsq(self._basis[kept], changed[kept], rcond=None)[0])

    def plane(self, pixels: FloatArray, coefficients: FloatArray) -> FloatArray:
        """That plane at pixels (n, 2), (n, 3 colours)."""
        basis = np.column_stack([np.ones(len(pixels)), 2.0 * pixels / self._size - 1.0])
        return np.asarray(basis @ coefficients)


def sample_picture(frame: Float32Array, pixels: FloatArray) -> Float32Array:
    """A picture at pixels (n, 2) between its own, (n, colours); its rim goes on outside."""
    # OpenCV's remap refuses more than 2¹⁵ rows.
    wide = -(-len(pixels) // 1024)
    at = np.zeros((wide * 1024, 2), dtype=np.float32)
    at[: len(pixels)] = pixels
    u, v = at.T.reshape(2, wide, 1024)
    sampled = cv2.remap(frame, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled.reshape(wide * 1024, -1)[: len(pixels)])


def ground_pixels(network: VesselNetwork, view: View, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels further than five from every vessel's projection."""
    start, end, r0, r1, _ = network.pieces()
    first, last = view.pixels(start), view.pixels(end)
    wide0, wide1 = r0 * view.scales(start) + _MARGIN_PX, r1 * view.scales(end) + _MARGIN_PX
    off = np.ones(shape, np.uint8)
    fine = 1 << _SHIFT
    for a, b, ra, rb in zip(first, last, wide0, wide1, strict=True):
        u, v = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
        side = np.array([-v, u])
        band = np.array([a + ra * side, b + rb * side, b - rb * side, a - ra * side])
        cv2.fillConvexPoly(off, np.round(band * fine).astype(np.int32), 0, shift=_SHIFT)
        for at, radius in ((a, ra), (b, rb)):
            middle = np.round(at * fine).astype(int).tolist()
            cv2.circle(off, middle, round(radius * fine), 0, cv2.FILLED, shift=_SHIFT)
    return off > 0


def has_enough_ground(off: NDArray[np.bool_]) -> bool:
    """Whether there is ground enough off the vessels to tell shake and light by."""
    return float(_without_rim(off).mean()) >= _LEAST_OFF


def _without_rim(off: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without the picture's rim, over which shake moves what isn't known."""
    inner = np.zeros_like(off)
    inner[_RIM:-_RIM, _RIM:-_RIM] = off[_RIM:-_RIM, _RIM:-_RIM]
    return inner


BASELINE_S, BASELINE_FRAMES, END_SHARE = 0.5, 5, 0.1
"""Frames before dye are the first half second, five at least; the end is the last tenth."""


@dataclass(frozen=True)
class Traces:
    """Dye at the stations over time.

    Attributes
    ----------
    times : (n,) float64, s
    dye : (s, n) float64
        Proportional to the lumen's mean concentration: -ln(I/I₀) of a dye that absorbs, I - I₀
        of one that glows; 0 before dye, positive with it. NaN where a station isn't seen.
    colour : str
        The one with most contrast.
    glows : bool
    shake_px : float
        Largest movement against the first frame.
    drift : float
        Largest relative change of the light.
    last : (height, width, 3) uint8
        The last frame, moved onto the first.
    corrected : bool
        Whether there was ground enough off the vessels to correct shake and light.
    """

    times: FloatArray
    dye: FloatArray
    colour: str
    glows: bool
    shake_px: float
    drift: float
    last: Frame
    corrected: bool


def read_traces(
    path: Path, network: VesselNetwork, view: View, lens: Lens | None = None
) -> tuple[DyeStations, Traces]:
    """Read a film once, frame by frame; the distortion of a ``lens`` is taken out of them.

    Raises
    ------
    DyeError
        A film that can't be read, or vessels outside its picture.
    PictureError
        Frames of another size than the lens was calibrated at.
    """
    frames = film_frames(path)
    if lens is not None:
        frames = ((time, lens.straighten(frame, path)) for time, frame in frames)
    time, frame = next(frames)
    reader = _Reader(path, network, view, frame)
    reader.read(time, frame)
    for time, frame in frames:
        if frame.shape != reader.shape:
            raise DyeError(f"{path}: frames change in size; convert it to one size")
        reader.read(time, frame)
    return reader.stations, reader.traces(frame)


class _Reader:
    """What is kept of each frame: means over the stations, and what was taken out."""

    def __init__(self, path: Path, network: VesselNetwork, view: View, first: Frame):
        self.shape = first.shape
        picture, size = _floating(first), (first.shape[0], first.shape[1])
        self.stations = place_stations(network, view, size)
        if not self.stations.seen.any():
            raise DyeError(
                f"{path}: by the marks none of the vessels is seen in the picture of {size[1]} × "
                f"{size[0]} pixels; check the marks' pixels and side"
            )
        off, free = ground_pixels(network, view, size), self.stations.free
        self._steadier = Steadier(picture, off) if has_enough_ground(off) else None
        self._at = self.stations.samples.reshape(-1, 2)
        self._weight = free / np.maximum(free.sum(axis=1, keepdims=True), 1)
        self._times: list[float] = []
        self._logs: list[FloatArray] = []
        self._levels: list[FloatArray] = []
        self._shifts: list[FloatArray] = []
        self._lights: list[FloatArray] = []

    def read(self, time: float, frame: Frame) -> None:
        """Keep a frame's means of intensity and of its logarithm."""
        picture, steadier = _floating(frame), self._steadier
        shift: FloatArray = np.zeros(2)
        gain: FloatArray = np.zeros((1, 3))
        if steadier is not None:
            shift = steadier.shift(picture)
            plane = steadier.light(picture, shift)
            gain = steadier.plane(self._at, plane)
            self._lights.append(plane[0])
        seen = sample_picture(picture, self._at + shift)
        self._logs.append(self._mean(np.log(seen) - gain))
        self._levels.append(self._mean(seen * np.exp(-gain)))
        self._times.append(time)
        self._shifts.append(shift)

    def _mean(self, values: FloatArray | Float32Array) -> FloatArray:
        shaped = values.reshape(*self._weight.shape, 3)
        return np.asarray(np.einsum("sk,skc->sc", self._weight, shaped))

    def traces(self, last: Frame) -> Traces:
        """All that was read."""
        times, seen = np.array(self._times), self.stations.seen
        dye, colour, glows = _chosen(times, np.array(self._logs), np.array(self._levels), seen)
        u, v = self._shifts[-1]
        moved = cv2.warpAffine(
            last, np.array([[1.0, 0.0, -u], [0.0, 1.0, -v]]), last.shape[1::-1],
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return Traces(
            times=times,
            dye=dye,
            colour=colour,
            glows=glows,
            shake_px=float(np.hypot(*np.array(self._shifts).T).max()),
            drift=float(np.abs(np.expm1(np.array(self._lights or [np.zeros(3)]))).max()),
            last=moved,
            corrected=self._steadier is not None,
        )


def _floating(frame: Frame) -> Float32Array:
    """Intensities of which a logarithm can be taken."""
    return np.maximum(frame.astype(np.float32), np.float32(1.0))


def before_dye(times: FloatArray) -> int:
    """Frames taken as before dye."""
    return max(int((times - times[0] < BASELINE_S).sum()), BASELINE_FRAMES)


def end_frames(times: FloatArray) -> int:
    """Frames at the end of which the final level is the median."""
    return max(int(END_SHARE * len(times)), BASELINE_FRAMES)


def frame_noise(dye: FloatArray) -> FloatArray:
    """Standard deviation of single frames, (s,), by the median of differences of neighbours."""
    steps = np.abs(np.diff(dye, axis=1))
    return np.asarray(np.median(steps, axis=1) / (0.6745 * np.sqrt(2.0)))


def _chosen(
    times: FloatArray, logs: FloatArray, levels: FloatArray, seen: NDArray[np.bool_]
) -> tuple[FloatArray, str, bool]:
    """Dye of the colour with most contrast; (n, s, 3) logs and levels of intensity."""
    first, last = before_dye(times), end_frames(times)
    less = -(logs - np.median(logs[:first], axis=0))
    more = levels - np.median(levels[:first], axis=0)
    end = np.median(less[-last:], axis=0)
    noise = np.stack([frame_noise(less[:, :, c].T) for c in range(3)], axis=1)
    contrast = np.abs(end) / np.maximum(noise, 1e-6)
    best = int(np.argmax(np.percentile(contrast[seen], 75, axis=0)))
    # The strongest stations say which way dye goes: unreached ones wander about zero.
    strong = seen & (np.abs(end[:, best]) >= np.percentile(np.abs(end[seen, best]), 60))
    glows = bool(np.median(end[strong, best]) < 0.0)
    dye = (more if glows else less)[:, :, best].T.copy()
    dye[~seen] = np.nan
    return dye, ("blue", "green", "red")[best], glows
