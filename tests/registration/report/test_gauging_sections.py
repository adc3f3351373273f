"""Report parts on defects, deviation, topology and perfusion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lxml import html

from registration.report import write_report_html


def gauged() -> dict[str, Any]:
    """A registration of two vessels, one with a stenosis and a bridge to the other."""
    along = [0.1 * i for i in range(30)]
    vessels = [
        {"vessel": v, "designed_um": 500.0, "measured_um": 490.0, "error_percent": -2.0,
         "length_mm": 3.0, "open": True, "along_mm": along, "unseen_mm": [[2.8, 3.0]],
         "diameter_um": [490.0 if v or not 10 < i < 14 else 250.0 for i in range(30)]}
        for v in (0, 1)
    ]  # fmt: skip
    stenosis = {
        "kind": "stenosis", "vessel": 0, "other": None, "from_mm": 1.0, "to_mm": 1.5,
        "at_mm": 1.2, "point_mm": [1.2, 0.5, 0.25], "size_um": -240.0, "error_um": 4.0,
        "percent": -49.0, "wall_um": -121.0, "seen": True,
        "made_by": {"layers": [3, 4, 5, 6], "first_line": 40, "last_line": 71, "line_count": 9},
    }  # fmt: skip
    bridge = stenosis | {
        "kind": "bridge", "other": 1, "size_um": 210.0, "percent": None, "wall_um": None,
        "made_by": {"layers": [], "first_line": 0, "last_line": 0, "line_count": 0},
    }  # fmt: skip
    betti = {"components": 1, "loops": 3, "cavities": 0, "euler": -2}
    flow = {"vessel": 0, "resistance_pa_s_ul": 3.0, "designed_resistance_pa_s_ul": 1.5,
            "share": 0.3, "designed_share": 0.5, "measured": True, "fed": True}  # fmt: skip
    return {
        "vessels": vessels,
        "defects": [stenosis, bridge],
        "rigid_model_to_scan": {"rms_um": 50.0, "p95_um": 90.0},
        "scaled_model_to_scan": {"rms_um": 8.0, "p95_um": 14.0},
        "hausdorff_p95_um": {"rigid": 95.0, "scaled": 14.5},
        "overlap": {
            "rigid": {"dice": 0.93, "volume_ratio": 0.94},
            "scaled": {"dice": 0.98, "volume_ratio": 0.955},
        },
        "topology": {
            "designed": betti, "printed": betti | {"loops": 4}, "as_designed": False,
            "explained": True,
        },
        "perfusion": {
            "perfused": None, "pressure_drop_pa": 12.0, "designed_pressure_drop_pa": 10.0,
            "vessels": [flow, flow | {"vessel": 1, "resistance_pa_s_ul": None, "fed": False}],
        },
        "within_curve": {
            "tolerance_um": [0, 50, 100], "rigid": [0, 0.5, 1], "scaled": [0, 0.9, 1],
        },
        "by_layer": [
            {"layer": k, "z_mm": 0.06 * k, "mean_um": -5.0, "rms_um": 9.0} for k in range(5)
        ],
        "model_seen_fraction": 0.97,
    }  # fmt: skip


def test_the_page_shows_it_all(tmp_path: Path) -> None:
    write_report_html(tmp_path / "a.html", {"registration": gauged()}, [], None)
    page = html.fromstring((tmp_path / "a.html").read_text(encoding="utf-8"))
    text = " ".join(page.text_content().split())
    for words in ("Findings", "Does it still perfuse?", "95 % Hausdorff", "any tolerance",
                  "each written layer", "Diameter along the vessels"):  # fmt: skip
        assert words in text, words
    assert len(page.xpath('//table[@id="defects-table"]/tbody/tr')) == 2
