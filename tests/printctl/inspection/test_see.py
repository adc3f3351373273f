"""Layers seen in painted pictures: widths, gaps, blobs, lumens, what spoils pictures, ridges."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers import layer_painter as painter
from printctl.inspection import (
    LayerFindings,
    Lumen,
    Unseen,
    annotated,
    height_map,
    see_layer,
)
from printctl.observe.deciding import GapTest
from registration.errors import PictureError
from tests.printctl.inspection import layer_troubles as trouble
from tests.printctl.inspection.layer_volume import VOXEL, paint_volume
from tests.printctl.inspection.painted import Scene, both, expected, lines_of, scan_of
from tests.slower import first_of, first_rows


@pytest.mark.parametrize("kind", first_of(["absorbing", "opaque"]))
def test_widths_ratio_and_shift_lie_in_their_intervals(kind: str) -> None:
    painted = Scene(21, kind).paint(ratio=0.85, shift=(0.05, -0.08))
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    stations = findings.stations
    known = np.isfinite(stations.width_mm)
    true = np.empty(known.sum())
    for place, k in enumerate(np.flatnonzero(known)):
        own = painted.stroke == stations.stroke[k]
        true[place] = np.interp(stations.along_mm[k], painted.along[own], painted.laid[own])
    z = (stations.width_mm[known] - true) / stations.u_width_mm[known]
    assert known.mean() > 0.5
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert findings.width_ratio == pytest.approx(0.85, abs=2 * findings.u_width_ratio)
    assert findings.u_width_ratio < 0.12  # a parabola's and an ellipse's way of light look alike
    u_x, u_y = findings.shift.u_mm
    assert findings.shift.dx_mm == pytest.approx(0.05, abs=3 * u_x + 0.002)
    assert findings.shift.dy_mm == pytest.approx(-0.08, abs=3 * u_y + 0.002)
    assert max(u_x, u_y) < 0.02


def test_a_thin_stroke_is_measured_against_the_others() -> None:
    """How wide both are hangs on the shape of ink, unknown; how they compare doesn't."""
    scene = Scene(22)
    plan = scene.plan()
    longest = int(plan.stroke.max())
    thin = replace_width(plan, longest, 0.6)
    rng = np.random.default_rng(1)
    look = painter.random_look("opaque", rng, 0.4)
    painted = painter.paint(thin, painter.lay(thin, rng), [], 4.0, 20.0, look, rng)
    stations = see_layer(painted.picture, painted.frame, expected(plan)).stations
    ratio = stations.width_mm / stations.expected_mm
    u_ratio = stations.u_width_mm / stations.expected_mm
    own = stations.stroke == longest
    assert np.nanmedian(ratio[own]) / np.nanmedian(ratio[~own]) == pytest.approx(0.6, abs=0.06)
    assert abs(np.nanmedian(ratio[own]) - 0.6) < 2.0 * np.nanmedian(u_ratio[own])


def replace_width(plan: painter.Plan, stroke: int, times: float) -> painter.Plan:
    return replace(plan, width=np.where(plan.stroke == stroke, times * plan.width, plan.width))


def test_a_blob_is_found_where_no_ink_should_be() -> None:
    scene = Scene(23, layout="meander", contrast=0.5)
    corner = scene.plan().start.min(axis=0) + (-0.2, -0.45)
    painted = scene.paint(blobs=[(*corner, 0.3)])
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    assert len(findings.blobs) == 1
    assert np.hypot(*(np.array(findings.blobs[0].at_mm) - corner)) < 0.15


@pytest.mark.parametrize(("ratio", "share"), first_rows([(1.35, 0.72), (1.0, 1.0)]))
def test_a_lumen_between_lines_is_measured(ratio: float, share: float) -> None:
    rows = np.array([0.0, 0.75])  # two lines of 0.35 mm, 0.4 mm apart
    start = np.column_stack([np.full(2, 10.5), 21.6 + rows])
    plan = painter.Plan(start, start + (3.0, 0.0), np.full(2, 0.35), np.arange(2))
    rng = np.random.default_rng(4)
    look = painter.random_look("opaque", rng, 0.4)
    painted = painter.paint(plan, painter.lay(plan, rng, ratio=ratio), [], 4.0, 20.0, look, rng)
    middle = np.array([[10.9, 21.975, 0.3], [13.1, 21.975, 0.3]])
    lumen = Lumen.capsule("a", middle[0], middle[1], 0.4)
    seen = see_layer(painted.picture, painted.frame, expected(plan), lumens=[lumen]).lumens[0]
    assert seen.seen
    assert seen.width_mm / 0.4 == pytest.approx(share, abs=2 * seen.u_width_mm / 0.4)
    assert (seen.p_value < 0.01) == (share < 1)


