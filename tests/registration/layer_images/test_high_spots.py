"""Blobs on a layer's lines, as a profiler's map shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import Kind, profiled
from benchmarks.observe_laser import look


@pytest.mark.parametrize("kind", ["plate", "lattice", "solid"])
def test_a_blob_on_a_line_is_told_by_place_width_and_height(kind: Kind) -> None:
    map_ = profiled(2, kind)
    k = np.flatnonzero(map_.layer == map_.layer.max())[3]
    middle = 0.5 * (map_.start[k] + map_.end[k])
    column, row = (map_.to_map[:2, :3] @ middle + map_.to_map[:2, 3]) / map_.px
    rows, columns = np.indices(map_.heights.shape)
    away = np.hypot(rows - row, columns - column) * map_.px / map_.width
    dome = 1.2 * map_.thickness * np.sqrt(np.clip(1.0 - (away / 0.8) ** 2, 0.0, None))
    top = middle[2] + map_.to_map[2, 3]
    raised = np.where(away < 0.8, np.fmax(map_.heights, top + dome), map_.heights)
    (blob,) = look(replace(map_, heights=raised.astype(np.float32))).blobs
    assert blob.at_mm == pytest.approx(tuple(middle[:2]), abs=0.3 * map_.width)
    assert blob.height_mm == pytest.approx(1.1 * map_.thickness, abs=0.25 * map_.thickness)
    assert blob.width_mm == pytest.approx(1.5 * map_.width, abs=0.4 * map_.width)
