"""Fresh ink over older ink, told by a picture taken before the layer."""

from __future__ import annotations

import numpy as np
import pytest

from registration.inspection import ExpectedLines, LayerFindings, see_layer
from tests.registration.inspection.stacked_layers import Layer, Stack, stack
from tests.slower import first_of

SEEN = 4
"""A translucent stack whose layers add enough density."""


_SHOWN = 3
"""Older layers that the product is told of."""


def expected(found: Stack) -> ExpectedLines:
    """The layer and those below, as the product takes them."""
    layers = [*found.older[-_SHOWN:], found.layer]
    return ExpectedLines(
        np.vstack([_places(one, 0) for one in layers]),
        np.vstack([_places(one, 1) for one in layers]),
        np.concatenate([np.full(len(one.at), one.width) for one in layers]),
        np.arange(sum(len(one.at) for one in layers)),
        np.concatenate([np.arange(len(one.at)) + 1000 * k for k, one in enumerate(layers)]),
        np.repeat(np.arange(len(layers)) == len(layers) - 1, [len(one.at) for one in layers]),
    )


def _places(layer: Layer, which: int) -> np.ndarray:
    return np.hstack([layer.ends()[which], np.full((len(layer.at), 1), 0.3)])


def look(found: Stack) -> LayerFindings:
    """See one painted layer."""
    return see_layer(found.picture, found, expected(found), before=found.before)


@pytest.fixture(scope="module")
def painted() -> Stack:
    return stack(SEEN, "translucent", gaps=2)


def overlapping(found: Stack, stroke: int, begin: float, end: float) -> bool:
    base = 1000 * min(3, len(found.older))
    return any(stroke == base + k and begin < e and end > b for k, b, e in found.gaps)


def test_missing_translucent_ink_over_older_ink_is_found(painted: Stack) -> None:
    findings = look(painted)
    assert findings.seen_share > 0.7
    assert all(overlapping(painted, g.stroke, g.from_mm, g.to_mm) for g in findings.gaps)
    assert len(findings.gaps) == 2
    assert np.isfinite(findings.moved_px)


def test_a_sound_translucent_layer_has_no_gap() -> None:
    findings = look(stack(SEEN, "translucent"))
    assert findings.seen_share > 0.7
    assert not findings.gaps


@pytest.mark.parametrize("kind", first_of(["opaque", "matte"]))
def test_ink_that_adds_no_density_is_not_seen_over_itself(kind: str) -> None:
    findings = look(stack(SEEN, kind, gaps=2))
    assert findings.seen_share == 0.0
    assert not findings.gaps


@pytest.mark.parametrize("kind", first_of(["opaque", "translucent"]))
def test_ink_that_came_is_told_by_the_change_though_its_gaps_are_not(kind: str) -> None:
    """Ten looks at a dark print said the same of ink that came and of a clog: nothing was seen."""
    there = stack(SEEN, kind)
    noise = np.random.default_rng(5).normal(0.0, 1.0, there.before.shape)
    again = np.clip(np.rint(there.before + noise), 0, 255).astype(np.uint8)
    came, none = (
        see_layer(one, there, expected(there), before=there.before)
        for one in (there.picture, again)
    )
    way = float(came.stations.length_mm.sum())
    assert came.told.ink_mm > 0.8 * way
    assert came.older_step > 3.0 * came.older_limit
    assert none.told.ink_mm == 0.0
    assert none.older_step < 0.05 * came.older_step
    assert sum(one.length_mm for one in none.told.tail) > 0.9 * way


def test_a_camera_whose_marks_stand_still_has_not_moved(painted: Stack) -> None:
    """A part's shadow that grew on black glass "moved" it by 12 px, and a clog in part passed."""
    shaded = np.roll(painted.before, (4, -3), axis=(0, 1))
    findings = see_layer(
        painted.picture, painted, expected(painted), before=shaded, stood_still=lambda: True
    )
    assert findings.moved_px == 0.0
    assert np.isfinite(findings.older_step)  # by the picture before


def test_a_camera_that_moved_by_pixels_is_told_and_the_picture_before_left_out(painted):
    moved = np.roll(painted.before, (4, -3), axis=(0, 1))
    findings = see_layer(painted.picture, painted, expected(painted), before=moved)
    assert findings.moved_px > 3.0
    assert findings.seen_share == 0.0
    assert not findings.gaps
