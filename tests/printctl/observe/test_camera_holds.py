"""Whether an earlier picture was taken where a camera's frame holds."""

from __future__ import annotations

import numpy as np

from printctl.observe.views import frame_holds
from tests.registration.devices.camera_frame import scene


def test_an_earlier_picture_holds_only_in_the_frame_that_was_fitted_where_it_was_taken() -> None:
    """A camera that was bumped and fitted anew has moved since the picture before."""
    frame = scene.frame()
    assert frame_holds(scene.shifted(0.0, 0.0), frame)
    assert not frame_holds(scene.shifted(0.2, 0.0), frame)
    assert not frame_holds(None, frame)
    assert not frame_holds(scene.shifted(0.0, 0.0), object())
    assert not frame_holds(np.zeros((400, 400), np.uint8), frame)
