"""Pages printed to PDF by an installed browser; read back by pypdf."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pypdf import PdfReader

from registration.report import ReportError, print_page, write_report_html
from tests.printctl.web.shell.browsers import CHROMIUM
from tests.registration.report.sample import planar_network, sample_data


def whole_sample() -> dict[str, Any]:
    data = sample_data()
    data["printed"] = {"id": "p-7", "started": 1795209018.9, "gcode_sha256": "ff" * 32}
    data["registration"] |= {
        "scale": [0.9962, 0.997, 1.0],
        "interval_95": {
            "scale": [0.00047, 0.0007, None],
            "offset_um": 1.3,
            "shift_um": [1.0, 2.0, 3.0],
            "rotation_deg": [0.0069, 0.0029, 0.021],
        },
        "offset_um": -8.5,
        "walls": None,
        "design": {"network_sha256": "d" * 64},
    }
    return data


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="chromium isn't installed")
def test_a_printed_report_says_what_its_page_says(tmp_path: Path) -> None:
    page, pdf = tmp_path / "a report.html", tmp_path / "ü.pdf"
    write_report_html(page, whole_sample(), [], planar_network())
    print_page.print_page(page, pdf)
    assert sorted(one.name for one in tmp_path.iterdir()) == [page.name, pdf.name]
    reader = PdfReader(pdf)
    assert [float(side) for side in reader.pages[0].mediabox[2:]] == pytest.approx(
        [595, 842], abs=1
    )
    texts = [one.extract_text() for one in reader.pages]
    for k, text in enumerate(texts):
        assert f"{k + 1} / {len(texts)}" in text
    words = " ".join(" ".join(texts).split())
    for said in ("planar_fresh", "Pass", "0.99620", "± 0.00047", "not fitted", "−8.50",
                 "Rotation about z / °", "p-7", "2026-11-20 21:10 UTC"):  # fmt: skip
        assert said in words, said
    for digest in ("ff" * 32, "d" * 64):
        assert digest in words.replace(" ", "")
    # Vessels in three dimensions, drawn without a graphics card.
    assert any(len(one.images) for one in reader.pages)


@pytest.mark.parametrize(
    ("script", "limit_s", "why"),
    [
        ("echo sandbox >&2", 60.0, r"wrote no PDF \(sandbox\)"),
        ("exec sleep 60", 0.2, "within 0.2 s"),
    ],
)
def test_a_browser_that_fails_or_hangs_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, limit_s: float, why: str
) -> None:
    browser, pdf = tmp_path / "chromium", tmp_path / "a.pdf"
    browser.write_text(f"#!/bin/sh\n{script}\n")
    browser.chmod(0o755)
    pdf.write_bytes(b"old")
    monkeypatch.setattr(print_page, "find_browser", lambda: str(browser))
    monkeypatch.setattr(print_page, "TIME_LIMIT_S", limit_s)
    with pytest.raises(ReportError, match=why):
        print_page.print_page(tmp_path / "a.html", pdf)
    assert pdf.read_bytes() == b"old"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.pdf", "chromium"]
