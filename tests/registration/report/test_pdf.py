"""PDF report: text, pages, reproducible bytes; read back by pypdf."""

from __future__ import annotations

import copy
import io
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pypdf import PdfReader

from registration.report import ReportError, all_figures
from registration.report.pdf import library, pdf_missing, write_report_pdf
from registration.report.pdf.drawing import Drawing
from registration.report.pdf.paths import START, matrices, styled, trace
from registration.report.pdf.report import report_pdf
from registration.report.pdf.styles import MARGIN, PAGE, WIDTH
from registration.report.pdf.tables import _broken, _parts
from tests.registration.report.sample import planar_network, sample_data


def pages(data: dict[str, Any], figures: dict[str, bytes] | None = None) -> list[str]:
    reader = PdfReader(io.BytesIO(report_pdf(data, planar_network(), figures or {})))
    return [page.extract_text() for page in reader.pages]


@cache
def drawn() -> dict[str, bytes]:
    """Figures of the whole sample, for tests that look at something else."""
    return all_figures(whole_sample(), planar_network(), {})


@cache
def whole_pages() -> tuple[str, ...]:
    """Text of the whole sample's pages."""
    return tuple(pages(whole_sample()))


def whole_sample() -> dict[str, Any]:
    data = sample_data()
    data["printed"] = {"id": "p-7", "started": 1795209018.9, "gcode_sha256": "b" * 64}
    data["registration"] |= {
        "interval_95": {
            "scale": [0.00047, 0.0007, None],
            "offset_um": 1.3,
            "shift_um": [1.0, 2.0, 3.0],
            "rotation_deg": [0.0069, 0.0029, 0.021],
        },
        "offset_um": -8.5,
        "cross_check_um": 0.598,
        "walls": None,
        "defects": [
            {"kind": "stenosis", "vessel": 7, "from_mm": 3.9, "to_mm": 6.1, "at_mm": 5.02,
             "point_mm": [8.02, 5.0, 1.5], "size_um": -295.3, "error_um": 3.9, "percent": -49.9,
             "seen": True}
        ],
        "design": {"network_sha256": "d" * 64},
    }  # fmt: skip
    return data


def test_it_says_what_the_report_says() -> None:
    text = "\n".join(whole_pages())
    for words in (
        "planar_fresh", "✓ Pass", "Largest diameter error 6.3 % of 10 % allowed (vessel 5).",
        "RMS deviation 38.2 µm of 100 µm allowed, rigid fit.", "37.7", "14 of 14",
        "0.99620", "± 0.00047", "not fitted", "−8.50", "± 1.3", "Rotation about z / °", "0.6 µm",
        "stenosis", "8.02, 5.00, 1.50", "−295", "−49.9",
        "Depth and refractive index can't be told apart",
        "printctl 0.1.0, numpy 2.4.6", "6f1c0f9c4f…", "d" * 64, "b" * 64, "p-7",
        "2026-11-20 21:10 UTC", "simulated OCT", "signed deviation / µm", "x / mm",
    ):  # fmt: skip
        assert words in text, words


def test_every_page_is_numbered_and_named() -> None:
    found = whole_pages()
    assert len(found) > 2
    for k, page in enumerate(found):
        assert "planar_fresh · printed 2026-11-20 21:10 UTC" in page
        assert f"page {k + 1} of" in page
        assert page.split(f"page {k + 1} of")[1].split()[0] == str(len(found))


def test_same_run_same_bytes_whatever_the_clock() -> None:
    data, network = whole_sample(), planar_network()
    first = report_pdf(data, network, drawn())
    again = copy.deepcopy(data)
    again["timings"] = {"solid": {"seconds": 99.0, "peak_mb": 1, "reused": True}}
    assert report_pdf(again, network, {}) == first
    again["registration"]["rigid"]["rms_um"] = 38.3
    assert report_pdf(again, network, drawn()) != first


@pytest.mark.slow
def test_a_thousand_vessels_have_their_head_on_every_page() -> None:
    data = whole_sample()
    rows = data["registration"]["vessels"]
    data["registration"]["vessels"] = [
        {**rows[n % len(rows)], "vessel": n, "kind": f"k{n}"} for n in range(1000)
    ]
    found = [page for page in pages(data) if "k5" in page or "Narrowest\n" in page]
    listed = {word for page in found for word in page.split() if word.startswith("k")}
    assert {f"k{n}" for n in range(1000)} <= listed
    table = [page for page in found if sum(w[0] == "k" for w in page.split()) > 20]
    assert len(table) > 10
    assert all("Narrowest" in page and "Designed" in page for page in table)


def test_little_is_enough_and_markup_is_text() -> None:
    found = pages({"recipe": "<b>a & b</b>", "verdict": {"passed": False, "undecided": True,
                   "reasons": ["<i>x</i> unseen"]}})  # fmt: skip
    assert "<b>a & b</b>" in found[0]
    assert "Undecided: neither pass nor fail is proven" in found[0]
    assert "<i>x</i> unseen" in found[0]
    assert "No verdict" in pages({})[0]


