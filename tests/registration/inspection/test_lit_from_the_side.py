"""Width findings that light from the side may cause are doubted; blurred edges aren't strange."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from registration.inspection.ink.ink_image import BathNoise
from registration.inspection.ink.strange import strangeness
from registration.inspection.lit_from_the_side import honest_shift, lit_widths
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


@pytest.mark.parametrize(("along", "doubted"), [(1.3, False), (1.1, True)])
def test_lines_along_the_light_tell_a_shadow_from_too_much_ink(along: float, doubted: bool) -> None:
    """Sound dark ink was told to flow at 126 % ± 11 %: its shadow on glass counted as ink."""
    m = 40
    width, lies_along = np.full(m, 0.25), np.arange(m) % 2 == 0
    widths = Widths(np.where(lies_along, along, 1.3) * width, 0.01 * width, 0 * width, 0.02, 0.003)
    normal = np.where(lies_along[:, None], [1.0, 0.0], [0.0, 1.0])
    look = SimpleNamespace(
        widths=widths,
        ways=SimpleNamespace(width=width, normal=normal),
        bath=SimpleNamespace(template=SimpleNamespace(slant=0.0)),
        group=SimpleNamespace(first=np.arange(m)),
    )
    found = lit_widths(look, Shift(0.0, 0.03, np.eye(2)))
    assert (found.common > 0.08) == doubted


@pytest.mark.parametrize(("slant", "sure"), [(0.058, True), (0.1, False)])
def test_a_slope_of_the_light_makes_no_large_shift_unsure(slant: float, sure: bool) -> None:
    """A dish that had moved by 0.4 mm was told within tolerance: 0.40 mm, give or take 0.15."""
    bath = SimpleNamespace(template=SimpleNamespace(slant=slant), noise=object())
    look = SimpleNamespace(bath=bath, old=None, ways=SimpleNamespace(width=np.full(9, 0.25)))
    found = honest_shift(Shift(0.4, 0.0, np.zeros((2, 2))), look, 0.5)
    assert (found.u_mm[0] < 0.05) == sure


def test_a_blurred_edge_of_coloured_ink_is_not_strange_and_another_colour_is() -> None:
    bath = BathNoise(np.zeros(3), 1e-4 * np.eye(3))
    ink, share = np.array([-1.2, -0.9, -0.3]), np.linspace(0, 1, 41)
    edge = np.log1p(share[:, None] * np.expm1(ink))[None].astype(np.float32)
    assert strangeness(edge, bath, ink, is_log=True).max() < 1.0
    assert strangeness(edge, bath, ink, is_log=False).max() > 3.0
    thin = (share[:, None] * ink)[None].astype(np.float32)
    assert strangeness(thin, bath, ink, is_log=True).max() < 1.0
    other = np.full((1, 1, 3), -0.6, dtype=np.float32)
    assert strangeness(other, bath, ink, is_log=True).max() > 6.0
