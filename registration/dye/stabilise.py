"""Measure camera shift and light change of each dye video frame, from pixels off the vessels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.dye.view import View

FloatImage = NDArray[np.float32]

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

    def __init__(self, first: FloatImage, off: NDArray[np.bool_]):
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

    def _reduced(self, image: FloatImage) -> FloatImage:
        size = [max(round(self._small * n), 1) for n in image.shape[1::-1]]
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))

    def _ground(self, grey: FloatImage) -> FloatImage:
        """A small grey picture with the vessels painted over, so that dye doesn't pull.

        Light that varies slowly is taken out: it stands still when the picture moves.
        """
        small = np.log(self._reduced(grey))
        slow = self._blurred(np.where(self._off, small, 0.0).astype(np.float32))
        return np.where(self._off, small - slow / self._weight, 0.0).astype(np.float32)

    def _blurred(self, image: FloatImage) -> FloatImage:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), _SLOW_PX))

    def shift(self, frame: FloatImage) -> FloatArray:
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

    def _refined(self, grey: FloatImage, shift: FloatArray) -> tuple[float, FloatArray]:
        """Misfit at a place refined from a first guess, and that place."""
        for _ in range(_ROUNDS):
            solved = self._solve @ self._changed(grey, shift)
            shift = shift - np.clip(solved[:2], -_FARTHEST_PX, _FARTHEST_PX)
        rest = self._changed(grey, shift)
        return float(np.median(np.abs(rest - self._moves @ (self._solve @ rest)))), shift

    def _changed(self, grey: FloatImage, shift: FloatArray) -> FloatArray:
        there = sample_picture(grey[:, :, None], self._at + shift)[:, 0]
        return np.asarray(np.log(np.maximum(there, 1.0)) - self._grey)

    def light(self, frame: FloatImage, shift: FloatArray) -> FloatArray:
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


def sample_picture(frame: FloatImage, pixels: FloatArray) -> FloatImage:
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
