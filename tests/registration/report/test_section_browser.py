"""Section viewer of the report in Chromium: a click on a plot shows that section."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from registration.report import write_report_html
from registration.report.views import SectionStack, Views
from registration.report.views.stack import PIXELS

from .sample import block_surface, planar_network, sample_data
from .test_browser import CHROMIUM, acted

COUNT = 10


def two_vessels() -> dict[str, object]:
    """Two vessels of ten sections, the second with a stenosis that fails."""
    rows = []
    for vessel in (0, 1):
        diameter = np.full(COUNT, 500.0)
        diameter[3] -= 200.0 * vessel
        rows.append({
            "vessel": vessel, "kind": "channel", "designed_um": 500.0, "length_mm": 5.0,
            "measured_um": 490.0, "error_percent": -2.0, "open": True,
            "along_mm": [0.25 + 0.5 * k for k in range(COUNT)], "diameter_um": diameter.tolist(),
            "interval_95_um": [12.0] * COUNT, "designed_along_um": [500.0] * COUNT,
            "lower_um": [450.0] * COUNT, "upper_um": [550.0] * COUNT,
            "offset_along_um": [3.0] * COUNT, "ovality_along": [1.02] * COUNT,
            "decision_along": ["fail" if d < 450 else "pass" for d in diameter],
        })  # fmt: skip
    return {"vessels": rows, "findings": [], "judging": {"rule": "a rule", "tolerances": {}}}


def views(left_out: int = 0) -> Views:
    """Pictures of their sections; the last `left_out` have none."""
    n = 2 * COUNT - left_out
    angle = 2 * np.pi * np.arange(48) / 48
    circle = 0.25 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Views(
        SectionStack(
            np.repeat([0, 1], COUNT)[:n], np.tile(np.arange(COUNT), 2)[:n], np.full(n, 0.25),
            np.full(n, 0.55), np.full((n, PIXELS, PIXELS), 128, np.uint8),
            np.tile(circle, (n, 1, 1)), 2 * COUNT,
        ), (), 0, True, True,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="chromium isn't installed")
def test_a_click_on_a_vessels_drawing_shows_the_section_under_it(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    data = sample_data() | {"registration": two_vessels()}
    write_report_html(path, data, [block_surface()], planar_network(), views=views(left_out=1))
    shown = facts(acted(path, ""))
    # The page begins with what fails.
    assert shown["Vessel, section"] == "1, 4 of 10"
    assert shown["Measured"] == "300.0 µm ± 12.0 µm (95 %)"
    click = (
        "const frame = document.querySelector(\"svg g[id*='along-0-']\");"
        "const at = frame.getBoundingClientRect();"
        "frame.ownerSVGElement.dispatchEvent(new MouseEvent('click', { bubbles: true,"
        " clientX: at.left + 0.76 * at.width, clientY: at.top + at.height / 2 }));"
    )
    write_report_html(path, data, [block_surface()], planar_network(), views=views(left_out=1))
    shown = facts(acted(path, click))
    assert shown["Vessel, section"] == "0, 8 of 10"
    assert shown["Along"] == "3.75 mm"


def facts(dom: str) -> dict[str, str]:
    """Labels and values of the viewer."""
    box = re.search(r'<div class="sections" id="sections">(.*?)</dl>', dom, re.DOTALL)
    assert box is not None, "the viewer isn't shown"
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", box.group(1)))
