"""Glints on filaments in a bath: ink that plainly shows in their light, and gaps beside them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from registration.inspection import ExpectedLines, LayerFindings, SeeingOptions, see_layer

PX_MM = 0.025
MIDDLE = 3.0
"""Of the filament on which a glint lies, mm along it."""


class Flat:
    """A frame straight from above, which sees no depth."""

    def to_pixels(self, points_mm):
        """Pixels of places."""
        return np.asarray(points_mm)[:, :2] / PX_MM


def seen(dark=0.5, bare=None, glint=(0.0, 0.13), unseen_mm=0.7, light=130.0) -> LayerFindings:
    """Findings of three filaments of 6 mm, ``dark`` (or light) ones; the first may be bare.

    ``glint``: how far from its middle line, and its size, mm.
    """
    rng = np.random.default_rng(5)
    y, x = np.mgrid[0:240, 0:320] * PX_MM
    ink = np.zeros(x.shape)
    rows = (1.5, 3.0, 4.5)
    for number, row in enumerate(rows):
        spans = [(1.0, 7.0)]
        if number == 0 and bare is not None:
            spans = [(1.0, 1.0 + bare[0] - 0.2), (1.0 + bare[1] + 0.2, 7.0)]
        for low, high in spans:
            off = np.hypot(x - np.clip(x, low, high), y - row)
            ink = np.maximum(ink, np.sqrt(np.clip(1 - (off / 0.2) ** 2, 0, None)))
    plane = light * np.exp(-dark * ink)[..., None] * np.array([0.9, 1.0, 1.0])
    far, size = glint
    near = (x - 1.0 - MIDDLE) ** 2 + (y - rows[0] - far) ** 2
    plane = plane + 450.0 * np.exp(-near / (2 * size**2))[..., None]
    picture = cv2.GaussianBlur(plane, (0, 0), 1.0) + rng.normal(0, 1.5, plane.shape)
    z, count = np.full(3, 2.0), np.arange(3)
    start = np.column_stack([np.full(3, 1.0), rows, z])
    end = np.column_stack([np.full(3, 7.0), rows, z])
    lines = ExpectedLines(start, end, np.full(3, 0.4), count, count, np.ones(3, dtype=np.bool_))
    options = SeeingOptions(shift_mm=0.2, unseen_mm=unseen_mm)
    return see_layer(np.clip(picture, 0, 255).astype(np.uint8), Flat(), lines, options=options)


@pytest.mark.parametrize("far", [0.0, 0.15])
def test_ink_that_shows_in_a_glints_light_is_not_asked_about(far: float) -> None:
    """Of 200 sound looks 11 were asked about, nearly all because of glints."""
    found = seen(glint=(far, 0.13))
    assert not found.gaps
    assert found.unseen == ()
    assert seen(glint=(far, 0.13), unseen_mm=0.2).unseen  # what is saturated isn't seen


@pytest.mark.parametrize("dark", [0.5, -0.25])
@pytest.mark.parametrize("far", [0.0, 0.2, 0.35])
def test_a_glints_light_is_no_ink(dark: float, far: float) -> None:
    """Where ink is missing all around a glint nothing may pass as ink."""
    bare = (MIDDLE - 0.7, MIDDLE + 0.7)
    found = seen(dark, bare, (far, 0.16))
    told = np.zeros(200, dtype=np.bool_)
    along = np.linspace(bare[0] + 0.1, bare[1] - 0.1, 200)
    for one in (*found.gaps, *found.unseen):
        if one.stroke == 0:
            told |= (along > one.from_mm) & (along < one.to_mm)
    assert told.mean() > 0.95


def test_what_a_glint_hides_beside_a_gap_is_asked_about() -> None:
    """Of a clog half of which lay under a glint the other half alone was mended, silently."""
    found = seen(0.5, (MIDDLE - 0.2, MIDDLE + 1.0), (0.0, 0.16), unseen_mm=1.5)
    (gap,) = found.gaps
    assert gap.to_mm == pytest.approx(MIDDLE + 1.0, abs=0.1)
    (hidden,) = found.unseen
    assert hidden.from_mm < MIDDLE < hidden.to_mm <= gap.from_mm + 0.3
