"""A look's map beside the last look's."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from printctl.observe.last_map import LastMap
from printctl.observe.scan_place import ScanSize
from registration.layer_images import ExpectedLines
from registration.readers.heights import HeightMap

_TO_MAP = np.eye(4)


def _look(
    number: int, rows: int, cell_mm: float = 0.02, to_map: np.ndarray = _TO_MAP
) -> tuple[Any, Any]:
    """A look with a line in the map's middle, and its map of bare ground."""
    start, end = np.array([[1.0, 3.0, 0.2]]), np.array([[5.0, 3.0, 0.2]])
    number_of = np.zeros(1, np.int64)
    lines = ExpectedLines(start, end, np.full(1, 0.3), number_of, number_of, np.ones(1, bool))
    heights = np.random.default_rng(number).normal(0.0, 0.005, (rows, 300)).astype(np.float32)
    size = ScanSize.of_heights(HeightMap(heights, (cell_mm, cell_mm)), to_map)
    at = SimpleNamespace(
        look=SimpleNamespace(number=number),
        layer=SimpleNamespace(lines=lines),
        since=np.ones(1, bool),
    )
    view = SimpleNamespace(taken=heights, size=size, hidden=np.zeros(heights.shape, bool))
    return cast(Any, at), cast(Any, view)


def test_a_map_with_fewer_rows_than_the_last_looks_lacks_them() -> None:
    maps = LastMap()
    assert not maps.lacks(*_look(1, 300))
    assert maps.lacks(*_look(2, 280)) == "20 of 300 rows (400 µm)"
    assert maps.lacks(*_look(2, 290)) == "10 of 300 rows (200 µm)"  # the second picture
    assert not maps.lacks(*_look(3, 300))  # compared with the last whole one
    assert not maps.lacks(*_look(4, 310))
    assert maps.lacks(*_look(5, 300))


@pytest.mark.parametrize("other", ["cells", "place"])
def test_maps_of_another_place_or_spacing_arent_compared(other: str) -> None:
    maps, moved = LastMap(), np.eye(4)
    moved[0, 3] = 1.0
    maps.lacks(*_look(1, 300))
    changed = {"cells": {"cell_mm": 0.025}, "place": {"to_map": moved}}[other]
    assert not maps.lacks(*_look(2, 280, **cast(Any, changed)))


def test_a_cameras_picture_has_no_rows_to_lose() -> None:
    at, view = _look(1, 300)
    view.hidden = None
    assert not LastMap().lacks(at, view)
