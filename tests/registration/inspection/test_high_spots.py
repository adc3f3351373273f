"""Blobs on a layer's lines, as a profiler's map shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import Kind, Profiled, profiled
from benchmarks.observe.laser import look
from kernels.arrays import FloatArray
from registration.inspection import LayerFindings


def _with_blobs(
    map_: Profiled, lines: tuple[int, ...], high: float, size: float
) -> tuple[LayerFindings, list[FloatArray]]:
    """A look at domes in the middle of lines, so many layers high and widths across; middles."""
    heights, middles = map_.heights, list[FloatArray]()
    rows, columns = np.indices(heights.shape)
    for k in np.flatnonzero(map_.layer == map_.layer.max())[list(lines)]:
        middle = 0.5 * (map_.start[k] + map_.end[k])
        column, row = (map_.to_map[:2, :3] @ middle + map_.to_map[:2, 3]) / map_.px
        away = 2.0 * np.hypot(rows - row, columns - column) * map_.px / map_.width / size
        dome = high * map_.thickness * np.sqrt(np.clip(1.0 - away**2, 0.0, None))
        top = middle[2] + map_.to_map[2, 3]
        heights = np.where(away < 1.0, np.fmax(heights, top + dome), heights)
        middles.append(middle[:2])
    return look(replace(map_, heights=heights.astype(np.float32))), middles


@pytest.mark.parametrize("kind", ["plate", "lattice", "solid"])
def test_a_blob_on_a_line_is_told_by_place_width_and_height(kind: Kind) -> None:
    map_ = profiled(2, kind)
    found, (middle,) = _with_blobs(map_, (3,), 1.2, 1.6)
    (blob,) = found.blobs
    assert blob.at_mm == pytest.approx(tuple(middle), abs=0.3 * map_.width)
    assert blob.height_mm == pytest.approx(1.1 * map_.thickness, abs=0.25 * map_.thickness)
    assert blob.width_mm == pytest.approx(1.5 * map_.width, abs=0.4 * map_.width)


@pytest.mark.parametrize("seed", [1, 2])
def test_low_broad_blobs_dont_hide_a_layer(seed: int) -> None:
    """Their slopes aren't the scatter of sound ink."""
    found, _ = _with_blobs(profiled(seed, "solid"), (2, 6, 10), 0.6, 5.0)
    assert found.seen_share > 0.8
    assert found.blobs
