"""Uneven shares of terminals are told with their place."""

import numpy as np

from design.anatomy.grown import uneven_notes
from design.tissue import block
from tests.design.tissue.kept import kept_tissue


def test_a_half_without_its_share_is_told_and_an_even_spread_isnt():
    surface = block((20.0, 10.0, 10.0))
    tissue = kept_tissue(surface)
    even = np.random.default_rng(1).uniform(0, (20, 10, 10), (160, 3))
    assert uneven_notes(tissue, even) == ()
    (note,) = uneven_notes(tissue, even * (0.5, 1, 1))
    assert "volume asks for" in note
    assert float(note.split("(")[1].split(",")[0]) > 10
