"""Pack a print's files into one signed bundle."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO, Final

from design.files import atomic_replacement
from printctl.history.records.cover import cover_page
from printctl.history.records.errors import BundleError
from printctl.history.records.keys import LabKey
from printctl.history.records.manifest import (
    MANIFEST,
    PUBLIC_KEY,
    SIGNATURE,
    FiledPrint,
    FileEntry,
    Manifest,
)
from printctl.history.records.plain_zip import PlainZipWriter, safe_name
from printctl.history.records.verdict import outcome
from printctl.machine.link.find_link import alive
from printctl.machine.link.history_entry import INTERRUPTED, PrintEntry
from printctl.machine.link.origin import version
from printctl.pipeline.evidence import Evidence, evidence

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
    with atomic_replacement(path) as draft, draft.open("w+b") as stream:
        return _write(stream, record, key)


def _write(stream: BinaryIO, record: Evidence, key: LabKey | None) -> Manifest:
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
        yield f"preflight/{name}", "checked before the print", path
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
