import numpy as np
import pytest

from design.geometry.surface import Surface
from registration.report import ReportError, ReportSurface

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
