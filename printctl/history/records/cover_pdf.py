"""Cover page of a print's record bundle, as PDF; reportlab is imported only when needed."""

from __future__ import annotations

from typing import Final

from reportlab.platypus import Spacer

from printctl.history.records.cover import cover_facts, utc
from printctl.history.records.verdict import outcome
from printctl.pipeline.evidence import Evidence
from registration.report.pdf.blocks import pair, verdict_box
from registration.report.pdf.document import Facts, build_pdf
from registration.report.pdf.styles import HEADING, META, OVERLINE, SMALL, TITLE, text

_MOST: Final = 8
_LETTERS: Final = 300


def cover_pdf(record: Evidence) -> bytes:
    """One page on top of a record; same print, same bytes."""
    entry = record.entry
    alarms = [f"{utc(one.at)}: {one.text}" for one in entry.alarms]
    story = [
        text("printctl · record of a print", OVERLINE),
        text(_plain(entry.file), TITLE),
        text(f"print {entry.id}", META),
        verdict_box(record.verdict or {}),
        Spacer(0, 10),
    ]
    for name, value in cover_facts(entry):
        story.append(pair([text(name, SMALL)], [text(_plain(value))]))
    for name, texts in (("Alarms", alarms or ["none"]), ("Not in this record", record.missing)):
        if texts:
            story.append(text(name, HEADING))
            story += [text(_plain(one)) for one in texts[:_MOST]]
            if len(texts) > _MOST:
                story.append(text(f"and {len(texts) - _MOST} more", SMALL))
    story += [text("Seen by (name, date, signature)", HEADING), Spacer(0, 30)]
    verify = "printctl history verify FILE.zip --key LAB_KEY.pem tells whether it is whole"
    subject = outcome(record.verdict) or "no verdict"
    return build_pdf(story, Facts(f"Record of print {entry.id}", subject, verify))


def _plain(words: str) -> str:
    return "".join(c if c.isprintable() else " " for c in words)[:_LETTERS]