def test_a_closed_lumen_is_closed() -> None:
    scene = Scene(24, contrast=0.5)
    middle = np.array([12.0, 22.0, 0.3])
    painted = scene.paint(blobs=[(12.0, 22.0, 0.5)])
    lumen = Lumen.capsule("hole", middle, middle, 0.4)
    lines = expected(painted.plan)
    closed = see_layer(painted.picture, painted.frame, lines, lumens=[lumen]).lumens[0]
    assert closed.seen
    assert closed.width_mm < 0.05
    assert closed.open_share < 0.05


def test_lines_over_older_ink_are_not_seen_without_a_sign() -> None:
    scene = Scene(25, layout="meander")
    older = scene.plan()
    painted = scene.paint()
    lines = both(expected(older, fresh=False), expected(older, first_stroke=100))
    findings = see_layer(painted.picture, painted.frame, lines)
    assert findings.seen_share == 0.0
    assert (findings.stations.why == Unseen.OLD_INK).all()


@pytest.mark.parametrize("colour", first_of([0, 1]))
def test_the_picture_before_takes_texture_away(colour: int) -> None:
    scene = Scene((26, 24)[colour], contrast=0.25)
    painted, empty = scene.paint(((1, 1.0, 1.4),)), scene.paint(((-1, 0, 0),), ratio=1e-6)
    rough = np.random.default_rng(2).normal(0, 12, painted.picture.shape)
    now, before = (
        np.clip(one.picture + rough, 0, 255).astype(np.uint8) for one in (painted, empty)
    )
    lines = expected(painted.plan)
    plain = see_layer(now, painted.frame, lines)
    helped = see_layer(now, painted.frame, lines, before=before)
    assert helped.u_width_ratio < plain.u_width_ratio
    assert helped.shift.u_mm <= plain.shift.u_mm
    assert [gap.stroke for gap in helped.gaps] == [1]


def test_an_oct_volume_is_judged_by_its_height_map() -> None:
    rng = np.random.default_rng(3)
    plan = painter.plan_layer("waves", 3.0, 0.3, rng)
    planted = [(0, 1.0, 1.4)]
    shape = (100, 200, 200)
    volume, to_scan = paint_volume(plan, painter.lay(plan, rng, gaps=planted), planted, rng, shape)
    picture, frame = height_map(scan_of(volume, VOXEL), to_scan, 0.3, 0.25)
    findings = see_layer(picture, frame, expected(plan))
    assert [gap.stroke for gap in findings.gaps] == [0]
    assert findings.gaps[0].from_mm == pytest.approx(1.0, abs=0.08)
    assert findings.width_ratio == pytest.approx(1.0, abs=2 * findings.u_width_ratio)
    assert annotated(picture, frame, findings).shape[2] == 3


def test_the_overlay_shows_gaps_red_and_changes_nothing_else() -> None:
    painted = Scene(3).paint(((1, 1.0, 1.6),))
    before = painted.picture.copy()
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    drawn = annotated(painted.picture, painted.frame, findings)
    assert np.array_equal(before, painted.picture)
    red = (drawn[..., 2] > 200) & (drawn[..., 1] < 60) & (drawn[..., 0] < 60)
    assert red[300:].sum() > 50  # below the legend


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"width_mm": np.zeros(3)}, "above 0"),
        ({"fresh": np.zeros(3, dtype=bool)}, "none is of the layer"),
        ({"start": np.full((3, 3), np.nan)}, "NaN"),
        ({"line": np.zeros(2, dtype=np.int64)}, "line is an array"),
    ],
)
def test_bad_lines_are_refused(change: dict[str, np.ndarray], word: str) -> None:
    painted = Scene(30).paint()
    start = np.column_stack([np.full(3, 11.0), 21.0 + np.arange(3), np.zeros(3)])
    lines = lines_of(start, start + (1.0, 0, 0), 0.3)
    with pytest.raises(PictureError, match=word):
        see_layer(painted.picture, painted.frame, replace(lines, **change))


