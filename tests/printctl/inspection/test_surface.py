"""Layers in height maps: gaps, blobs, what a profiler lost, missing ink told by its height."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import Kind, Profiled, profiled
from benchmarks.observe.laser import expected, look, planted
from kernels.arrays import FloatArray
from printctl.inspection import (
    ExpectedLines,
    LayerFindings,
    Surface,
    Unseen,
    find_better_orientation,
    see_layer,
    surface_of,
)
from printctl.inspection.options import IN_PART
from printctl.inspection.values import FloatImage
from registration.errors import PictureError
from registration.files.readers.heights import HeightMap
from tests.printctl.inspection.height_painter import SolidLayer, solid_layer
from tests.printctl.inspection.painted import lines_of

KINDS: tuple[Kind, ...] = ("plate", "lattice", "solid")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_sound_layer_is_seen_and_not_faulted(kind: Kind, seed: int) -> None:
    found = look(profiled(seed, kind))
    assert found.gaps == ()
    assert found.blobs == ()
    assert found.seen_share > 0.8
    assert found.coverage > 0.95


@pytest.mark.parametrize("kind", KINDS)
def test_a_gap_is_found_where_it_is(kind: Kind) -> None:
    found, stroke, bare = planted(100_000, kind, 0.5)
    (gap,) = found.gaps
    assert gap.stroke == stroke
    assert gap.from_mm < bare[1] + 0.05
    assert gap.to_mm > bare[2] - 0.05
    assert gap.length_mm < 0.5 + 0.5 * 0.45 + 0.1  # round ends: half a width more


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bare", [(), ((3, 1.5, 2.5),)])
def test_what_was_lost_is_neither_ink_nor_gap(kind, bare):
    """A patch without points lies over 1 to 3 mm of lines, whether ink is there or not."""
    map_ = profiled(2, kind, bare)
    at = np.arange(len(map_.heights)) * map_.px - 2.0
    map_.heights[np.ix_((at > 0.0) & (at < 4.5), (at > 1.0) & (at < 3.0))] = np.nan
    found = look(map_)
    assert found.gaps == ()
    s = found.stations
    own = (s.stroke == np.flatnonzero(map_.layer == map_.layer.max())[3]) & ~s.seen
    assert s.length_mm[own].sum() > 1.8
    assert set(s.why[own]) <= {Unseen.HIDDEN, Unseen.OLD_INK, Unseen.FAINT, Unseen.UNCLEAR}


def test_a_layer_that_lies_aside_is_not_taken_for_sound() -> None:
    map_ = profiled(4, "solid", ((5, 1.5, 2.2),))
    to_map = map_.to_map.copy()
    to_map[:2, 3] -= to_map[:2, :2] @ [1.2, 1.2]
    found = look(replace(map_, to_map=to_map))
    assert found.gaps or found.seen_share < 0.5


def test_a_layer_of_which_all_is_missing_is_bare() -> None:
    map_ = profiled(3, "plate", tuple((k, -1.0, 20.0) for k in range(20)))
    found = look(map_)
    assert {gap.stroke for gap in found.gaps} == set(range(len(map_.start)))


def small(heights: FloatArray, to_map: FloatArray | None = None) -> Surface:
    """Two lines of 0.3 mm, 0.1 mm high, on a plate at z 5; cells of 30 µm."""
    map_ = profiled(1, "plate")
    return surface_of(
        HeightMap(heights.astype(np.float32), (map_.px, map_.px)),
        map_.to_map if to_map is None else to_map,
        map_.middle_z,
        map_.thickness,
        expected(map_),
    )


def test_what_was_not_measured_is_hidden_and_spikes_are_taken_out() -> None:
    heights = np.array(profiled(1, "plate", hard=0.0).heights)
    heights[np.isnan(heights)] = 3.0
    heights[100:102, 50:200] = np.nan
    heights[150:154, 150:154] = np.nan
    heights[20, 20] = 9.0  # a spike
    found = small(heights)
    assert found.hidden.sum() == 2 * 150 + 4 * 4
    assert found.hidden[151, 151]
    assert np.isfinite(found.picture).all()
    assert found.picture[20, 20, 1] == pytest.approx(found.picture[24, 24, 1], abs=0.01)
    blue, green, red = found.shaded()[151, 151]
    assert blue > green > red


def test_a_profiler_that_looks_up_or_saw_nothing_is_refused() -> None:
    map_ = profiled(1, "plate")
    with pytest.raises(PictureError, match="don't grow with the printer's z"):
        small(map_.heights, np.diag([1.0, -1.0, -1.0, 1.0]))
    with pytest.raises(PictureError, match="no height at all"):
        small(np.full_like(map_.heights, np.nan))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("over", [0.5, 3.0])
def test_the_flat_surface_of_a_bath_over_the_layer_is_neither_ink_nor_gap(kind, over):
    map_ = profiled(3, kind)
    top = 3.0 + map_.thickness * (map_.layer.max() + 1 + over)
    noise = np.random.default_rng(1).normal(0, 0.003, map_.heights.shape)
    found = look(replace(map_, heights=(top + noise).astype(np.float32)))
    assert found.gaps == ()
    assert found.seen_share == 0.0


def test_widths_are_within_their_uncertainty_and_over_older_ink_unknown() -> None:
    each = [look(profiled(seed, "plate")) for seed in range(8)]
    off = [(one.width_ratio - 1) / one.u_width_ratio for one in each if one.u_width_ratio < 1]
    assert len(off) >= 3
    assert max(np.abs(off)) < 2.0
    assert np.isinf(look(profiled(0, "lattice")).u_width_ratio)


@pytest.mark.parametrize("kind", ["plate", "solid"])
@pytest.mark.parametrize("seed", range(3))
def test_a_tilt_and_bow_of_more_than_a_layer_are_taken_out(kind: Kind, seed: int) -> None:
    def aslant(bare: tuple[tuple[int, float, float], ...]) -> LayerFindings:
        map_ = profiled(seed, kind, bare)
        y, x = (2.0 * one / len(map_.heights) - 1.0 for one in np.indices(map_.heights.shape))
        off = map_.thickness * (0.8 * x - 0.5 * y + 0.7 * x * x)
        return look(replace(map_, heights=(map_.heights + off).astype(np.float32)))

    sound, broken = aslant(()), aslant(((3, 1.5, 2.5),))
    assert sound.gaps == ()
    assert sound.seen_share > 0.8
    assert len(broken.gaps) == 1


# Blobs on a layer's lines, as a profiler's map shows them.


def _with_blobs(
    map_: Profiled, lines: tuple[int, ...], high: float, size: float
) -> tuple[LayerFindings, list[FloatArray]]:
    """A look at domes in the middle of lines, so many layers high and widths across; middles."""
    heights, middles = map_.heights, list[FloatArray]()
    rows, columns = np.indices(heights.shape)
    for k in np.flatnonzero(map_.layer == map_.layer.max())[list(lines)]:
        middle = 0.5 * (map_.start[k] + map_.end[k])
        column, row = (map_.to_map[:2, :3] @ middle + map_.to_map[:2, 3]) / map_.px
        away = 2.0 * np.hypot(rows - row, columns - column) * map_.px / map_.width / size
        dome = high * map_.thickness * np.sqrt(np.clip(1.0 - away**2, 0.0, None))
        top = middle[2] + map_.to_map[2, 3]
        heights = np.where(away < 1.0, np.fmax(heights, top + dome), heights)
        middles.append(middle[:2])
    return look(replace(map_, heights=heights.astype(np.float32))), middles


@pytest.mark.parametrize("kind", ["plate", "lattice", "solid"])
def test_a_blob_on_a_line_is_told_by_place_width_and_height(kind: Kind) -> None:
    map_ = profiled(2, kind)
    found, (middle,) = _with_blobs(map_, (3,), 1.2, 1.6)
    (blob,) = found.blobs
    assert blob.at_mm == pytest.approx(tuple(middle), abs=0.3 * map_.width)
    assert blob.height_mm == pytest.approx(1.1 * map_.thickness, abs=0.25 * map_.thickness)
    assert blob.width_mm == pytest.approx(1.5 * map_.width, abs=0.4 * map_.width)


@pytest.mark.parametrize("seed", [1, 2])
def test_low_broad_blobs_dont_hide_a_layer(seed: int) -> None:
    """Their slopes aren't the scatter of sound ink."""
    found, _ = _with_blobs(profiled(seed, "solid"), (2, 6, 10), 0.6, 5.0)
    assert found.seen_share > 0.8
    assert found.blobs


