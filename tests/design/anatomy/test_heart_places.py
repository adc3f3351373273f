"""A heart's base and right side, found in its shape."""

from dataclasses import replace

import numpy as np
import pytest

from design.anatomy.heart_base import _across_rims
from design.anatomy.heart_places import find_heart_places
from design.anatomy.openness import sample_surface
from design.errors import TissueError
from design.tissue import biventricle
from tests.design.anatomy.hearts import closed_heart, heart_tissue
from tests.design.tissue.kept import kept_tissue


def test_the_base_lies_across_the_rims_though_the_right_ventricle_opens_sideways():
    """Where cavities open on the whole was 12 degrees off here, 45 in a heart that is cut low."""
    places = find_heart_places(sample_surface(heart_tissue(), 6000))
    assert np.degrees(np.arccos(places.base[2])) < 1.5
    assert np.degrees(np.arccos(places.right[0])) < 3.0


def test_rims_that_lie_in_no_plane_leave_the_way_out():
    shape = biventricle(60.0)
    high = shape.vertices[:, 2] > shape.vertices[:, 2].max() - 1e-6
    bent = shape.vertices.copy()
    bent[high, 2] += 0.5 * np.abs(bent[high, 0])
    samples = sample_surface(kept_tissue(replace(shape, vertices=bent)), 6000)
    cavities = samples.points[~samples.outer].mean(axis=0)
    assert not _across_rims(samples, cavities, np.array([0.0, 0.0, 1.0])).any()
    assert np.degrees(np.arccos(find_heart_places(samples).base[2])) < 40.0


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_given_base_is_taken(turn):
    given = np.array([np.sin(turn), 0.0, np.cos(turn)])
    places = find_heart_places(sample_surface(heart_tissue(), 3000), given)
    np.testing.assert_allclose(places.base, given)


def places_of(surface, **given):
    return find_heart_places(sample_surface(kept_tissue(surface), 6000), **given)


def test_a_closed_heart_without_a_lid_is_refused_unless_its_base_is_given():
    round_heart = closed_heart(6.0, cut_mm=40.0)
    with pytest.raises(TissueError, match=r"base can't be told: .*give base_direction"):
        places_of(round_heart)
    assert not places_of(round_heart, base=np.array([0.0, 0.0, 1.0])).doubts


@pytest.mark.parametrize(("left", "right"), [(7.0, 7.0), (6.0, 8.0)])
def test_the_right_ventricle_is_told_by_its_shape_where_its_wall_is_not_thinner(left, right):
    """The right side was 90 to 178 degrees off, and the grooves were set at 60 degrees."""
    places = places_of(closed_heart(0.0, left_wall=left, right_wall=right))
    assert np.degrees(np.arccos(places.right[0])) < 5.0
    assert "told by its cavity's shape" in places.doubts[0]
    assert "give right_direction" in places.doubts[0]
    assert np.degrees(np.abs(places.grooves)) == pytest.approx(np.full(2, 80.0), abs=11.0)
