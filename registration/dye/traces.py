"""Read a dye video into dye over time at points along vessels, shake and light drift removed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.devices.lens import Lens
from registration.dye.film import Frame, film_frames
from registration.dye.stabilise import (
    FloatImage,
    Steadier,
    ground_pixels,
    has_enough_ground,
    sample_picture,
)
from registration.dye.stations import DyeStations, place_stations
from registration.dye.view import View
from registration.errors import DyeError

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

    def _mean(self, values: FloatArray | FloatImage) -> FloatArray:
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


def _floating(frame: Frame) -> FloatImage:
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