# Rows that a height map lacks, by an earlier map of the same place.

# Ink on ground that sank is judged by its rise over that.


# Height maps of which one end lies moved against the other.


def _surface(
    kind: Kind, seed: int, lost: slice | None, axis: int = 0, bare: bool = False
) -> tuple[Surface, ExpectedLines]:
    map_ = profiled(seed, kind, ((0, 0.0, 20.0),) if bare else ())
    lines = expected(map_)
    heights: FloatImage = map_.heights
    if lost is not None:
        heights = np.delete(heights, lost, axis=axis)
    height_map = HeightMap(heights, (map_.px, map_.px))
    return surface_of(height_map, map_.to_map, map_.middle_z, map_.thickness, lines), lines


def _told(
    kind: Kind, seed: int, lost: slice | None, axis: int = 0, bare: bool = False
) -> str | None:
    surface, lines = _surface(kind, seed, lost, axis, bare)
    return find_better_orientation(surface.picture, surface.frame, lines)


@pytest.mark.parametrize("kind", ["plate", "lattice", "solid"])
def test_a_sound_map_is_of_one_piece(kind: Kind) -> None:
    assert _told(kind, 4, None) is None


@pytest.mark.parametrize("seed", [4, 5])
def test_a_map_that_lacks_its_middle_rows_is_told(seed: int) -> None:
    """Lines that run across the lost rows show it; those along them only end early."""
    middle = len(profiled(seed, "plate").heights) // 2
    lost = slice(middle, middle + 10)  # less than a pitch
    told = [one for axis in (0, 1) if (one := _told("plate", seed, lost, axis))]
    assert told
    assert all(one.endswith(IN_PART) for one in told)


# Missing ink over older ink of its own kind, told by its height.


def _lines(layer: SolidLayer) -> ExpectedLines:
    """The layer over one of the same outline that is written across."""
    n = len(layer.start)
    start, end = (np.hstack([p, np.full((n, 1), 0.3)]) for p in (layer.start, layer.end))
    below = (0.0, 0.0, layer.thickness)
    number = np.repeat([0, 1], n)
    ends = (np.vstack([p[:, [1, 0, 2]] - below, p]) for p in (start, end))
    return lines_of(*ends, layer.width, stroke=number, fresh=number == 1)


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
    assert (gap.from_mm, gap.to_mm) == pytest.approx(bare, abs=0.6 * sound.width)  # it droops
