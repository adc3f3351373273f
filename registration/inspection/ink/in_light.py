"""Convert a picture's log channels to one linear light value: bath 0, ink about 1.

The camera's values are taken as linear in light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.inspection.values import FloatImage

_SAME = 0.02
"""Logarithm of ink over bath, below which light and logarithm are one."""
_LEAST = 0.05
"""Of all channels' ink: a channel that shows less of it isn't looked at."""
_MOST_LOG = 4.0
_SHARES = np.linspace(-1.0, 3.0, 401)
"""Of ink in light; noise and rims lie beyond 0 and 1."""
_LEAST_LIGHT = 1e-3


@dataclass(frozen=True)
class LightMix:
    """How channels make one value: 0 for bath, about 1 for ink.

    Attributes
    ----------
    mix : (c,) float64
        Weights of the channels.
    ink : (c,) float64
        Logarithm of ink over bath in each.
    """

    mix: FloatArray
    ink: FloatArray

    @staticmethod
    def of(mix: FloatArray, ink: FloatArray) -> LightMix:
        """Leave out channels that show hardly any ink."""
        part = np.abs(mix * ink)
        shows = part > _LEAST * part.sum()
        return LightMix(np.where(shows, mix, 0.0), np.clip(ink, -_MOST_LOG, _MOST_LOG))

    @property
    def used(self) -> list[int]:
        """Channels with a weight."""
        return [int(k) for k in np.flatnonzero(self.mix)]

    def values(self, logs: FloatArray | FloatImage) -> FloatArray:
        """Light of channels (..., c) that hold logarithms over the bath's; (...)."""
        total = float(self.mix @ self.ink)
        out = np.zeros(logs.shape[:-1])
        for c in self.used:
            out += float(self.mix[c]) * _scaled(logs[..., c], float(self.ink[c]))
        return out / total


def _scaled(logs: FloatArray | FloatImage, ink: float) -> FloatArray:
    """Light of one channel that is ``ink`` where the channel is."""
    values = np.asarray(logs, dtype=np.float64)
    if abs(ink) < _SAME:
        return values
    most = max(_MOST_LOG, 2.0 * abs(ink))
    light: FloatArray = np.expm1(np.clip(values, -most, most))
    return light * (ink / float(np.expm1(ink)))


def in_light(values: FloatArray | FloatImage, log_step: float) -> FloatArray:
    """Levels from logarithms to brightness, bath 0 and ink 1: a picture's blur is one of light.

    ``log_step`` is ink's logarithm over the bath's.
    """
    level = np.asarray(values, dtype=np.float64)
    if abs(log_step) < _SAME:
        return level
    return np.asarray(np.expm1(log_step * np.clip(level, -1.0, 3.0)) / np.expm1(log_step))


def mixed_in_light(
    values: FloatArray | FloatImage, mix: FloatArray, ink: FloatArray, response: float = 1.0
) -> FloatArray | None:
    """Share of ink in the light, from sums of channels' logarithms; None where none tells it.

    Of light that is a share a of ink's and else the bath's the channel c shows
    log(1 + a (e^ink_c - 1)). Their weighted sum bends otherwise than any single channel does:
    colours of ink that is brighter than the bath show a little of it as much.

    Parameters
    ----------
    values : (..., k) float
        Weighted sum, divided by that of ink.
    mix, ink : (c,) float64
        Weights, and logarithm of ink over bath.
    response : float
        Power of its values that is light: 1 of a camera as it is wanted, 2.2 of coded pictures.
    """
    light = LightMix.of(mix, np.asarray(ink))
    steps = np.expm1(response * light.ink)
    seen = light.mix @ np.log(np.maximum(1.0 + steps[:, None] * _SHARES, _LEAST_LIGHT))
    whole = float(np.interp(1.0, _SHARES, seen))
    if abs(whole) < 1e-9:
        return None
    seen = seen / whole
    if (np.diff(seen[(_SHARES >= 0) & (_SHARES <= 1)]) <= 0).any():
        return None
    rise = np.maximum.accumulate(np.where(_SHARES >= 0, seen, 0.0))
    fall = np.minimum.accumulate(np.where(_SHARES < 0, seen, 0.0)[::-1])[::-1]
    return np.asarray(np.interp(values, rise + fall, _SHARES))
