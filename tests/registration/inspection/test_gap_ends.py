import pytest

from registration.inspection import see_layer
from tests.registration.inspection.painted import Scene, expected
from tests.slower import first_of


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
