"""Convert a picture's log channels to one linear light value: bath 0, ink about 1.

The camera's values are taken as linear in light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.layer_images.values import FloatArray, FloatImage

_SAME = 0.02
"""Logarithm of ink over bath, below which light and logarithm are one."""
_LEAST = 0.05
"""Of all channels' ink: a channel that shows less of it isn't looked at."""
_MOST_LOG = 4.0


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
