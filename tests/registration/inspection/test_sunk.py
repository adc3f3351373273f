"""Ink on ground that sank is judged by its rise over that."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import Bare, Kind, profiled
from benchmarks.observe_laser import expected
from registration.files.readers.heights import HeightMap
from registration.inspection import LayerFindings, see_layer, surface_of
from registration.inspection.heights.sunk import lifted


def _looks(
    kind: Kind,
    seed: int,
    sunk: float,
    bare: tuple[Bare, ...] = (),
    lost: slice | None = None,
) -> tuple[LayerFindings, LayerFindings, float]:
    """Looks without and with the last map, in a hollow so many layers deep; how deep it is told."""
    map_ = profiled(seed, kind, bare)
    lines, thick = expected(map_), map_.thickness
    y, x = (2.5 * one / len(map_.heights) - 1.25 for one in np.indices(map_.heights.shape))
    hollow = sunk * thick * np.exp(-((x**2 + y**2) ** 2))
    ink = map_.surface > (map_.layer.max() + 0.5) * thick
    rise = np.where(np.isfinite(map_.heights), thick * ink, np.nan).astype(np.float32)
    if lost is not None:
        rise[lost] = np.nan
    at = HeightMap((map_.heights - hollow).astype(np.float32), (map_.px, map_.px))
    surface = surface_of(at, map_.to_map, map_.middle_z, thick, lines)
    raised, told = lifted(
        surface.picture, surface.hidden, rise, thick, map_.width / map_.px
    )  # fmt: skip
    plain, by_rise = (
        see_layer(one, surface.frame, lines, hidden=surface.hidden, thickness_mm=thick)
        for one in (surface.picture, raised)
    )
    return plain, by_rise, told / thick


@pytest.mark.parametrize("kind", ["solid", "lattice"])
@pytest.mark.parametrize("seed", [1, 2])
def test_sound_ink_in_a_hollow_is_seen_and_not_faulted(kind: Kind, seed: int) -> None:
    plain, by_rise, told = _looks(kind, seed, 0.9)
    assert plain.gaps or plain.seen_share < 0.7
    assert by_rise.gaps == ()
    assert by_rise.seen_share > 0.8
    assert 0.7 < told < 1.2


@pytest.mark.parametrize("seed", [1, 2])
def test_a_gap_in_a_hollow_remains_one(seed: int) -> None:
    _, by_rise, _ = _looks("solid", seed, 0.9, ((5, 2.0, 3.0),))
    (gap,) = by_rise.gaps
    assert gap.length_mm == pytest.approx(1.0, abs=0.3)


def test_a_line_that_the_last_map_lost_isnt_taken_for_missing() -> None:
    middle = len(profiled(1, "solid").heights) // 2
    _, by_rise, _ = _looks("solid", 1, 0.9, lost=slice(middle - 25, middle + 25))
    assert by_rise.gaps == ()
    assert by_rise.seen_share > 0.8
