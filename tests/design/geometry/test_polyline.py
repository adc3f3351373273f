"""Lengths along a polyline, and places at lengths."""

from __future__ import annotations

import numpy as np

from design.geometry.polyline import arc_lengths, places_along

CORNER = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]])


def test_lengths_up_to_each_point():
    np.testing.assert_array_equal(arc_lengths(CORNER), [0.0, 3.0, 7.0])
    np.testing.assert_array_equal(arc_lengths(CORNER[:1]), [0.0])


def test_places_at_lengths_of_any_shape_and_ends_beyond():
    arc = arc_lengths(CORNER)
    np.testing.assert_array_equal(places_along(CORNER, arc, np.array(5.0)), [3.0, 2.0, 0.0])
    at = np.array([[-1.0, 1.5], [3.0, 9.0]])
    found = places_along(CORNER, arc, at)
    assert found.shape == (2, 2, 3)
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found[0], [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
    np.testing.assert_array_equal(found[1], [[3.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
