"""Cover page of a record bundle, as HTML and PDF."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest

from printctl.machine.link.history_entry import Alarm
from printctl.pipeline.evidence import evidence
from tests.printctl.history.records.prints import printed, with_run

HOSTILE = "<b>&<script>\x00\x1b[31m\n" + "x" * 5000


def test_paper_cover_is_one_page_with_verdict_hash_and_operator(tmp_path):
    pypdf = pytest.importorskip("pypdf")
    pytest.importorskip("reportlab")
    from printctl.history.records.cover_pdf import cover_pdf

    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    data = cover_pdf(evidence(entry))
    assert data == cover_pdf(evidence(entry))
    (page,) = pypdf.PdfReader(io.BytesIO(data)).pages
    told = page.extract_text()
    assert "Pass" in told
    assert "ada at lab" in told
    assert entry.sha256[:30] in told


def test_paper_cover_takes_hostile_text(tmp_path):
    pypdf = pytest.importorskip("pypdf")
    pytest.importorskip("reportlab")
    from printctl.history.records.cover_pdf import cover_pdf

    alarms = tuple(Alarm(1e9, HOSTILE) for _ in range(50))
    entry = replace(printed(tmp_path / "run"), file=HOSTILE, message=HOSTILE, alarms=alarms)
    told = pypdf.PdfReader(io.BytesIO(cover_pdf(evidence(entry)))).pages
    assert "<script>" in told[0].extract_text()
