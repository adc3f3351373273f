"""Height maps of which one end lies moved against the other."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import Kind, profiled
from benchmarks.observe_laser import expected
from registration.files.readers.heights import HeightMap
from registration.inspection import ExpectedLines, Surface, better_turned, surface_of
from registration.inspection.heights.moved_part import is_in_place
from registration.inspection.options import IN_PART
from registration.inspection.values import FloatImage


def _surface(
    kind: Kind, seed: int, lost: slice | None, axis: int = 0, bare: bool = False
) -> tuple[Surface, ExpectedLines]:
    map_ = profiled(seed, kind, ((0, 0.0, 20.0),) if bare else ())
    lines = expected(map_)
    heights: FloatImage = map_.heights
    if lost is not None:
        heights = np.delete(heights, lost, axis=axis)
    height_map = HeightMap(heights, (map_.px, map_.px))
    return surface_of(height_map, map_.to_map, map_.middle_z, map_.thickness, lines), lines


def _told(
    kind: Kind, seed: int, lost: slice | None, axis: int = 0, bare: bool = False
) -> str | None:
    surface, lines = _surface(kind, seed, lost, axis, bare)
    return better_turned(surface.picture, surface.frame, lines)


@pytest.mark.parametrize("kind", ["plate", "lattice", "solid"])
def test_a_sound_map_is_of_one_piece(kind: Kind) -> None:
    assert _told(kind, 4, None) is None


@pytest.mark.parametrize("seed", [4, 5])
def test_a_map_that_lacks_its_middle_rows_is_told(seed: int) -> None:
    """Lines that run across the lost rows show it; those along them only end early."""
    middle = len(profiled(seed, "plate").heights) // 2
    lost = slice(middle, middle + 10)  # less than a pitch
    told = [one for axis in (0, 1) if (one := _told("plate", seed, lost, axis))]
    assert told
    assert all(one.endswith(IN_PART) for one in told)


@pytest.mark.parametrize("seed", [0, 1, 4, 7])
def test_ink_tells_that_both_ends_of_a_map_lie_in_place_or_not(seed: int) -> None:
    """A whole line that is missing at a rim looks like lost rows."""
    whole, lines = _surface("plate", seed, None)
    assert is_in_place(whole.picture, whole.frame, lines)
    middle = len(profiled(seed, "plate").heights) // 2
    lost = slice(middle, middle + 10)
    for other in ((lost, 0, False), (lost, 1, False), (None, 0, True)):
        found, _ = _surface("plate", seed, *other)
        assert not is_in_place(found.picture, found.frame, lines)
