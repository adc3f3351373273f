"""Sample a needle picture and its background on a grid around the needle's end."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from kernels.arrays import FloatArray
from registration.devices.camera_frame.tip_axis import NeedleAxis
from registration.devices.camera_frame.tip_model import Lattice, RodEnd
from registration.devices.camera_frame.tip_patch import TipPatch

_ABOVE: Final = 3.0
_BELOW: Final = 1.2
_BESIDE: Final = 1.4
"""What is fitted around the end, of the width."""
_ROOM_PX: Final = 4.0
_ROWS: Final = 26
"""Samples of a width at most."""
_LEAST_NOISE: Final = 1e-3
_LEAST_CONTRAST: Final = 0.02


class Samples(NamedTuple):
    """Light of the picture and of the ground (k, m), 0 to 1, and where both are known."""

    seen: FloatArray
    ground: FloatArray | None
    known: NDArray[np.bool_]


class TipLight:
    """The light of a patch, to be sampled at any place.

    Attributes
    ----------
    wide : float, px
        Of the needle at its end, by its profile.
    noise : float
        Deviation of the ground beside the needle.
    contrast : float
        Of the needle to its ground.
    """

    def __init__(self, patch: TipPatch, axis: NeedleAxis) -> None:
        self._patch = patch
        self.wide = patch.wide_px
        self._known = np.isfinite(patch.grey)
        if patch.ground is not None:
            self._known &= np.isfinite(patch.ground)
        level = float(np.nanmedian(patch.grey))
        self._grey = spline_filter(np.nan_to_num(patch.grey, nan=level))
        self._ground = (
            None if patch.ground is None else spline_filter(np.nan_to_num(patch.ground, nan=level))
        )
        self.noise, self.contrast = self._levels(axis)

    def _levels(self, axis: NeedleAxis) -> tuple[float, float]:
        """Noise and contrast."""
        patch = self._patch
        aside = np.abs(patch.beside - axis.beside - axis.lean * patch.above[:, None])
        off = patch.grey - (np.nanmedian(patch.grey) if patch.ground is None else patch.ground)
        out = off[self._known & (aside > 0.9 * self.wide) & (aside < 2 * self.wide)]
        rod = off[self._known & (aside < 0.5 * self.wide) & (patch.above[:, None] > 0)]
        if min(len(out), len(rod)) < 20:
            return 0.01, 0.1
        middle = float(np.median(out))
        noise = 1.4826 * float(np.median(np.abs(out - middle)))
        contrast = float(np.percentile(np.abs(rod - middle), 80))
        return max(noise, _LEAST_NOISE), max(contrast, _LEAST_CONTRAST)

    def lattice(self, end: float) -> Lattice:
        """Where the model of an end at a height is compared."""
        step = max(1.0, self.wide / _ROWS)
        low = end - _BELOW * self.wide - _ROOM_PX
        high = min(end + _ABOVE * self.wide + _ROOM_PX, float(self._patch.above[-3]))
        far = _BESIDE * self.wide + _ROOM_PX
        bow = self._patch.end_px / self._patch.wide_px
        return Lattice(np.arange(low, high, step), np.arange(-far, far + step / 2, step), bow)

    def around(self, lattice: Lattice, rod: RodEnd, beside: float, lean: float) -> Samples:
        """Light at the lattice's places about an axis; farther up they spread with the needle."""
        heights = lattice.heights[:, None]
        wider = 1 + self._patch.taper * (heights - rod.end)
        columns = beside + lean * heights + lattice.beside * wider - self._patch.beside[0]
        rows = np.broadcast_to(heights - self._patch.above[0], columns.shape)
        known = map_coordinates(self._known.astype(np.float64), [rows, columns], order=1, cval=0.0)
        ground = None if self._ground is None else _splined(self._ground, rows, columns)
        return Samples(_splined(self._grey, rows, columns), ground, known > 0.99)


def _splined(coefficients: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    return np.asarray(
        map_coordinates(coefficients, [rows, columns], order=3, prefilter=False, mode="nearest")
    )
