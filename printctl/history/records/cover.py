"""HTML cover page of a print's record bundle: printer, times, verdict, alarms, G-code hash."""

from __future__ import annotations

from datetime import UTC, datetime
from html import escape
from typing import Final

from printctl.history.records.verdict import outcome
from printctl.machine.link.history_entry import PrintEntry
from printctl.pipeline.evidence import Evidence

_LONGEST: Final = 2000
_MOST_ALARMS: Final = 20
_LOOK: Final = """
body{font:11pt/1.45 system-ui,sans-serif;color:#1c2526;max-width:46em;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin:0 0 .2em;overflow-wrap:anywhere}h2{font-size:1.05em;margin:1.6em 0 .4em}
table{border-collapse:collapse;width:100%}
th,td{text-align:left;vertical-align:top;padding:.25em .6em .25em 0;border-top:1px solid #ccd4d4}
th{width:12em;font-weight:600}td{overflow-wrap:anywhere}
.sign td{height:2.6em}@media print{body{margin:0;max-width:none}}
"""
_ENDS: Final = {
    "pass": "pass",
    "fail": "FAIL",
    "undecided": "undecided: neither pass nor fail is proven",
    "": "none: the print wasn't scanned, or its report isn't here",
}


def cover_page(record: Evidence) -> str:
    """The page as HTML; what others wrote is in it as text only, and nothing is loaded."""
    entry = record.entry
    reasons = [str(text) for text in (record.verdict or {}).get("reasons", ())]
    alarms = [f"{utc(a.at)}: {a.text}" for a in entry.alarms[:_MOST_ALARMS]]
    if len(entry.alarms) > _MOST_ALARMS:
        alarms.append(f"and {len(entry.alarms) - _MOST_ALARMS} more, in journal.log")
    parts = [
        f"<h1>Record of a print: {_text(entry.file)}</h1>",
        _table(cover_facts(entry)),
        "<h2>Verdict of the scan</h2>",
        _list([_ENDS[outcome(record.verdict)], *reasons]),
        "<h2>Alarms</h2>",
        _list(alarms or ["none"]),
        "<h2>What isn't in this record</h2>" + _list(list(record.missing))
        if record.missing
        else "",
        "<h2>Seen by</h2><table class='sign'><tr><th>Name, date</th><td></td></tr>"
        "<tr><th>Signature</th><td></td></tr></table>",
        "<p>Whether this page and the files beside it are as they were filed: "
        "<code>printctl history verify FILE.zip --key LAB_KEY.pem</code>. Times are UTC, by the "
        "computer's own clock.</p>",
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        "<meta http-equiv='Content-Security-Policy' content=\"default-src 'none'; "
        "style-src 'unsafe-inline'\"><meta name='viewport' content='width=device-width'>"
        f"<title>Record of a print: {_text(entry.file)}</title><style>{_LOOK}</style></head>"
        f"<body><main>{''.join(parts)}</main></body></html>\n"
    )


def utc(seconds: float) -> str:
    """A time as ISO 8601; empty for none."""
    if seconds <= 0:
        return ""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def cover_facts(entry: PrintEntry) -> list[tuple[str, str]]:
    """Names and values of a print, for both covers."""
    ended = f"{entry.state}: {entry.message}" if entry.message else entry.state
    return [
        ("Print", entry.id),
        ("Ended", ended),
        ("Lines", f"{entry.done} of {entry.total}"),
        ("Begun", utc(entry.started) + (f", {entry.begun} times" if entry.begun > 1 else "")),
        ("Over", utc(entry.ended)),
        ("Operator", f"{entry.by} at {entry.host}"),
        ("Printer", f"{entry.profile} at {entry.port}"),
        ("G-code, SHA-256", entry.sha256),
    ]


def _table(rows: list[tuple[str, str]]) -> str:
    cells = (f"<tr><th>{_text(k)}</th><td>{_text(v)}</td></tr>" for k, v in rows)
    return f"<table>{''.join(cells)}</table>"


def _list(texts: list[str]) -> str:
    return f"<ul>{''.join(f'<li>{_text(text)}</li>' for text in texts)}</ul>"


def _text(text: str) -> str:
    return escape(text[:_LONGEST])
