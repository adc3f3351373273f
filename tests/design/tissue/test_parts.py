"""Tissues of several parts, and faces without area."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold

from design.errors import TissueError
from design.tissue import part_numbers, part_tissue, parts_of, tissue_from_surface
from design.vasculature import check_parts
from tests.design.tissue import surfaces


def _joined(*solids):
    found = [surfaces.surface(solid) for solid in solids]
    first = np.cumsum([0, *(len(one.vertices) for one in found)])
    return (
        np.concatenate([one.vertices for one in found]),
        np.concatenate([one.faces + k for one, k in zip(found, first, strict=False)]),
    )


def _tissue(*solids):
    return tissue_from_surface(*_joined(*solids))


SMALL = Manifold.cube((6.0, 6.0, 6.0))
LARGE = Manifold.cube((10.0, 10.0, 10.0))
BESIDE = {
    "apart": SMALL.translate((20.0, 0.0, 0.0)),
    "at a corner": SMALL.translate((10.0, 10.0, 10.0)),
    "at an edge": SMALL.translate((10.0, 10.0, 0.0)),
}


@pytest.mark.parametrize("place", BESIDE)
def test_parts_are_told_apart_even_where_they_touch(place):
    tissue = _tissue(LARGE, BESIDE[place])
    parts = parts_of(tissue)
    assert [round(part.volume_mm3) for part in parts] == [1000, 216]
    middles = np.array([part.middle_mm for part in parts])
    assert part_numbers(tissue, parts, middles).tolist() == [0, 1]


def test_a_cavity_is_no_part_and_what_lies_in_it_is_one():
    shells = surfaces.nested_shells()
    tissue = tissue_from_surface(shells.vertices, shells.faces)
    outer, inner = parts_of(tissue)
    assert outer.volume_mm3 + inner.volume_mm3 == pytest.approx(tissue.volume_mm3)
    at = np.array([[9.0, 0, 0], [7.0, 0, 0], [4.5, 0, 0], [0, 0, 0.0]])
    assert part_numbers(tissue, (outer, inner), at).tolist() == [0, -1, 1, -1]


def test_a_part_that_no_vessel_ends_in_is_refused_by_size_and_place():
    tissue = _tissue(LARGE, BESIDE["apart"])
    inside = np.array([[5.0, 5.0, 5.0]])
    with pytest.raises(TissueError, match=r"the part of 216 mm³ around \(23, 3, 3\) mm"):
        check_parts(tissue, inside)
    _, demand, number = check_parts(tissue, np.array([[23.0, 3.0, 3.0], [5.0, 5.0, 5.0]]))
    assert demand == pytest.approx([1000 / 1216, 216 / 1216])
    assert number.tolist() == [1, 0]


def test_a_part_is_a_tissue_of_its_own_with_its_cavities():
    shells = surfaces.nested_shells()
    tissue = tissue_from_surface(shells.vertices, shells.faces)
    outer = parts_of(tissue)[0]
    own = part_tissue(tissue, outer)
    assert own.volume_mm3 == pytest.approx(outer.volume_mm3)
    assert own.contains(np.array([[9.0, 0, 0], [7.0, 0, 0], [0, 0, 0.0]])).tolist() == [1, 0, 0]
