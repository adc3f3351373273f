"""Cover page of a record bundle."""

from __future__ import annotations

from dataclasses import replace

from printctl.history.bundle import cover_page
from printctl.machine.link.history_entry import Alarm
from printctl.pipeline.evidence import evidence
from tests.printctl.history.records.prints import printed, with_run

HOSTILE = "<b>&<script>\x00\x1b[31m\n" + "x" * 5000


def test_cover_has_verdict_hash_and_operator(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    page = cover_page(evidence(entry))
    assert page == cover_page(evidence(entry))
    for words in ("<li>pass</li>", "ada at lab", entry.sha256):
        assert words in page


def test_cover_takes_hostile_text(tmp_path):
    alarms = tuple(Alarm(1e9, HOSTILE) for _ in range(50))
    entry = replace(printed(tmp_path / "run"), file=HOSTILE, message=HOSTILE, alarms=alarms)
    page = cover_page(evidence(entry))
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
