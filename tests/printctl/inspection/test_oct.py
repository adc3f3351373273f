"""Layers and filaments seen in OCT volumes: touching lines, slopes, rims, turned volumes."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from printctl.inspection import (
    ExpectedLines,
    HeightFrame,
    LayerFindings,
    Unseen,
    VisibleLines,
    filament_map,
    find_better_orientation,
    height_map,
    see_layer,
)
from printctl.inspection.values import FloatImage
from registration.scan import Scan
from tests.printctl.inspection.oct_volumes import Piece, area, painted
from tests.printctl.inspection.painted import (
    Scene,
    expected,
    from_above,
    lines_of,
    mesh_of,
    scan_of,
)

SEEN = 0.85
"""Half a width at either end of a line, where ink recedes or bulges, isn't judged by itself."""
SINGLE = [(0, 0.0, 0.0, 3.0, 0.0), (0, 0.0, 1.5, 3.0, 1.5), (0, 0.0, 3.0, 3.0, 3.0)]


def test_a_single_line_in_a_wide_field_is_seen_and_its_gap_found() -> None:
    (piece, *_) = SINGLE
    found = painted([piece], [(0, 1.0, 1.6)], margin_mm=4.0).look()
    assert found.seen_share > SEEN
    (gap,) = found.gaps
    assert (gap.from_mm, gap.to_mm) == pytest.approx((1.0, 1.6), abs=0.06)


@pytest.mark.parametrize("missing", [None, 0, 1])
def test_a_missing_stroke_among_single_lines_is_found(missing: int | None) -> None:
    found = painted(SINGLE, [] if missing is None else [(missing, -1.0, 9.0)]).look()
    assert found.seen_share > SEEN
    assert [gap.stroke for gap in found.gaps] == ([] if missing is None else [missing])


WALL = [(k, 0.0, m, 4.0, m) for k in range(3) for m in (0.15, 0.45, 0.75)]


@pytest.mark.parametrize(
    ("pieces", "inner"),
    [
        (area(1, 10), 4),
        pytest.param(area(3, 10), 24, marks=pytest.mark.slow),
        (WALL, 7),
        pytest.param(area(2, 4, 0.8), 5, marks=pytest.mark.slow),
        (area(3, 4, 0.8), 9),
    ],
    ids=["area", "areas", "wall", "two crossing", "lattice"],
)
def test_a_missing_inner_line_is_found(pieces: list[Piece], inner: int) -> None:
    sound = painted(pieces).look()
    assert sound.gaps == ()
    assert sound.seen_share > 0.7
    gaps = painted(pieces, [(inner, -1.0, 9.0)]).look().gaps
    assert {gap.stroke for gap in gaps} == {inner}
    _, x0, y0, x1, y1 = pieces[inner]
    # Not told over older ink are ends, a width each.
    assert sum(gap.length_mm for gap in gaps) > np.hypot(x1 - x0, y1 - y0) - 0.8


STAIRS = [(0, 0.0, 0.3 * k, 3.0 - 0.25 * k, 0.3 * k) for k in range(10)]


@pytest.mark.parametrize(
    ("turn", "said"),
    [
        (lambda v: v, None),
        (lambda v: v[:, ::-1, ::-1], "turned by 180°"),
        (lambda v: v[:, :, ::-1], "mirrored along x"),
        (lambda v: v[:, ::-1], "mirrored along y"),
        (lambda v: np.rot90(v, 3, (1, 2)), "turned by 90°"),
    ],
)  # fmt: skip
def test_a_turned_or_mirrored_volume_is_told(turn, said) -> None:  # type: ignore[no-untyped-def]
    volume = painted(STAIRS, [(3, 1.0, 1.6)])
    turned = replace(volume, voxels=np.ascontiguousarray(turn(volume.voxels)))
    picture, frame = turned.picture()
    assert find_better_orientation(picture, frame, volume.lines) == said


# Constant A-scans and picture blocks hold no measurement: they aren't seen, and are no gaps.

LATTICE = area(3, 4, 0.8)


