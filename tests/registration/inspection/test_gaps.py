import numpy as np
import pytest

from benchmarks.checkers import layer_painter as painter
from registration.inspection import Unseen, see_layer
from tests.registration.inspection.painted import Scene, expected
from tests.slower import first_of


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
        assert gap.p_value < 1e-6
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
    assert (findings.stations.why == Unseen.FAINT).all()


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
