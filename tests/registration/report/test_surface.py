import numpy as np
import pytest

from design.geometry.surface import Surface
from registration.report import ReportError, ReportSurface
from registration.report.surface import robust_limits

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("vertices", "faces", "scalar", "limits", "message"),
    [
        (CORNERS[:, :2], FACE, None, None, "vertices have shape"),
        (CORNERS, FACE[:0], None, None, "no faces"),
        (CORNERS * np.nan, FACE, None, None, "NaN or infinite"),
        (CORNERS, FACE + 1, None, None, "name vertices 1 to 3, but there are 3"),
        (CORNERS, FACE, np.zeros(2), None, "one number per vertex"),
        (CORNERS, FACE, np.zeros(3), (5.0, -5.0), "aren't ascending"),
    ],
)
def test_impossible_surfaces_are_refused(vertices, faces, scalar, limits, message) -> None:
    with pytest.raises(ReportError, match=message) as caught:
        ReportSurface("lumen", Surface(vertices, faces), scalar, "µm", limits)
    assert "'lumen'" in str(caught.value)


def test_limits_are_symmetric_where_the_sign_changes() -> None:
    low, high = robust_limits(np.append(np.linspace(-10, 30, 1001), np.nan))
    assert low == -high
    assert high == pytest.approx(29.6)


def test_limits_of_one_sign_and_of_nothing() -> None:
    assert robust_limits(np.linspace(2, 4, 101)) == pytest.approx((2.02, 3.98))
    assert robust_limits(np.full(5, 7.0)) == (6.5, 7.5)
    assert robust_limits(np.full(5, np.nan)) == (0.0, 1.0)


def test_given_limits_win() -> None:
    values = np.array([0.0, 1, 2])
    surface = ReportSurface("lumen", Surface(CORNERS, FACE), values, "µm", (-3.0, 4.0))
    assert surface.colour_limits() == (-3.0, 4.0)
