"""Ink written along older ink of a layer: volumes add up, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from sim.gcode.deposit.strands import Strands
from sim.gcode.deposit.written import united


def lines(*each):
    """Strands of (start, end, area), each a stroke."""
    start, end, area = (np.array(one, dtype=float) for one in zip(*each, strict=True))
    number = np.arange(len(area))
    return Strands(start, end, area * np.linalg.norm(end - start, axis=1), area, number, number + 1)


SOUND = ((0, 0, 1), (7, 0, 1), 0.02)


def area_at(strands, x):
    low = np.minimum(strands.start, strands.end)[:, 0]
    high = np.maximum(strands.start, strands.end)[:, 0]
    return strands.area_mm2[(low < x) & (x < high)].sum()


@pytest.mark.parametrize("turned", [False, True])
def test_a_second_pass_fills_a_thin_line_up(turned):
    again = ((2, 0, 1), (5, 0, 1), 0.006)
    again = (again[1], again[0], 0.006) if turned else again
    found = united(lines(((0, 0, 1), (7, 0, 1), 0.014), again))
    assert area_at(found, 1.0) == pytest.approx(0.014)
    assert area_at(found, 3.5) == pytest.approx(0.02)
    assert area_at(found, 6.0) == pytest.approx(0.014)
    assert (found.area_mm2 > 0.015).sum() == 1, "the older piece is in the newer one"
    assert found.dose_ul.sum() == pytest.approx(7 * 0.014 + 3 * 0.006)


def test_several_passes_and_pieces_keep_the_volume():
    given = lines(
        ((0, 0, 1), (3, 0, 1), 0.02), ((3, 0, 1), (7, 0, 1), 0.02),
        ((2, 0.01, 1), (4, 0.01, 1), 0.01), ((2.5, 0, 1), (3.5, 0, 1), 0.004),
    )  # fmt: skip
    found = united(given)
    assert found.dose_ul.sum() == pytest.approx(given.dose_ul.sum())
    assert area_at(found, 3.2) == pytest.approx(0.034)
    assert area_at(found, 2.2) == pytest.approx(0.03)
    assert area_at(found, 0.5) == area_at(found, 6.5) == pytest.approx(0.02)


@pytest.mark.parametrize(
    "other",
    [
        ((0, 0.2, 1), (7, 0.2, 1), 0.02),
        ((3, -2, 1), (3, 2, 1), 0.02),
        ((0, 0, 1.02), (7, 0, 1.02), 0.02),
        ((7, 0, 1), (9, 0, 1), 0.02),
        ((7, 0, 1), (7, 3, 1), 0.02),
    ],
)
def test_neighbours_crossings_layers_and_ends_stay_as_they_are(other):
    given = lines(SOUND, other)
    assert united(given) is given or len(united(given)) == 2