def test_the_verdict_stands_in_the_files_own_properties() -> None:
    reader = PdfReader(io.BytesIO(report_pdf(whole_sample(), None, drawn())))
    assert reader.metadata is not None
    assert str(reader.metadata.subject).startswith("Pass: Every vessel is open.")


def test_a_figure_that_is_none_is_refused() -> None:
    with pytest.raises(ReportError, match="'Oops' is neither PNG nor SVG"):
        pages({}, {"toolpath/Oops": b"GIF89a"})


def test_a_drawing_taller_than_a_page_is_made_smaller() -> None:
    tall = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 374 929"></svg>'
    shown = Drawing(tall, "vessels", WIDTH)
    assert shown.height <= PAGE[1] - 2 * MARGIN
    assert shown.width / shown.height == pytest.approx(374 / 929)


def test_without_the_library_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert pdf_missing() is None
    monkeypatch.setattr(library, "find_spec", lambda name: None)
    with pytest.raises(ReportError, match=r"pip install 'printctl\[pdf\]'"):
        write_report_pdf(tmp_path / "a.pdf", sample_data())
    assert not list(tmp_path.iterdir())


class Traced:
    """Takes down a path, its curves as points."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []
        self.closed = 0

    def moveTo(self, x: float, y: float) -> None:  # noqa: N802
        self.points.append((x, y))

    lineTo = moveTo  # noqa: N815

    def curveTo(self, *v: float) -> None:  # noqa: N802
        p = np.array([self.points[-1], v[0:2], v[2:4], v[4:6]])
        t = np.linspace(0, 1, 5)[1:, None]
        curve = (1 - t) ** 3 * p[0] + 3 * t * (1 - t) ** 2 * p[1] + 3 * t**2 * (1 - t) * p[2]
        self.points += [tuple(q) for q in curve + t**3 * p[3]]

    def close(self) -> None:
        self.closed += 1


def test_paths_go_where_svg_says() -> None:
    found = Traced()
    trace(found, "M 1 2 L 3 2 H 5 V -1e1 Q 7 -10 7 -8 z")
    # A quadratic at a quarter: (9 p0 + 6 p1 + p2)/16.
    assert found.points[:4] == [(1, 2), (3, 2), (5, 2), (5, -10)]
    assert found.points[4] == pytest.approx(((45 + 42 + 7) / 16, (-90 - 60 - 8) / 16))
    assert found.points[-1] == pytest.approx((7, -8))
    assert found.closed == 1


def test_transforms_turn_about_their_point() -> None:
    ((a, b, c, d, e, f),) = matrices("rotate(-90 10 20)")
    # SVG counts y downwards: −90° carries what lies right of the point above it.
    assert (a * 11 + c * 20 + e, b * 11 + d * 20 + f) == pytest.approx((10, 19))
    assert matrices("scale(1 -1) translate(0 -5)") == [(1, 0, 0, -1, 0, 0), (1, 0, 0, 1, 0, -5)]


def test_styles_are_inherited_and_opacities_multiply() -> None:
    above = styled({"style": "fill: #ff0000; opacity: 0.5"}, {})
    own = styled({"style": "opacity: 0.5", "stroke": "#000000"}, above)
    assert (own["fill"], own["stroke"], float(own["opacity"])) == ("#ff0000", "#000000", 0.25)


def test_columns_that_do_not_fit_follow_in_another_table() -> None:
    assert _parts([10, 20, 30, 40], 100) == [[0, 1, 2, 3]]
    assert _parts([10, 20, 30, 40], 70) == [[0, 1, 2], [0, 3]]
    assert _parts([10, 20, 20, 20, 20, 20, 20], 120) == [[0, 1, 2, 3], [0, 4, 5, 6]]


def test_a_word_too_long_for_its_column_is_broken() -> None:
    path = "runs/" + 20 * "abcde"
    lines = _broken(f"two words {path}").split("\n")
    assert max(map(len, lines)) <= 34
    assert "".join(lines).replace(" ", "").replace("\n", "") == f"twowords{path}"
    assert _broken("Conductances", 11) == "Conductances"


def test_many_doubts_of_the_pose_go_on_over_pages() -> None:
    data = whole_sample()
    data["registration"]["ambiguity"] = {
        "flag": True, "margin": 1.0, "doubts": [f"Doubt {k}: {'it may lie otherwise ' * 20}"
                                                for k in range(20)],
    }  # fmt: skip
    text = "\n".join(pages(data, drawn()))
    assert "Doubt 0" in text
    assert "Doubt 19" in text


def test_a_translucent_area_stays_so_where_it_is_used() -> None:
    used = styled({"style": "fill: #1b5e9e; fill-opacity: 0.12"}, START)
    assert styled({}, used)["fill-opacity"].strip() == "0.12"


def test_looks_and_the_final_scan_have_a_table() -> None:
    row = {"look": 5, "mark": "end of layer 4", "way_mm": 162.8, "agree": False,
           "scan_missing_mm": 16.3, "words": "look: mended; scan: missing"}  # fmt: skip
    text = " ".join(pages(sample_data() | {"looks": [row]}, drawn()))
    assert "Looks at the print" in text
    assert "look: mended" in text
    assert "16.3" in text
    assert "Looks at the print" not in " ".join(pages(sample_data(), drawn()))