def test_a_picture_of_something_else_is_refused() -> None:
    painted = Scene(30).paint()
    lines = expected(painted.plan)
    away = replace(lines, start=lines.start + 500.0, end=lines.end + 500.0)
    with pytest.raises(PictureError, match="none of the layer's lines"):
        see_layer(painted.picture, painted.frame, away)
    with pytest.raises(PictureError, match="expected \\(rows, columns\\)"):
        see_layer(painted.picture[0], painted.frame, lines)


# Thin ink between lines that touch.

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
def test_two_fifths_of_the_flow_in_a_filled_layer_are_told(seed, kind, um_per_px):
    findings = seen(replace(FILLED, seed=seed, kind=kind, um_per_px=um_per_px), (FROM, TO, 0.4))
    stations = findings.stations
    along = stations.along_mm
    told = np.zeros(len(along), dtype=np.bool_)
    for one in (*findings.stretches, *findings.gaps):
        told |= (along > one.from_mm) & (along < one.to_mm)
    thin = (along > FROM + _END) & (along < TO - _END)
    near = (along > FROM - _END) & (along < TO + _END)
    assert told[thin].mean() > 0.8  # not all turns; 0.82 to 1.0
    assert not told[~near].any()
    assert all(one.kind == "thin" and 0.3 < one.ratio < 0.7 for one in findings.stretches)
    assert sum(one.to_mm - one.from_mm for one in findings.gaps) < 1.5
    assert stations.seen[~near].mean() > 0.85


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["opaque", "absorbing"])
def test_sound_filled_layers_show_no_thin_line_though_round_ink_has_valleys(seed, kind):
    findings = seen(replace(FILLED, seed=seed, kind=kind))
    assert not findings.stretches
    assert findings.coverage > 0.95
    assert findings.seen_share > 0.85


# Gaps.


@pytest.mark.parametrize("kind", ["opaque", "absorbing"])
@pytest.mark.parametrize("layout", first_of(["rings", "filled", "meander", "waves"], 2))
def test_planted_gaps_are_found_and_nothing_else(kind: str, layout: str) -> None:
    planted = ((0, 1.0, 1.25), (0, 2.2, 2.8)) if layout != "rings" else ((1, 1.0, 1.3),)
    painted = Scene(3, kind, layout).paint(planted)
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    assert [gap.stroke for gap in findings.gaps] == [stroke for stroke, _, _ in planted]
    for gap, (_, begin, end) in zip(findings.gaps, planted, strict=True):
        assert gap.from_mm == pytest.approx(begin, abs=0.08)
        assert gap.to_mm == pytest.approx(end, abs=0.08)
        assert gap.p_value < 1e-4
    assert not findings.blobs


