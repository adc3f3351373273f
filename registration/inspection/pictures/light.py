"""Remove uneven light and soft shadows from a layer picture's log channels; bath becomes 0.

In logarithms light adds. It is a polynomial of fourth order, fitted to the bath and, one step away
from it, to the ink (so that a large filled area has light of its own), straight soft shadows that
the bath shows from one end to the other (`bar_light`), and what it shows of light beyond that
over some millimetres.
"""

from __future__ import annotations

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.pictures.shadow_bars import bar_directions, bar_light
from registration.inspection.pictures.working import Mask, shrunk
from registration.inspection.values import FloatImage

_CELL_MM = 0.5
_FINE_MM = 0.2
"""Cells for shadows, whose edges may be half a millimetre wide."""
_ROUNDS = 2
"""Polynomial and shadows in turn."""
_BIN = 1.5
"""Cells to a place across a shadow."""
_ORDER = 4
_SECOND = 6
"""Terms up to the second order."""
_ENOUGH = 80
"""Cells of bath that bear the fourth order: corners darken with the fourth power."""
_LOCAL_CELLS = 3.0
_LEAST = 0.05
"""Of a cell that must show bath, or ink, to count."""
_PRIOR = 0.02
"""Weight of "nothing beyond the polynomial" where the bath is far."""


def flattened(
    channels: FloatImage, free: Mask, core: Mask, px_per_mm: float, local: bool = True
) -> FloatImage:
    """Channels (h, w, c) less light and bath: the bath lies at 0.

    Parameters
    ----------
    channels : (h, w, c) float32
    free, core : (h, w) uint8
        1 where there is nothing but bath, and in the middle of lines.
    px_per_mm : float
    local : bool
        Whether light is followed beyond a polynomial.
    """
    high, wide = channels.shape[:2]
    size = _size(channels, _CELL_MM * px_per_mm)
    own, light = _without_bars(channels, free, core, size, _size(channels, _FINE_MM * px_per_mm))
    if local:
        bath, share = _cells(own, free, size)
        for c in range(light.shape[1]):
            rest = (bath[:, c] - light[:, c]).reshape(size[1], size[0])
            light[:, c] += _local(rest, share, share > _LEAST).ravel()
    out = np.empty_like(channels)
    for c in range(out.shape[2]):
        out[:, :, c] = own[:, :, c] - _resized(light[:, c], size, (wide, high))
    return out


def _without_bars(
    channels: FloatImage, free: Mask, core: Mask, size: tuple[int, int], fine: tuple[int, int]
) -> tuple[FloatImage, FloatArray]:
    """Channels less straight shadows, and the polynomial of the rest at cells (cells, c)."""
    bath, share = _cells(channels, free, fine)
    weight, at = share * (share > _LEAST), _places(fine)
    own, light = channels, _light(channels, free, core, size)
    angles: list[float] = []
    for number in range(_ROUNDS):
        rest = bath - np.column_stack([_resized(one, size, fine).ravel() for one in light.T])
        if number == 0:
            angles = bar_directions(rest, weight, at, _BIN)
        if not angles:
            break
        bars = bar_light(rest, weight, at, _BIN, angles)
        shade = [_resized(one, fine, channels.shape[1::-1]) for one in bars.T]
        own = channels - np.stack(shade, axis=2)
        light = _light(own, free, core, size)
    return own, light


def _size(channels: FloatImage, cell_px: float) -> tuple[int, int]:
    """Cells across and down."""
    n = max(4.0, cell_px)
    high, wide = channels.shape[:2]
    return max(2, round(wide / n)), max(2, round(high / n))


def _resized(values: FloatArray, size: tuple[int, int], to: tuple[int, int]) -> FloatImage:
    """Cells (columns, rows) as a raster of another size, (rows, columns)."""
    raster = values.reshape(size[1], size[0]).astype(np.float32)
    return np.asarray(cv2.resize(raster, to, interpolation=cv2.INTER_LINEAR))


def _places(size: tuple[int, int]) -> FloatArray:
    """Column and row of each cell, (cells, 2)."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def _light(channels: FloatImage, free: Mask, core: Mask, size: tuple[int, int]) -> FloatArray:
    """Polynomial of the light of each channel, (cells, c)."""
    bath, bath_share = _cells(channels, free, size)
    ink, ink_share = _cells(channels, core, size)
    basis = _basis(size)
    is_bath = bath_share > _LEAST
    is_ink = _ink_cells(bath, ink, bath_share, ink_share, basis[:, :_SECOND])
    if is_bath.sum() < _ENOUGH:
        basis = basis[:, :_SECOND]
    out = np.empty_like(bath)
    for c in range(out.shape[1]):
        out[:, c] = _fit(basis, bath[:, c], bath_share * is_bath, ink[:, c], ink_share * is_ink)
    return out


def _cells(
    channels: FloatImage, mask: Mask, size: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Mean (cells, c) where the mask is set, and which share that is, (cells,)."""
    weight = mask.astype(np.float32)
    share = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    total = shrunk(channels * weight[:, :, None], size)
    total = total.reshape(size[0] * size[1], -1).astype(np.float64)
    flat = share.ravel().astype(np.float64)
    return total / np.maximum(flat, 1e-9)[:, None], flat


