"""Thin ink between lines that touch: told by bath at their seams, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.inspection import LayerFindings, see_layer
from tests.registration.inspection.painted import Scene, expected

FILLED = Scene(3, layout="filled", size=8.0, width=0.3)
FROM, TO = 20.0, 40.0
_END = 1.2
"""Way at either end of a thin stretch, mm, within which it may be told or not."""


def seen(scene: Scene, thin: tuple[float, float, float] | None = None) -> LayerFindings:
    painted = scene.paint(thin=thin)
    return see_layer(painted.picture, painted.frame, expected(painted.plan))


@pytest.mark.parametrize("seed", [3, 4, 5])
@pytest.mark.parametrize("kind", ["opaque", "absorbing"])
@pytest.mark.parametrize("um_per_px", [20.0, 40.0])
def test_two_fifths_of_the_flow_in_a_filled_layer_are_told(
    seed: int, kind: str, um_per_px: float
) -> None:
    findings = seen(replace(FILLED, seed=seed, kind=kind, um_per_px=um_per_px), (FROM, TO, 0.4))
    along = np.arange(0.0, 80.0, 0.05)
    told = np.zeros(len(along), dtype=np.bool_)
    for one in (*findings.stretches, *findings.gaps):
        told |= (along > one.from_mm) & (along < one.to_mm)
    thin = (along > FROM + _END) & (along < TO - _END)
    near = (along > FROM - _END) & (along < TO + _END)
    assert told[thin].mean() > 0.95
    assert not told[~near].any()
    assert all(one.kind == "thin" and 0.3 < one.ratio < 0.7 for one in findings.stretches)
    assert sum(one.to_mm - one.from_mm for one in findings.gaps) < 1.5
    assert findings.seen_share > 0.85  # thin ink isn't taken for sound ink's scatter
    assert findings.coverage < 0.93


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["opaque", "absorbing"])
def test_sound_filled_layers_show_no_thin_line_though_round_ink_has_valleys(
    seed: int, kind: str
) -> None:
    findings = seen(replace(FILLED, seed=seed, kind=kind))
    assert not findings.stretches
    assert findings.coverage > 0.95
    assert findings.untold_seams < 0.1
