import numpy as np
import pytest

from benchmarks.checkers import layer_painter as painter
from registration.inspection import Unseen, see_layer
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
