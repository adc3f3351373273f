import numpy as np
import pytest

from benchmarks.checkers import layer_painter as painter
from registration.inspection import Unseen, see_layer
from registration.inspection.ink.presence import window_noise
from registration.inspection.pictures.light import flattened
from registration.inspection.pictures.shadow_bars import bar_directions, bar_light
from registration.inspection.ways import Ways, lay_ways
from tests.registration.inspection import layer_troubles as trouble
from tests.registration.inspection.painted import Scene, expected
from tests.slower import first_of, first_rows


@pytest.mark.parametrize(
    ("layout", "kind"), first_rows([("meander", "absorbing"), ("filled", "opaque")])
)
def test_lines_in_a_soft_shadow_are_judged_as_before(layout: str, kind: str) -> None:
    scene = Scene(3, kind, layout, contrast=0.2)
    planted = ((0, 1.0, 1.3), (0, 4.0, 4.4))
    bars = [trouble.Bar((12.0, 22.0), 0.4, 0.5, 0.6, 0.2)]
    painted = scene.paint(planted, overlay=trouble.Troubles(bars=bars))
    findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
    assert findings.seen_share > 0.95
    assert [(g.from_mm, g.to_mm) for g in findings.gaps] == [
        pytest.approx((begin, end), abs=0.1) for _, begin, end in planted
    ]


def test_crossings_of_translucent_lines_do_not_spoil_the_rest() -> None:
    rng = np.random.default_rng(5)
    plan = trouble.grid(5.0, 0.3, rng)
    look = painter.Look("absorbing", ink=(80, 60, 50), light=0.2)
    gaps = trouble.bare(plan, painter.plant_gaps(plan, (0.25, 0.3) * 8, rng))[:2]
    ink = painter.lay(plan, rng, gaps=gaps)
    extra = trouble.piled(ink, gaps, (0.0, 0.0), 5.0, 0.0125, look)
    painted = painter.paint(
        plan, ink, gaps, 5.0, 20.0, look, rng, overlay=trouble.Troubles(extra=extra)
    )
    findings = see_layer(painted.picture, painted.frame, expected(plan))
    assert gaps
    assert findings.seen_share > 0.9
    assert sorted(g.stroke for g in findings.gaps) == sorted(s for s, _, _ in gaps)


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
    seen_mm = stations.length_mm[stations.seen].sum()  # by whole stations
    assert findings.seen_share == pytest.approx(seen_mm / stations.length_mm.sum(), abs=0.05)


def test_light_in_a_filled_area_follows_the_shadow_beside_it() -> None:
    y, x = np.mgrid[0:200, 0:200] / 20.0  # mm
    ink = (np.abs(x - 5) < 2) & (np.abs(y - 5) < 2)
    free = ~((np.abs(x - 5) < 2.3) & (np.abs(y - 5) < 2.3))
    across = 0.8 * (x - 5) + 0.6 * (y - 5)
    out = np.clip((np.abs(across) - 0.4) / 0.5, 0, 1)
    shade = -0.2 * 0.5 * (1 + np.cos(np.pi * out))
    noise = np.random.default_rng(6).normal(0, 0.01, ink.shape)
    picture = (0.3 * ink + shade + noise).astype(np.float32)[:, :, None]
    flat = flattened(picture, free.astype(np.uint8), ink.astype(np.uint8), 20.0)[:, :, 0]
    assert np.std(flat[ink]) < 0.025
    assert np.std(flat[free]) < 0.025
    assert np.mean(flat[ink]) - np.mean(flat[free]) == pytest.approx(0.3, abs=0.03)


def _cells() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(40.0), np.arange(30.0))
    at = np.column_stack([x.ravel(), y.ravel()])
    return at, np.random.default_rng(1).normal(0, 0.01, (len(at), 3))


def test_light_of_crossing_bars_is_recovered() -> None:
    at, rest = _cells()
    true = np.zeros(len(at))
    for angle, middle in ((0.3, 20.0), (1.7, 8.0)):
        across = at @ (np.cos(angle), np.sin(angle)) - middle
        true -= 0.2 * np.exp(-((across / 3.0) ** 2))
    weight = (at[:, 0] % 10 > 3).astype(float)  # lines hide the rest
    rest = rest + true[:, None]
    found = bar_directions(rest, weight, at, 1.5)
    light = bar_light(rest, weight, at, 1.5, found)
    light -= np.median(light - true[:, None])
    assert np.abs(light - true[:, None]).mean() < 0.015
    assert np.abs(light - true[:, None]).max() < 0.08


def test_spots_and_short_streaks_are_not_taken_for_shadows() -> None:
    at, rest = _cells()
    weight = np.ones(len(at))
    streak = (np.abs(at[:, 0] - 12) < 1.5) & (at[:, 1] < 12)
    spot = np.hypot(at[:, 0] - 30, at[:, 1] - 20) < 4
    spoilt = rest - 0.3 * (streak | spot)[:, None]
    found = bar_directions(spoilt, weight, at, 1.5)  # across both, by chance in line
    assert np.abs(bar_light(spoilt, weight, at, 1.5, found)).max() < 0.03
    assert bar_directions(rest, weight, at, 1.5) == []
    assert bar_directions(rest, 0.0 * weight, at, 1.5) == []


def test_places_over_each_other_are_crossed() -> None:
    plan = trouble.grid(5.0, 0.3, np.random.default_rng(2))
    ways = lay_ways(expected(plan), 0.05)
    far = np.full(len(ways), np.inf)
    for stroke in np.unique(ways.stroke):
        other = ways.point[ways.stroke != stroke, :2]
        for k in np.flatnonzero(ways.stroke == stroke):
            far[k] = np.hypot(*(other - ways.point[k, :2]).T).min()
    straight = ~np.isin(ways.stroke, [s for s in ways.stroke if (plan.stroke == s).sum() > 1])
    assert np.array_equal(ways.crossed[straight], (far < 0.85 * 0.3)[straight])
    assert 0.1 < ways.crossed.mean() < 0.9


def test_a_lines_own_sharp_corner_is_crossed_and_a_gentle_bend_is_not() -> None:
    assert _bent(np.pi / 2).crossed.any()
    assert not _bent(np.pi / 6).crossed.any()


def _bent(turn: float, arm: float = 2.0) -> Ways:
    start = np.array([[0.0, 0.0], [arm, 0.0]])
    end = np.array([[arm, 0.0], [arm + arm * np.cos(turn), arm * np.sin(turn)]])
    plan = painter.Plan(start, end, np.full(2, 0.4), np.zeros(2, dtype=int))
    return lay_ways(expected(plan), 0.05)


def test_heaped_ink_does_not_count_for_noise_unless_it_scatters_evenly() -> None:
    rng = np.random.default_rng(3)
    ways = _bent(0.1, 10.0)
    heaped = rng.normal(1.0, 0.03, len(ways))
    heaped[50:70] = 3.0
    good = np.ones(len(ways), dtype=bool)
    noise, even = (
        window_noise(heaped, good, ways, None, 0.2, known=False, even=flag)
        for flag in (False, True)
    )
    assert noise is not None
    assert even is not None
    assert noise.spread[1] < 0.1 < 0.3 < even.spread[1]
