"""Width findings that light from the side may cause are doubted; blurred edges aren't strange."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from registration.inspection.lit_from_the_side import lit_widths
from registration.inspection.values import Shift
from registration.inspection.widths.widths import Widths


@pytest.mark.parametrize(
    ("ratio", "shift_mm", "slant", "doubted"),
    [
        (0.7, (0.0, 0.04), 0.08, True),
        (0.7, (0.4, 0.0), 0.08, False),  # along the lines, where nothing tells it
        (1.3, (0.0, 0.04), 0.08, False),  # shade makes no line thicker
        (1.3, (0.0, 0.04), 0.16, True),  # a shadow beside it looks like its ink
        (1.3, (0.4, 0.0), 0.16, False),
    ],
)
def test_widths_are_doubted_where_light_from_the_side_could_have_changed_them(
    ratio, shift_mm, slant, doubted
) -> None:
    m = 20
    width = np.full(m, 0.25)
    widths = Widths(ratio * width, 0.01 * width, 0 * width, 0.02, 0.003)
    ways = SimpleNamespace(width=width, normal=np.tile([0.0, 1.0], (m, 1)))
    bath = SimpleNamespace(template=SimpleNamespace(slant=slant))
    look = SimpleNamespace(
        widths=widths, ways=ways, bath=bath, group=SimpleNamespace(first=np.arange(m))
    )
    found = lit_widths(look, Shift(*shift_mm, np.eye(2)))
    assert (found.common > 0.1) == doubted
