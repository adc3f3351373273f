"""State that an observer learned from its looks, as another one that begins anew reads it."""

from __future__ import annotations

import json

import numpy as np

from printctl.observe.learned import STATE, Learned
from printctl.observe.records import LookRecord
from registration.inspection import Appearance


def test_an_observer_that_begins_anew_knows_what_the_last_look_had_learned() -> None:
    """The first look after a restart learned ink anew, and told nothing of a layer without ink."""
    look = Appearance(np.array([0.5, -1.0, 0.2]), np.ones((3, 61)), True, np.array([1.0, 2.0, 3.0]))
    known = Learned(look, (0.02, 0.03), "200 × 100 pixels")
    state = json.loads(json.dumps(known.state()))
    record = LookRecord(3, 10, 10, "end of layer 1", 1.0, "go_on", "", control={STATE: state})
    nothing = LookRecord(4, 20, 20, "end of layer 2", 2.0, "pause", "nothing seen: it hangs")
    found = Learned.before([record, nothing], 5)
    assert (found.voxel_mm, found.size) == ((0.02, 0.03), "200 × 100 pixels")
    assert found.appearance is not None
    for name in ("mix", "terms", "ink"):
        assert np.array_equal(getattr(found.appearance, name), getattr(look, name))
    assert Learned.before([record], 3) == Learned()
