"""Layers seen in OCT volumes: single lines, touching ones, lattices; cropped and turned volumes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.inspection import Unseen, better_turned, see_layer
from tests.registration.inspection.oct_volumes import Piece, area, painted
from tests.registration.inspection.painted import Scene, expected

SINGLE = [(0, 0.0, 0.0, 3.0, 0.0), (0, 0.0, 1.5, 3.0, 1.5), (0, 0.0, 3.0, 3.0, 3.0)]


def test_a_single_line_in_a_wide_field_is_seen_and_its_gap_found() -> None:
    (piece, *_) = SINGLE
    found = painted([piece], [(0, 1.0, 1.6)], margin_mm=4.0).look()
    assert found.seen_share > 0.95
    (gap,) = found.gaps
    assert (gap.from_mm, gap.to_mm) == pytest.approx((1.0, 1.6), abs=0.06)


@pytest.mark.parametrize("missing", [None, 0, 1])
def test_a_missing_stroke_among_single_lines_is_found(missing: int | None) -> None:
    found = painted(SINGLE, [] if missing is None else [(missing, -1.0, 9.0)]).look()
    assert found.seen_share > 0.95
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
    assert better_turned(picture, frame, volume.lines) == said


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
    assert (found.stations.why == Unseen.HIDDEN).sum() >= 4