def _basis(size: tuple[int, int]) -> FloatArray:
    x, y = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    u, v = x.ravel(), y.ravel()
    powers = [(i, n - i) for n in range(_ORDER + 1) for i in range(n, -1, -1)]
    return np.column_stack([u**i * v**j for i, j in powers])


def _ink_cells(
    bath: FloatArray,
    ink: FloatArray,
    bath_share: FloatArray,
    ink_share: FloatArray,
    basis: FloatArray,
) -> BoolArray:
    """Cells whose lines show ink, where some may be missing, (cells,)."""
    maybe = np.asarray(ink_share > _LEAST, dtype=np.bool_)
    is_bath = bath_share > _LEAST
    if is_bath.sum() < 12 or maybe.sum() < 4:
        return maybe
    score = np.zeros(len(basis))
    for c in range(bath.shape[1]):
        light = _robust(basis, bath[:, c], bath_share * is_bath)
        rest = ink[:, c] - basis @ light
        noise = 1.5 * float(np.median(np.abs(bath[is_bath, c] - basis[is_bath] @ light))) + 1e-6
        step = float(np.median(rest[maybe]) + np.mean(rest[maybe])) / 2
        score += rest * step / noise**2
    usual = float(np.percentile(score[maybe], 80))
    return maybe & (score > 0.5 * usual) if usual > 0 else maybe


def _fit(
    basis: FloatArray,
    bath: FloatArray,
    bath_weight: FloatArray,
    ink: FloatArray,
    ink_weight: FloatArray,
) -> FloatArray:
    """Light of the bath at all cells, by bath and ink together, (cells,)."""
    use_ink = ink_weight.sum() > 0
    if bath_weight.sum() <= 0:  # no bath at all: ink stands for it, and nothing will be told
        return np.asarray(basis @ _robust(basis, ink, ink_weight))
    zero, one = np.zeros((len(basis), 1)), np.ones((len(basis), 1))
    design = np.vstack([np.hstack([basis, zero]), np.hstack([basis, one])])
    if not use_ink:
        return np.asarray(basis @ _robust(basis, bath, bath_weight))
    both = _robust(design, np.concatenate([bath, ink]), np.concatenate([bath_weight, ink_weight]))
    return np.asarray(basis @ both[:-1])


def _robust(design: FloatArray, values: FloatArray, weight: FloatArray) -> FloatArray:
    """Weighted least squares with Huber's weights, a little held together, (p,)."""
    use = weight > 0
    a, b, w = design[use], values[use], weight[use]
    pull = 1e-6 * w.sum() * np.eye(design.shape[1])
    own = w
    best: FloatArray = np.zeros(design.shape[1])
    if not len(b):
        return best
    for _ in range(8):
        best = np.linalg.lstsq((a.T * own) @ a + pull, (a.T * own) @ b, rcond=None)[0]
        off = np.abs(b - a @ best)
        limit = 1.5 * 1.4826 * float(np.median(off)) + 1e-9
        own = w * np.minimum(1.0, limit / np.maximum(off, 1e-12))
    return best


def _local(rest: FloatArray, share: FloatArray, is_bath: BoolArray) -> FloatArray:
    """What the bath shows beyond the polynomial, smoothed; 0 where it is far."""
    weight = (share * is_bath).reshape(rest.shape)
    known = rest[weight > 0]
    if not len(known):
        return np.zeros_like(rest)
    spread = 1.4826 * float(np.median(np.abs(known - np.median(known)))) + 1e-9
    filled = np.where(weight > 0, rest, 0.0).astype(np.float32)
    around = cv2.medianBlur(filled, 5) if min(rest.shape) >= 5 else filled
    weight = weight * (np.abs(rest - around) < 5.0 * spread)
    total = cv2.GaussianBlur(weight * np.where(weight > 0, rest, 0.0), (0, 0), _LOCAL_CELLS)
    return np.asarray(total / (cv2.GaussianBlur(weight, (0, 0), _LOCAL_CELLS) + _PRIOR))
