"""Places that are neither surely ink nor told as gaps aren't seen."""

from __future__ import annotations

import numpy as np

from registration.inspection.gaps.sure_ink import unsure_places
from registration.inspection.ink.presence import WindowNoise
from registration.inspection.ways import lay_ways
from tests.registration.inspection.lines import straight_lines

_GAP_MM = 0.2
_NOISE = WindowNoise(np.array([0.2, 1.0]), 1.0, np.array([0.1, 0.1]), 0.05)


def _unsure(present: float, strength: float) -> tuple[np.ndarray, np.ndarray]:
    """Which of 0.2 mm with little ink, and of sound ink, might be a gap."""
    ways = lay_ways(straight_lines(1, 10.0), _GAP_MM / 4)
    low = (ways.along > 5.0) & (ways.along < 5.2)
    found = unsure_places(
        np.where(low, present, 1.0), np.ones(len(ways), dtype=bool), ways, _NOISE, _GAP_MM, 1e-4,
        np.full(len(ways), strength),
    )  # fmt: skip
    return found[low], found[~low]


def test_a_stretch_that_might_be_bare_isnt_seen() -> None:
    low, sound = _unsure(0.1, 1.0)
    assert low.all()
    assert not sound.any()


def test_a_stretch_that_noise_doesnt_explain_isnt_seen() -> None:
    """Gaps of 0.2 mm beside turns of ridges showed 0.3 to 0.45 of ink, and were taken for it."""
    low, sound = _unsure(0.42, 1.0)
    assert low.all()
    assert not sound.any()


def test_thin_ink_is_ink() -> None:
    low, _ = _unsure(0.6, 1.0)
    assert not low.any()


def test_nothing_is_seen_where_a_gap_would_be_lost_in_noise() -> None:
    low, sound = _unsure(1.0, 0.3)
    assert low.all()
    assert sound.all()
