"""Wording of pose uncertainty."""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.alignment.doubts import rival_words
from registration.alignment.rivals import AlternativePose, describe, may_lie_otherwise
from registration.notes import depth_notes, unlisted_notes
from tests.registration.parts import solid

RIVAL = AlternativePose("mirrored along x", True, 1.1, 849.0, np.array([7.8, 7.0, 1.1]), seen=False)


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        ("mirrored along x", "may lie otherwise, mirrored along x: that"),
        ("a half turn about z", "may lie otherwise, by a half turn about z: that"),
        (
            "mirrored along x and a shift of 0.38 mm along x",
            "may lie otherwise, mirrored along x and by a shift of 0.38 mm along x: that",
        ),
    ],
)
def test_motions_are_told_in_grammar(motion: str, said: str) -> None:
    assert said in rival_words(replace(RIVAL, motion=motion), 1.5)


def test_what_the_print_lacks_isnt_asked_for_again() -> None:
    assert "wasn't seen; scan it too" in rival_words(RIVAL, 1.5)
    said = rival_words(replace(RIVAL, amid=True), 1.5)
    assert "scan it too" not in said
    assert "the print lacks it" in said


@pytest.mark.parametrize("whole", [True, False])
def test_a_missing_hole_is_amid_what_was_scanned(whole: bool) -> None:
    # A hole beside the middle, which the print lacks; or the scan ends before it.
    block = manifold3d.Manifold.cube((8.0, 8.0, 3.0))
    hole = manifold3d.Manifold.cube((0.6, 0.6, 0.6)).translate((5.5, 4.0, 1.2))
    surface = ModelSurface.of(solid(block - hole))
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 1, (4000, 3)) * (8.0, 8.0, 3.0)
    side = rng.integers(0, 3, 4000)
    high = rng.random(4000) < 0.5
    ends = np.array([8.0, 8.0, 3.0])
    points[np.arange(4000), side] = np.where(high, ends[side], 0.0)
    if not whole:
        points = points[points[:, 0] < 4.0]
    best = Fit(np.eye(3), np.zeros(3), np.ones(3), ends / 2)
    turned = np.diag([-1.0, -1.0, 1.0])
    other = Fit(turned, np.array([8.0, 8.0, 0.0]), np.ones(3), ends / 2)
    found = describe(surface, points, best, other, 1.1, False)
    assert found.amid == whole


def test_a_symmetry_of_the_design_leads_to_no_other_places() -> None:
    assert may_lie_otherwise([RIVAL], 1.5)
    assert not may_lie_otherwise([RIVAL], 1.05)
    assert not may_lie_otherwise([replace(RIVAL, apart_um=3.0)], 1.5)
    assert not may_lie_otherwise([], 1.5)


def test_ways_that_rest_on_a_doubtful_pose_are_counted_and_not_listed() -> None:
    assert unlisted_notes(0) == []
    (note,) = unlisted_notes(28)
    assert note.startswith(
        "At this pose 28 places look like leaks or bridges. They aren't findings"
    )


def test_a_depth_that_is_scaled_alone_may_be_the_index() -> None:
    interval = np.array([0.003, 0.003, 0.025])
    (note,) = depth_notes(np.array([1.0, 1.0, 1.034]), interval, 2, 1.333)
    assert "3.4 % longer than across" in note
    assert "1.378 in place of 1.333" in note
    assert depth_notes(np.array([0.97, 0.97, 0.98]), interval, 2, 1.333) == []
