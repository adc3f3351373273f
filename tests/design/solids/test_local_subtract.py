"""Large lumens subtracted near the surface alone: as by the whole boolean."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from design.geometry.crossings import find_crossings
from design.solids import Solid, block_solid, construct_solid, lumen_solid, surface_genus
from design.solids.check_made import check_made
from design.solids.local_subtract import subtract_near
from tests.design.solids.networks import channels, ladder


@cache
def block() -> Solid:
    return block_solid((16, 8, 3))


def _lumen(fillet: float = 0.5) -> Solid:
    return lumen_solid(ladder(), extend_ends_mm=1.0, fillet_ratio=fillet)


@pytest.mark.parametrize("fillet", [0.0, 0.5])
def test_a_ladder_open_at_both_faces_is_cut_as_by_the_whole_boolean(fillet: float) -> None:
    lumen = _lumen(fillet)
    near, whole = subtract_near(block(), lumen, "it"), construct_solid(block(), lumen)
    assert near is not None
    assert near.volume_mm3 == pytest.approx(whole.volume_mm3, rel=1e-8)
    assert surface_genus(near.faces) == surface_genus(whole.faces)
    assert len(find_crossings(near.vertices, near.faces).pairs) == 0
    assert np.array_equal(near.vertices, near.vertices.astype(np.float32))
    assert check_made(near) is not None


def test_a_lumen_that_meets_no_face_and_a_body_of_two_shells_are_left_to_it() -> None:
    inner = lumen_solid(channels([[3, 4, 1.5], [9, 4, 1.5]], [(0, 1)], 0.4))
    assert subtract_near(block(), inner, "it") is None
    assert subtract_near(construct_solid(block(), inner), _lumen(), "it") is None
