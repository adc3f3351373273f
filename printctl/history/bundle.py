"""Pack a print's files and their cover page into one signed bundle."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, BinaryIO, Final

from design.files import atomic_replacement
from printctl.history.plain_zip import PlainZipWriter, safe_name
from printctl.history.signing import (
    MANIFEST,
    PUBLIC_KEY,
    SIGNATURE,
    BundleError,
    FiledJournal,
    FiledPrint,
    FileEntry,
    Manifest,
)
from printctl.history.table import outcome
from printctl.machine.process.contact import alive
from printctl.machine.records.lab_key import LabKey
from printctl.machine.records.sealing import check_journal_file
from printctl.machine.records.states import state_words
from printctl.pipeline.past.evidence import Evidence, evidence
from printctl.pipeline.past.past_print import INTERRUPTED, PrintEntry, entry_of
from printctl.version import version

# HTML cover page of a print's record bundle: printer, times, verdict, alarms, G-code hash.
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
    ended = state_words(entry.state) + (f": {entry.message}" if entry.message else "")
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


_BLOCK: Final = 1 << 20
_LETTERS: Final = 4000
Source = tuple[str, str, Path | bytes]
"""Name in the bundle, what it is, where it comes from."""


def write_bundle(path: Path, entry: PrintEntry, key: LabKey | None) -> Manifest:
    """Write a print's bundle; same content, same bytes.

    Parameters
    ----------
    path : Path
        The zip; an old one is replaced only by a whole new one.
    entry : PrintEntry
    key : LabKey or None
        None for a bundle without a signature.

    Raises
    ------
    BundleError
        When the print is still going on, its journal is gone, or a file's name can't be used.
    """
    if entry.state == INTERRUPTED and entry.journal.exists() and alive(entry.journal.parent):
        raise BundleError(f"print {entry.id} is still going on; make its bundle when it has ended")
    record = evidence(entry)
    if not entry.journal.is_file():
        raise BundleError(
            f"the journal {entry.journal} isn't there any more, and without it there is no "
            "record; if the folder was moved, `printctl history rebuild FOLDER`"
        )
    now = entry_of(entry.journal)
    if now is None or now.id != entry.id:
        raise BundleError(
            f"the journal {entry.journal} isn't of print {entry.id} any more, but of "
            f"{now.id if now else 'none'}; `printctl history rebuild` reads the journals again"
        )
    with atomic_replacement(path) as draft, draft.open("w+b") as stream:
        return _write(stream, record, key)


def _hashes(record: Evidence) -> dict[str, str]:
    """Hashes as far as there are any: an old recipe's folder of pictures has none."""
    return {k: v for k, v in record.hashes.items() if re.fullmatch("[0-9a-f]{64}", str(v))}


def _write(stream: BinaryIO, record: Evidence, key: LabKey | None) -> Manifest:
    check = check_journal_file(record.entry.journal, [key.public] if key else [])
    out = PlainZipWriter(stream)
    files = []
    for name, what, source in sorted(_sources(record, key)):
        member, digest = out.add(name, _blocks(source))
        files.append(FileEntry(path=name, what=what, sha256=digest, bytes=member.size))
    manifest = Manifest(
        print=filed(record.entry),
        verdict=outcome(record.verdict),
        versions=_versions(record),
        missing=tuple(text[:_LETTERS] for text in record.missing),
        journal=FiledJournal(finding=check.finding, words=check.words[:_LETTERS]),
        hashes=_hashes(record),
        files=tuple(files),
        signed_by=key.public.fingerprint if key else "",
    )
    data = manifest.to_bytes()
    out.add(MANIFEST, iter([data]))
    if key:
        out.add(SIGNATURE, iter([key.sign(data)]))
    out.close()
    return manifest


def filed(entry: PrintEntry) -> FiledPrint:
    """The print's entry as a manifest holds it: without where its files lie on this machine."""
    values = {k: v for k, v in asdict(entry).items() if k not in ("journal", "path")}
    values["alarms"] = [{"at": alarm.at, "text": alarm.text[:_LETTERS]} for alarm in entry.alarms]
    cut = {k: v[:_LETTERS] if isinstance(v, str) else v for k, v in values.items()}
    return FiledPrint.model_validate(cut)


def _sources(record: Evidence, key: LabKey | None) -> Iterator[Source]:
    yield "journal.log", "the link process's journal", record.entry.journal
    yield "cover.html", "one page to read and print", cover_page(record).encode()
    if record.gcode is not None:
        yield "job.gcode", "the G-code that was sent", record.gcode
    yield "job.sha256", "its hash", f"{record.entry.sha256}  job.gcode\n".encode()
    if "recipe" in record.facts:
        yield "recipe.json", "the recipe, with all defaults", _json(record.facts["recipe"])
    for name, values in record.profiles.items():
        if safe_name(f"{name}.json"):
            yield f"profiles/{name}.json", "a profile as it was", _json(values)
    for name, path in record.planned.items():
        what = (
            "the run's stages and their hashes" if name == MANIFEST else "checked before the print"
        )
        yield "run.json" if name == MANIFEST else f"preflight/{name}", what, path
    for name, path in record.report.items():
        yield f"report/{name}", "found after the print", path
    for k, (name, path) in enumerate(record.noted.items()):
        member = name if safe_name(name) else f"photos/photo_{k:04d}{_suffix(path)}"
        yield member, "noted by the operator", path
    if key:
        yield PUBLIC_KEY, "of the key that signed", key.public.pem()


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    return suffix if suffix in (".jpg", ".jpeg", ".png", ".txt", ".pdf") else ".bin"


def _versions(record: Evidence) -> dict[str, str]:
    versions: dict[str, Any] = {
        "written by": version(),
        "printed by": record.job.get("printctl", ""),
    }
    designed = record.facts.get("versions", {}).get("printctl", "")
    return {k: str(v) for k, v in {**versions, "designed by": designed}.items() if v}


def _json(values: Any) -> bytes:
    return json.dumps(values, indent=1, sort_keys=True).encode() + b"\n"


def _blocks(source: Path | bytes) -> Iterator[bytes]:
    if isinstance(source, bytes):
        yield source
        return
    with source.open("rb") as handle:
        while block := handle.read(_BLOCK):
            yield block