@pytest.mark.parametrize("value", [0, 200])
@pytest.mark.parametrize(("pieces", "gap"), [(SINGLE, (0, 1.0, 1.6)), (LATTICE, (9, 1.0, 1.7))])
def test_constant_ascans_are_not_seen_and_a_gap_beside_them_is_found(pieces, gap, value):
    volume = painted(pieces, [gap])
    voxels = volume.voxels.copy()
    voxels[:, :, voxels.shape[2] * 3 // 5 : voxels.shape[2] * 3 // 5 + 15] = value
    voxels[:, voxels.shape[1] // 2 + 8 :, :] = value
    found = replace(volume, voxels=voxels).look()
    assert [one.stroke for one in found.gaps] == [gap[0]]
    assert (found.gaps[0].from_mm, found.gaps[0].to_mm) == pytest.approx(gap[1:], abs=0.1)
    assert Unseen.HIDDEN in found.stations.why


def test_a_volume_of_which_half_is_constant_shows_no_gap():
    volume = painted(area(1, 10))
    voxels = volume.voxels.copy()
    voxels[:, voxels.shape[1] // 2 :] = 0
    found = replace(volume, voxels=voxels).look()
    assert found.gaps == ()
    assert 0.3 < found.seen_share < 0.7


@pytest.mark.parametrize("value", [0, 128, None])
def test_a_lost_block_of_a_picture_is_not_seen(value):
    layer = Scene(3, layout="meander").paint(((0, 1.0, 1.4),))
    lines, picture = expected(layer.plan), layer.picture.copy()
    middle = 0.5 * (lines.start + lines.end)
    way = np.cumsum(np.linalg.norm(lines.end - lines.start, axis=1))
    x, y = layer.frame.to_pixels(middle[np.argmin(np.abs(way - 3.0))][None])[0].astype(int)
    block = np.s_[y - 16 : y + 16, x - 20 : x + 20]
    picture[block] = picture[2, 2] if value is None else value
    picture[y + 30] = picture[2, 2]  # a dead row
    found = see_layer(picture, layer.frame, lines)
    assert [(g.from_mm, g.to_mm) for g in found.gaps] == [pytest.approx((1.0, 1.4), abs=0.1)]
    assert (found.stations.why == Unseen.HIDDEN).sum() >= 2  # a station that shows a part is seen


# Filaments on a slope in a bath, each judged at its own depth.


SLOPE_VOXEL = (0.015, 0.03, 0.03)
SLOPE_SHAPE = (240, 150, 240)
SLOPE_WIDE = 0.5
START = np.array([[1.0, 1.2, 0.4], [1.0, 3.2, 0.8]])
END = np.array([[6.0, 1.2, 3.0], [6.0, 3.2, 0.8]])


def _sloping(bare: tuple[float, float] | None, own: bool = True) -> LayerFindings:
    """Findings of clear filaments in a scattering bath, one leading up, one level."""
    rng = np.random.default_rng(6)
    z, y, x = mesh_of(SLOPE_VOXEL, SLOPE_SHAPE)
    depth = 3.4
    ink = np.zeros(SLOPE_SHAPE, dtype=np.bool_)
    for number, (start, end) in enumerate(zip(START, END, strict=True)):
        length = float(np.linalg.norm(end - start))
        a, b, c = (end - start) / length
        along = (x - start[0]) * a + (y - start[1]) * b + (depth - z - start[2]) * c
        far = (x - start[0]) ** 2 + (y - start[1]) ** 2 + (depth - z - start[2]) ** 2 - along**2
        whole = (along > 0) & (along < length) & (far < (SLOPE_WIDE / 2) ** 2)
        if number == 0 and bare is not None:
            whole &= (along < bare[0]) | (along > bare[1])
        ink |= whole
    light = np.where(ink, 0.08, 1.0) * np.exp(-0.5 * z)
    scan = scan_of(4000.0 * light * rng.gamma(3.0, 1 / 3.0, SLOPE_SHAPE), SLOPE_VOXEL)
    lines = lines_of(START, END, SLOPE_WIDE)
    picture, frame = height_map(scan, from_above(depth), 1.7, 3.1, lines)
    picture = filament_map(scan, frame, lines) if own else picture[:, :, :1]
    return see_layer(picture, frame, lines)


def test_a_sound_filament_that_leads_up_is_seen() -> None:
    found = _sloping(None)
    assert found.gaps == ()
    assert found.seen_share > 0.9


@pytest.mark.parametrize("bare", [(2.0, 3.0), (0.0, 2.5)])
def test_what_is_missing_of_it_is_found(bare: tuple[float, float]) -> None:
    (gap,) = _sloping(bare).gaps
    assert gap.stroke == 0
    assert (gap.from_mm, gap.to_mm) == pytest.approx(bare, abs=0.3)


# Older filaments that lie clearly below the judged one hide nothing of it.


CROSS_VOXEL = (0.015, 0.03, 0.03)
CROSS_SHAPE = (120, 120, 170)
CROSS_WIDE, CROSS_DEPTH, UPPER = 0.4, 1.7, 1.2


def _crossing_lines(lower: float) -> ExpectedLines:
    """A fresh line along x, and an older one that crosses it ``lower`` mm below."""
    start = [[2.5, 0.6, UPPER - lower], [0.6, 1.8, UPPER]]
    end = [[2.5, 3.0, UPPER - lower], [4.4, 1.8, UPPER]]
    return lines_of(start, end, CROSS_WIDE, fresh=[False, True])


def _crossing(lower: float, bare: tuple[float, float] | None) -> LayerFindings:
    rng, lines = np.random.default_rng(3), _crossing_lines(lower)
    z, y, x = mesh_of(CROSS_VOXEL, CROSS_SHAPE)
    up = CROSS_DEPTH - z
    older = ((x - 2.5) ** 2 + (up - UPPER + lower) ** 2 < (CROSS_WIDE / 2) ** 2) & (
        abs(y - 1.8) < 1.2
    )
    fresh = ((y - 1.8) ** 2 + (up - UPPER) ** 2 < (CROSS_WIDE / 2) ** 2) & (abs(x - 2.5) < 1.9)
    if bare is not None:
        fresh &= ~((x > 0.6 + bare[0]) & (x < 0.6 + bare[1]))
    light = np.where(older | fresh, 4.0, 1.0) * np.exp(-0.5 * z)
    scan = scan_of(2000.0 * light * rng.gamma(3.0, 1 / 3.0, CROSS_SHAPE), CROSS_VOXEL)
    _, frame = height_map(scan, from_above(CROSS_DEPTH), UPPER, CROSS_WIDE, lines)
    shown = VisibleLines.of(lines, frame, depth_down=True)
    return shown.with_given_rows(see_layer(filament_map(scan, frame, lines), frame, shown.lines))


def test_a_gap_above_older_ink_is_found() -> None:
    """It passed silently: older ink was taken to hide it, at whatever depth."""
    found = _crossing(0.8, (1.65, 2.15))
    (gap,) = found.gaps
    assert (gap.from_mm, gap.to_mm) == pytest.approx((1.65, 2.15), abs=0.1)
    assert (found.stations.piece == 1).all()


@pytest.mark.parametrize("lower", [0.3, 0.8])
def test_sound_ink_above_older_ink_is_seen(lower: float) -> None:
    """At a crossing that nothing else tells of one station of 15 isn't seen; nor are both ends."""
    found = _crossing(lower, None)
    assert found.gaps == ()
    assert found.seen_share > 0.75


# Clear filaments in a scattering bath, scanned with axes mixed up.


BENT_VOXEL = (0.02, 0.03, 0.03)
BENT_SHAPE = (90, 150, 240)
BENT_WIDE = 0.45
Turn = Callable[[NDArray[Any]], NDArray[Any]]
BENT = np.array([[1.2, 1.0, 0.9], [3.2, 1.2, 0.9], [4.6, 2.8, 0.9]])


def _bent(points: NDArray[Any], turn: Turn) -> tuple[FloatImage, HeightFrame, ExpectedLines]:
    """Map of a slab; frame and lines of one filament."""
    rng = np.random.default_rng(8)
    z, y, x = mesh_of(BENT_VOXEL, BENT_SHAPE)
    ink = np.zeros(BENT_SHAPE, dtype=np.bool_)
    for start, end in pairwise(points):
        way = end - start
        off = (x - start[0], y - start[1], 1.8 - z - start[2])
        share = sum(a * b for a, b in zip(off, way, strict=True)) / float(way @ way)
        share = np.clip(share, 0.0, 1.0)
        ink |= (
            sum((a - share * b) ** 2 for a, b in zip(off, way, strict=True)) < (BENT_WIDE / 2) ** 2
        )
    light = np.where(ink, 0.08, 1.0) * np.exp(-0.5 * z)
    voxels = 4000.0 * light * rng.gamma(3.0, 1 / 3.0, BENT_SHAPE)
    scan = scan_of(np.ascontiguousarray(turn(voxels.astype(np.uint16))), BENT_VOXEL)
    lines = lines_of(points[:-1], points[1:], BENT_WIDE, stroke=np.zeros(len(points) - 1, np.int64))
    picture, frame = height_map(scan, from_above(1.8), 0.9, BENT_WIDE, lines)
    return picture, frame, lines


@pytest.mark.parametrize(
    ("turn", "said"),
    [
        (lambda v: v, None),
        (lambda v: v[:, ::-1, ::-1], "turned by 180°"),
        (lambda v: v[:, :, ::-1], "mirrored along x"),
        (lambda v: v[:, ::-1], "mirrored along y"),
        (lambda v: v.transpose(0, 2, 1), "with x and y exchanged"),
    ],
)
def test_ink_darker_than_the_bath_is_told_when_turned(turn: Turn, said: str | None) -> None:
    """It correlates with its lines below zero, and any turn was as good as any other."""
    picture, frame, lines = _bent(BENT, turn)
    assert find_better_orientation(picture, frame, lines) == said


# Ink that an OCT shows by its rim, as clear hydrogel.


VOXEL = (0.012, 0.025, 0.025)
SHAPE = (110, 130, 220)
DEPTH = 1.3
Pieces = list[tuple[tuple[float, float, float], tuple[float, float, float]]]


def _scanned(
    pieces: Pieces,
    wide: float,
    actual: float,
    level: float,
    rim: tuple[float, float],
    bare: dict[int, tuple[float, float]] | None = None,
) -> tuple[Scan, NDArray[np.float64], ExpectedLines]:
    """Volume of straight filaments: ink's ``level``, its rim's level and thickness."""
    rng = np.random.default_rng(4)
    z, y, x = mesh_of(VOXEL, SHAPE)
    away = np.full(SHAPE, 9.0, dtype=np.float32)
    for number, piece in enumerate(pieces):
        start, end = np.array(piece)
        length = float(np.linalg.norm(end - start))
        way, off = (end - start) / length, (x - start[0], y - start[1], DEPTH - z - start[2])
        along = sum(a * b for a, b in zip(off, way, strict=True))
        inner = np.clip(along, 0.0, length)
        if bare and number in bare:
            low, high = bare[number]
            before, after = np.minimum(inner, low), np.maximum(inner, high)
            inner = np.where(along < 0.5 * (low + high), before, after)
        far = sum((a - inner * b) ** 2 for a, b in zip(off, way, strict=True))
        away = np.minimum(away, np.sqrt(far) - actual / 2).astype(np.float32)
    light = np.where(away < 0, np.where(away > -rim[1], rim[0], level), 1.0)
    shade = np.cumsum(np.where(away < 0, 1.2, 0.4) * VOXEL[0], axis=0)
    light = np.stack([cv2.GaussianBlur(one, (0, 0), 0.7) for one in light * np.exp(-2.0 * shade)])
    scan = scan_of(4000.0 * light * rng.gamma(2.0, 0.5, SHAPE), VOXEL)
    ends = np.array(pieces, dtype=np.float64)
    return scan, from_above(DEPTH), lines_of(ends[:, 0], ends[:, 1], wide)


def _look(*case: object, **more: object) -> LayerFindings:
    scan, to_scan, lines = _scanned(*case, **more)  # type: ignore[arg-type]
    frame = _frame(scan, to_scan, lines)
    return see_layer(filament_map(scan, frame, lines), frame, lines)


def _frame(scan: Scan, to_scan: NDArray[np.float64], lines: ExpectedLines) -> HeightFrame:
    return height_map(scan, to_scan, 0.7, 0.6, lines)[1]


LONE: Pieces = [((0.7, 1.6, 0.7), (4.8, 1.7, 0.7))]
ROWS: Pieces = [((0.7, 1.0 + 0.45 * k, 0.7), (4.8, 1.0 + 0.45 * k, 0.7)) for k in range(4)]


@pytest.mark.parametrize("actual", [0.42, 0.5, 0.54])
@pytest.mark.parametrize(("level", "bright"), [(0.9, 3.5), (1.0, 5.0), (0.5, 2.5)])
def test_width_is_told_from_rim_to_rim(actual: float, level: float, bright: float) -> None:
    """Of a dark middle and bright rims the middle alone was told: 53 % of the width."""
    found = _look(LONE, 0.5, actual, level, (bright, 0.045))
    assert found.gaps == ()
    assert found.width_ratio == pytest.approx(actual / 0.5, abs=0.25)
    assert abs(found.width_ratio - actual / 0.5) < 2.0 * found.u_width_ratio


def test_thin_filaments_side_by_side_that_show_by_their_rims_are_seen() -> None:
    """Rims that lie near others told nothing; a mean over the whole height shows the middle."""
    found = _look(ROWS, 0.36, 0.36, 1.0, (5.0, 0.05))
    assert found.seen_share > SEEN
    assert found.gaps == ()
    gaps = _look(ROWS, 0.36, 0.36, 1.0, (5.0, 0.05), bare={1: (1.5, 2.5)}).gaps
    assert [gap.stroke for gap in gaps] == [1]
    assert gaps[0].length_mm == pytest.approx(0.64, abs=0.2)  # from tip to tip of round ends


def test_a_vessel_that_shows_by_its_rim_is_not_told_as_turned() -> None:
    """At its own depth it hardly fits its filled line, and turned by chance as well."""
    scan, to_scan, lines = _scanned([((0.8, 0.7, 0.7), (1.3, 2.6, 0.7))], 0.68, 0.68, 0.94,
                                    (5.8, 0.04))  # fmt: skip
    picture, frame = height_map(scan, to_scan, 0.7, 0.7, lines)
    assert find_better_orientation(picture, frame, lines, scan, in_parts=False) is None
    other = scan_of(scan.volume[:, ::-1, ::-1], VOXEL)
    picture, frame = height_map(other, to_scan, 0.7, 0.7, lines)
    assert find_better_orientation(picture, frame, lines, other, in_parts=False) == "turned by 180°"
