"""A look's map beside the last look's."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from printctl.observe.deciding.evidence import MapCheck
from printctl.observe.last_map import LastMap
from printctl.observe.scan_place import ScanSize
from registration.files.readers.heights import HeightMap
from registration.inspection import ExpectedLines, HeightFrame

_TO_MAP = np.eye(4)


def _look(
    number: int,
    rows: int,
    cell_mm: float = 0.02,
    to_map: np.ndarray = _TO_MAP,
    top: float = 0.2,
    block: slice | None = None,
    **changes: object,
) -> tuple[Any, Any]:
    """A look with a line in the map's middle, and its map of bare ground, with a block on it."""
    start, end = np.array([[1.0, 3.0, top]]), np.array([[5.0, 3.0, top]])
    number_of = np.zeros(1, np.int64)
    lines = ExpectedLines(start, end, np.full(1, 0.3), number_of, number_of, np.ones(1, bool))
    heights = np.random.default_rng(number).normal(0.0, 0.005, (rows, 300)).astype(np.float32)
    if block is not None:
        heights[block, 100:200] += top
    given = HeightMap(heights, (cell_mm, cell_mm))
    size = replace(ScanSize.of_heights(given, to_map), **cast(Any, changes))
    at = SimpleNamespace(
        look=SimpleNamespace(number=number),
        layer=SimpleNamespace(lines=lines, row=np.zeros(1, np.int64)),
        ink=SimpleNamespace(end=end, height_mm=np.full(1, 0.1), style="layered"),
        since=np.ones(1, bool),
    )
    picture = np.stack([np.clip((heights - top + 0.05) / 0.1, -0.5, 1.5), heights - top + 0.05], 2)
    view = SimpleNamespace(
        taken=heights, size=size, hidden=np.zeros(heights.shape, bool), image=picture,
        frame=HeightFrame(np.diag([1 / cell_mm, 1 / cell_mm, 1.0, 1.0])), thickness_mm=0.1,
    )  # fmt: skip
    return cast(Any, at), cast(Any, view)


def test_a_map_with_fewer_rows_than_the_last_looks_lacks_them() -> None:
    maps = LastMap()
    assert not maps.check(*_look(1, 300)).lacks
    assert (
        maps.check(*_look(2, 280)).lacks == "lacks 20 of 300 rows (400 µm) against the last look's"
    )
    assert "10 of 300 rows (200 µm)" in maps.check(*_look(2, 290)).lacks  # the second picture
    assert not maps.check(*_look(3, 300)).lacks  # compared with the last whole one
    assert not maps.check(*_look(4, 310)).lacks
    assert maps.check(*_look(5, 300)).lacks


def test_a_first_map_is_compared_with_the_size_that_its_frame_names() -> None:
    assert LastMap().check(*_look(1, 300)) == MapCheck(unsized=True)
    assert LastMap().check(*_look(1, 300, placed=True)) == MapCheck()
    assert LastMap().check(*_look(1, 300, whole=(300, 300))) == MapCheck()
    lacks = LastMap().check(*_look(1, 280, whole=(300, 300))).lacks
    assert lacks == "lacks 20 of 300 rows (400 µm) that observe.frame names"
    assert not LastMap().check(*_look(1, 298, whole=(300, 300))).lacks


def test_what_stood_there_and_is_gone_tells_of_rows_that_were_filled_up() -> None:
    maps = LastMap()
    maps.check(*_look(1, 300, block=slice(50, 100)))
    assert not maps.check(*_look(2, 300, block=slice(50, 100))).lacks
    moved = maps.check(*_look(3, 300, block=slice(38, 88))).lacks
    assert moved.startswith("lacks 0.48 mm² of what stood there at the last look")


@pytest.mark.parametrize("below", [0.1, 0.2])
def test_ink_is_lifted_by_the_map_of_the_layer_below_alone(below: float) -> None:
    """Of a look at mends alone the last map shows the same layer."""
    maps = LastMap()
    maps.check(*_look(1, 300, top=below))
    at, view = _look(2, 300, block=slice(100, 200))
    view.taken[100:200, 100:200] -= 0.1
    view.image[100:200, 100:200, 1] -= 0.1
    maps.check(at, view)
    at.map = MapCheck()
    image = maps.judged(at, view)
    lifted = float(np.median(image[110:190, 110:190, 1] - view.image[110:190, 110:190, 1]))
    assert (lifted, at.map.sunk_mm) == pytest.approx(
        (0.09, 0.1) if below == 0.1 else (0.0, 0.0), abs=0.015
    )


@pytest.mark.parametrize("other", ["cells", "place"])
def test_maps_of_another_place_or_spacing_arent_compared(other: str) -> None:
    maps, moved = LastMap(), np.eye(4)
    moved[0, 3] = 1.0
    maps.check(*_look(1, 300))
    changed = {"cells": {"cell_mm": 0.025}, "place": {"to_map": moved}}[other]
    assert not maps.check(*_look(2, 280, **cast(Any, changed))).lacks


def test_a_cameras_picture_has_no_rows_to_lose() -> None:
    at, view = _look(1, 300)
    view.hidden = None
    assert LastMap().check(at, view) == MapCheck()
    assert LastMap().judged(at, view) is view.image
