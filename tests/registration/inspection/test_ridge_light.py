"""Ridges lit from the side: where they lie, sound turns, and gaps beside turns."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.checkers import layer_painter as painter
from printctl.observe.deciding import GapTest
from registration.inspection import LayerFindings, see_layer
from tests.registration.inspection.painted import expected

_WIDTH = 0.45


def _seen(
    seed: int, layout: str, gaps: list[tuple[int, float, float]], kind: str = "relief"
) -> tuple[LayerFindings, np.ndarray]:
    """Findings of a layer of 3.5 mm at 20 µm per px, and its true shift, mm."""
    rng = np.random.default_rng(seed)
    plan = painter.plan_layer(layout, 3.5, _WIDTH, rng)
    look = painter.random_look(kind, rng, 0.3)
    shift = rng.uniform(-0.06, 0.06, 2)
    painted = painter.paint(
        plan, painter.lay(plan, rng, gaps=gaps), gaps, 3.5, 20.0, look, rng, shift=tuple(shift)
    )
    return see_layer(painted.picture, painted.frame, expected(plan)), shift


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ridges_lie_where_both_of_their_flanks_say(seed: int) -> None:
    """Bright flanks alone were taken for lines, 0.2 to 0.35 widths beside their middles."""
    found, shift = _seen(seed, "filled", [])
    off = np.array([found.shift.dx_mm, found.shift.dy_mm]) - shift
    assert np.hypot(*off) < 0.08 * _WIDTH
    assert np.all(np.abs(off) < 2.0 * np.sqrt(np.diag(found.shift.covariance_mm2)))


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_sound_filled_ridges_are_seen_and_whole(seed: int) -> None:
    found, _ = _seen(seed, "filled", [])
    assert found.seen_share > 0.6
    assert not any(GapTest().significant(gap, found.places) for gap in found.gaps)


def test_a_second_look_knows_the_ridges_of_the_first() -> None:
    """With a picture before, channels are twice as many as those of the picture itself."""
    rng = np.random.default_rng(5)
    plan = painter.plan_layer("meander", 3.5, _WIDTH, rng)
    look, ink = painter.random_look("relief", rng, 0.3), painter.lay(plan, rng)
    bare, first, second = (
        painter.paint(plan, one, [], 3.5, 20.0, look, np.random.default_rng(8))
        for one in ((*ink[:3], 0.0 * ink[3]), ink, ink)
    )
    lines = expected(plan)
    one = see_layer(first.picture, first.frame, lines, before=bare.picture)
    two = see_layer(second.picture, second.frame, lines, before=bare.picture, known=one.appearance)
    assert min(one.seen_share, two.seen_share) > 0.6
    assert not one.gaps
    assert not two.gaps
