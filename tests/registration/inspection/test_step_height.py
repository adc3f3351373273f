"""Missing ink over older ink of its own kind, told by its height."""

import numpy as np
import pytest

from registration.inspection import ExpectedLines, LayerFindings, see_layer
from tests.registration.inspection.height_painter import SolidLayer, solid_layer


def _lines(layer: SolidLayer) -> ExpectedLines:
    """The layer over one of the same outline that is written across."""
    n = len(layer.start)
    start, end = (np.hstack([p, np.full((n, 1), 0.3)]) for p in (layer.start, layer.end))
    below = (0.0, 0.0, layer.thickness)
    number = np.repeat([0, 1], n)
    return ExpectedLines(
        np.vstack([start[:, [1, 0, 2]] - below, start]),
        np.vstack([end[:, [1, 0, 2]] - below, end]),
        np.full(2 * n, layer.width),
        np.arange(2 * n),
        number,
        number == 1,
    )


def _look(layer: SolidLayer) -> LayerFindings:
    return see_layer(layer.picture, layer, _lines(layer), thickness_mm=layer.thickness)


def _inside(layer: SolidLayer) -> float:
    """Way up to a place in the middle of the area, mm."""
    way = layer.size - layer.width
    return len(layer.start) // 4 * layer.size + 0.3 * way


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_layer_over_a_sound_one_is_seen_and_not_faulted(seed: int) -> None:
    found = _look(solid_layer(np.random.default_rng(seed)))
    assert found.gaps == ()
    assert found.seen_share > 0.4
    assert found.coverage > 0.9


@pytest.mark.parametrize("seed", range(5000, 5004))
def test_a_gap_over_older_ink_is_found(seed: int) -> None:
    begin = _inside(solid_layer(np.random.default_rng(seed)))
    found = _look(solid_layer(np.random.default_rng(seed), ((begin, begin + 0.4),)))
    (gap,) = found.gaps
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, begin + 0.4), abs=0.06)


@pytest.mark.parametrize("seed", range(5000, 5006))
def test_a_short_gap_at_a_rim_is_told_from_a_droop(seed: int) -> None:
    """A wall of two lines is rim alone: of a stranger's none shorter than three widths showed."""
    sound = solid_layer(np.random.default_rng(seed))
    begin = 0.4 * sound.size
    bare = (begin, begin + 2.0 * sound.width)
    found = _look(solid_layer(np.random.default_rng(seed), (bare,)))
    (gap,) = found.gaps
    assert (gap.from_mm, gap.to_mm) == pytest.approx(bare, abs=0.06)