@pytest.mark.parametrize("seed", first_of(range(8), 4))
def test_sound_layers_are_found_sound(seed: int) -> None:
    layout = painter.LAYOUTS[seed // 4 * 2 + seed % 2]
    painted = Scene(60 + seed, painter.KINDS[seed % 4], layout).paint()
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    assert not findings.gaps
    assert not findings.blobs
    assert not findings.stretches


def test_ink_without_contrast_is_not_seen() -> None:
    painted = Scene(9, contrast=0.0).paint(((1, 1.0, 2.0),))
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    assert findings.seen_share == 0.0
    assert not findings.gaps
    assert np.isnan(findings.width_ratio)
    assert np.isin(findings.stations.why, (Unseen.FAINT, Unseen.COVERED)).all()


def test_glare_bubbles_and_the_needle_are_not_gaps() -> None:
    scene = Scene(11, layout="meander", contrast=0.5)
    at = scene.plan().start[0] * 0.5 + scene.plan().end[0] * 0.5
    other = scene.plan().start[2] * 0.5 + scene.plan().end[2] * 0.5
    painted = scene.paint(glare=[(*at, 0.4)], bubbles=[(*other, 0.4)], needle=True)
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    assert not findings.gaps
    assert 0.3 < findings.seen_share < 0.95


@pytest.mark.parametrize("round_ends", [False, True])
@pytest.mark.parametrize("kind", first_of(["opaque", "absorbing"]))
def test_a_gap_is_as_long_as_its_line_is_bare(kind: str, round_ends: bool) -> None:
    planted = ((0, 1.0, 1.3), (0, 2.2, 2.8), (1, 0.8, 1.5))
    painted = Scene(3, kind, "waves", 0.5).paint(planted, round_ends=round_ends)
    found = see_layer(painted.picture, painted.frame, expected(painted.plan)).gaps
    assert [gap.stroke for gap in found] == [0, 0, 1]
    for gap, (_, begin, end) in zip(found, planted, strict=True):
        assert gap.u_mm < 0.025
        assert abs(gap.length_mm - (end - begin)) < 2.0 * gap.u_length_mm
        assert abs(gap.length_mm - (end - begin)) < 0.045


def test_a_gap_at_a_strokes_end_goes_to_its_end() -> None:
    scene = Scene(3, layout="waves", contrast=0.5)
    painted = scene.paint(((0, -1.0, 0.7),))
    gap = see_layer(painted.picture, painted.frame, expected(painted.plan)).gaps[0]
    assert gap.from_mm == pytest.approx(0.0, abs=1e-6)
    assert gap.to_mm == pytest.approx(0.7, abs=0.03)
    assert gap.start_mm == pytest.approx(tuple(scene.plan().start[0]), abs=0.05)


# Shadows and crumbs.


@pytest.mark.parametrize(
    ("layout", "kind"), first_rows([("meander", "absorbing"), ("filled", "opaque")])
)
def test_lines_in_a_soft_shadow_are_judged_as_before(layout: str, kind: str) -> None:
    scene = Scene(3, kind, layout, contrast=0.2)
    planted = ((0, 1.0, 1.3), (0, 4.0, 4.4))
    bars = [trouble.Bar((12.0, 22.0), 0.4, 0.5, 0.6, 0.2)]
    plain, painted = scene.paint(planted), scene.paint(planted, overlay=trouble.Troubles(bars=bars))
    lines = expected(painted.plan)
    before = see_layer(plain.picture, plain.frame, lines)
    findings = see_layer(painted.picture, painted.frame, lines)
    assert findings.seen_share > before.seen_share - 0.02
    assert [(g.from_mm, g.to_mm) for g in findings.gaps] == [
        pytest.approx((begin, end), abs=0.1) for _, begin, end in planted
    ]


@pytest.mark.parametrize("tint", first_of([0.8, 0.6, 1.0]))
def test_a_dark_crumb_on_a_light_line_is_no_gap(tint: float) -> None:
    rng = np.random.default_rng(8)
    plan = Scene(8, layout="waves", width=0.4).plan()
    ink = painter.lay(plan, rng, gaps=[(0, 2.6, 2.9)])
    at, _, along, _ = ink
    around = np.linspace(0, 2 * np.pi, 9)[:-1]
    middle = at[np.argmin(np.abs(along - 1.5))]
    corners = middle + 0.13 * np.column_stack([np.cos(around), np.sin(around)])
    crumb = trouble.Crumb(corners, np.full(3, tint))
    look = painter.Look("opaque", light=0.2)
    painted = painter.paint(
        plan, ink, [(0, 2.6, 2.9)], 4.0, 20.0, look, rng, overlay=trouble.Troubles(crumbs=[crumb])
    )
    findings = see_layer(painted.picture, painted.frame, expected(plan))
    assert [g.from_mm for g in findings.gaps] == [pytest.approx(2.6, abs=0.08)]
    station = int(np.argmin(np.hypot(*(findings.stations.at_mm - middle).T)))
    assert findings.stations.why[station] in (Unseen.UNCLEAR, Unseen.GLARE)
    stations = findings.stations
    seen_mm = stations.length_mm[stations.seen].sum()
    assert findings.seen_share == pytest.approx(seen_mm / stations.length_mm.sum())


# Ridges lit from the side.


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
