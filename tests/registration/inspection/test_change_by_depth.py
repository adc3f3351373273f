"""Opaque ink in a turbid bath: what changes over older ink is a matter of its depth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from kernels.arrays import FloatArray
from registration.inspection import ExpectedLines, see_layer
from registration.inspection.values import Image

WIDTH, PITCH, SIZE, SCALE, EDGE = 0.4, 0.68, 6.0, 40.0, 0.8
TURBID = 0.2
"""Of the bath's own light, that a layer of it adds."""


class _View:
    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray((points_mm[:, :2] + EDGE) * SCALE)


def _places(layer: int) -> FloatArray:
    return np.arange(0.5 * PITCH * (layer // 2 % 2), SIZE + 1e-9, PITCH)


def _lines(layers: int) -> ExpectedLines:
    """Lines of layers across each other, each second pair half a pitch aside; the last is new."""
    starts, ends, layer = [], [], []
    for k in range(layers):
        at = _places(k)
        flat = np.column_stack([at, np.full(len(at), 0.3 * k)])
        starts.append(np.insert(flat, k % 2, 0.0, axis=1))
        ends.append(np.insert(flat, k % 2, SIZE, axis=1))
        layer.append(np.full(len(at), k))
    number = np.arange(sum(map(len, layer)))
    return ExpectedLines(
        np.concatenate(starts), np.concatenate(ends), np.full(len(number), WIDTH), number, number,
        np.concatenate(layer) == layers - 1,
    )  # fmt: skip


def _picture(layers: int, rng: np.random.Generator) -> Image:
    count = round((SIZE + 2 * EDGE) * SCALE)
    at = np.arange(count) / SCALE - EDGE
    light = np.full((count, count), 60.0)
    inside = (at > 0) & (at < SIZE)
    for k in range(layers):
        light += TURBID * (60.0 - light)
        lines = (np.abs(at[:, None] - _places(k)) < 0.5 * WIDTH).any(axis=1)
        ink = np.outer(inside, lines) if k % 2 else np.outer(lines, inside)
        light[ink] = 170.0
    noisy = gaussian_filter(light, 1.0) + rng.normal(0.0, 1.0, light.shape)
    return np.asarray(np.clip(np.round(noisy), 0, 255), dtype=np.uint8)


@pytest.mark.parametrize("layers", [3, 4])
def test_a_sound_opaque_layer_has_no_gaps_where_older_ink_lies_higher(layers: int) -> None:
    rng = np.random.default_rng(layers)
    pictures = [_picture(count, rng) for count in (layers - 1, layers)]
    assert not see_layer(pictures[1], _View(), _lines(layers), before=pictures[0]).gaps
