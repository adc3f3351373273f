"""Register an earlier picture to the present one: affine camera motion, fitted on unwritten bath.

A camera that moved by a part of a pixel shows every older line twice in a difference. The two
pictures are fitted to each other where nothing was written in between: an affine map, and light
that changed as a polynomial of second order, by Gauss and Newton with Huber's weights (Lucas and
Kanade 1981, IJCAI 2, 674), first blurred and then as they are. Where the ground shows nothing to
hold on to, the map stays the identity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from registration.inspection.pictures.working import Mask
from registration.inspection.values import FloatImage, Image

_BLURS_PX: Final = (4.0, 2.0, 0.8)
_ROUNDS: Final = 6
_MOST: Final = 400_000
"""Pixels of the ground that are fitted at last; of more, evenly spread ones."""
_MOST_BLURRED: Final = 50_000
"""The same while pictures are blurred: neighbours are alike, and the last fit begins there."""
_FEWEST: Final = 400
_PRIOR_PX: Final = 1.0
"""Standard deviation of a camera's move where the ground tells nothing."""
_PRIOR_SLOPE: Final = 2e-3
"""And of its turn and scale."""
_FAR_PX: Final = 2.0
"""Noise alone was fitted as moves of up to 27 pixels on a ground without texture."""
_OUTLYING: Final = 2.5
"""Spreads of what differs, from which on it hardly counts: a glint or bubble moves by itself."""
_BETTER: Final = 0.95
"""Of the mean square difference at rest: a far move that leaves more isn't believed."""


@dataclass(frozen=True)
class CameraMove:
    """Map of pixels (x, y) to those of an earlier picture.

    Attributes
    ----------
    matrix : (2, 3) float64
    most_px : float
        Largest move within the fitted ground.
    """

    matrix: FloatArray
    most_px: float

    def applied(self, earlier: Image) -> Image:
        """Return the earlier picture as the present camera would show it."""
        high, wide = earlier.shape[:2]
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        moved = cv2.warpAffine(
            earlier, self.matrix, (wide, high), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(moved).reshape(earlier.shape)


def camera_move(now: FloatImage, earlier: FloatImage, ground: Mask) -> CameraMove:
    """Fit how the camera moved since an earlier picture.

    Parameters
    ----------
    now, earlier : (h, w, c) float32
        Logarithms of brightness.
    ground : (h, w) uint8
        1 where nothing was written in between.
    """
    high, wide = ground.shape
    middle = np.array([(wide - 1) / 2, (high - 1) / 2])
    half = max(wide, high) / 2
    p = np.zeros(6)  # dx, dy at the middle, and the four slopes times half
    if cv2.countNonZero(ground) < _FEWEST:
        return CameraMove(np.eye(2, 3), 0.0)
    for blur in _BLURS_PX:
        most = _MOST if blur == _BLURS_PX[-1] else _MOST_BLURRED
        places = _places(ground, most // now.shape[2])
        p = _fitted(p, _soft(now, blur), _soft(earlier, blur), places, middle, half)
    matrix = _matrix(p, middle, half)
    move = CameraMove(matrix, _most_px(matrix, ground))
    if move.most_px > _FAR_PX:  # on a ground without texture the noise alone was fitted
        still = CameraMove(np.eye(2, 3), 0.0)
        places = _places(ground, _MOST_BLURRED)
        sharp = [_soft(one, _BLURS_PX[-1]) for one in (now, earlier)]
        left = [
            _left(sharp[0], one.applied(sharp[1]), places, middle, half) for one in (move, still)
        ]
        if left[0] > _BETTER * left[1]:
            return still
    return move


def _most_px(matrix: FloatArray, ground: Mask) -> float:
    """Largest move within the ground's bounds."""
    y, x = np.nonzero(ground)
    corners = np.array([[x.min(), y.min()], [x.max(), y.min()], [x.min(), y.max()],
                        [x.max(), y.max()]], dtype=np.float64)  # fmt: skip
    off = corners @ matrix[:, :2].T + matrix[:, 2] - corners
    return float(np.hypot(off[:, 0], off[:, 1]).max())


def _left(
    now: FloatImage,
    moved: Image,
    places: tuple[IntArray, IntArray],
    middle: FloatArray,
    half: float,
) -> float:
    """Mean square of what differs on the ground, light taken out."""
    y, x = places
    light = _light((x - middle[0]) / half, (y - middle[1]) / half)
    rest = (now[y, x] - moved[y, x]).astype(np.float64)
    rest = rest - light @ np.linalg.lstsq(light, rest, rcond=None)[0]
    return float((rest**2).mean())


def _light(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])


def _soft(values: FloatImage, blur: float) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), blur).reshape(values.shape))


def _matrix(p: FloatArray, middle: FloatArray, half: float) -> FloatArray:
    slopes = np.eye(2) + p[2:].reshape(2, 2) / half
    return np.column_stack([slopes, middle + p[:2] - slopes @ middle])


def _places(ground: Mask, most: int) -> tuple[IntArray, IntArray]:
    """Rows and columns of evenly spread pixels of the ground."""
    y, x = np.nonzero(ground)
    some = slice(None, None, max(1, len(x) // most))
    return y[some], x[some]


def _fitted(
    p: FloatArray,
    now: FloatImage,
    earlier: FloatImage,
    places: tuple[IntArray, IntArray],
    middle: FloatArray,
    half: float,
) -> FloatArray:
    y, x = places
    u, v = (x - middle[0]) / half, (y - middle[1]) / half
    light = _light(u, v)
    prior = np.diag([_PRIOR_PX**-2] * 2 + [(_PRIOR_SLOPE * half) ** -2] * 4)
    for _ in range(_ROUNDS):
        moved = CameraMove(_matrix(p, middle, half), 0.0).applied(earlier)
        power, score = prior.copy(), -prior @ p
        for c in range(now.shape[2]):
            one = np.ascontiguousarray(moved[:, :, c])
            dx, dy = (
                cv2.Sobel(one, cv2.CV_32F, *way, ksize=3, scale=1 / 8)[y, x].astype(np.float64)
                for way in ((1, 0), (0, 1))
            )
            rest = (now[y, x, c] - one[y, x]).astype(np.float64)
            design = np.column_stack([dx, dy, dx * u, dx * v, dy * u, dy * v])
            own_power, own_score = _weighted(design, rest, light)
            power, score = power + own_power, score + own_score
        step = np.linalg.solve(power, score)
        p = p + step
        if np.abs(step[:2]).max() < 0.005:
            break
    return p


def _weighted(
    design: FloatArray, rest: FloatArray, light: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Information on the map (6, 6) and its score (6,), light taken out."""
    weight = np.ones(len(rest))
    own: NDArray[np.float64] = rest
    for _ in range(3):
        level = np.linalg.lstsq((light.T * weight) @ light + 1e-9 * np.eye(6),
                                (light.T * weight) @ rest, rcond=None)[0]  # fmt: skip
        own = rest - light @ level
        spread = 1.4826 * float(np.median(np.abs(own))) + 1e-9
        weight = 1.0 / (1.0 + (own / (_OUTLYING * spread)) ** 2) ** 2
    a = design - light @ np.linalg.lstsq((light.T * weight) @ light + 1e-9 * np.eye(6),
                                         (light.T * weight) @ design, rcond=None)[0]  # fmt: skip
    scaled = (a.T * weight) / spread**2
    return scaled @ a, scaled @ own
