"""Service behind the History page: find past prints, give reports and bundles, verify, repeat."""

from __future__ import annotations

import contextlib
import secrets
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Final

from pydantic import Field

from printctl.history.bundle import filed, write_bundle
from printctl.history.index import PrintHistory
from printctl.history.query import HistoryPage, HistoryQuery
from printctl.history.signing import FiledPrint
from printctl.history.table import Outcome, outcome, tell_running
from printctl.history.timeline import Event, Stretch, TimeLine, time_line
from printctl.history.verify import Signature, verify_stream
from printctl.machine.errors import LinkError, NoSuchPrint
from printctl.machine.prints.progress import Progress
from printctl.machine.prints.state import read_print
from printctl.machine.records.lab_key import (
    KeyTrouble,
    PublicKey,
    known_lab_key,
    lab_key,
    read_public,
    signing_missing,
)
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.past.evidence import PHOTOS, evidence
from printctl.pipeline.past.past_print import PrintEntry
from printctl.run_folder.artefacts import GCODE
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, NotFoundError

PICTURES: Final = {".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".png": "image/png"}


class ListedPrint(FiledPrint):
    """A print as it is filed, and the job of this workspace that it was of."""

    job: str = Field(description="run~NAME or file~NAME; empty for a print of elsewhere")


@dataclass(frozen=True)
class PrintsPage:
    """Some of the prints that were asked for; ``total`` is of all pages."""

    prints: tuple[ListedPrint, ...]
    total: int
    offset: int


@dataclass(frozen=True)
class PastPrintDetails:
    """One print with all that there is of it.

    ``verdict`` and ``reasons`` are the scan's, ``note`` is what the operator noted; ``missing``
    isn't there any more, or is of another print. After ``events`` follow ``more_events``; it was
    held for ``held_s``, s. ``progress`` is as the Job page tells it; None of an earlier print of
    the same folder, or without its job's table.
    """

    print: ListedPrint
    verdict: Outcome
    reasons: tuple[str, ...]
    gcode_there: bool
    journal_there: bool
    report: tuple[str, ...]
    photos: tuple[str, ...]
    note: dict[str, Any]
    missing: tuple[str, ...]
    events: tuple[Event, ...]
    more_events: int
    states: tuple[Stretch, ...]
    held_s: float
    progress: Progress | None


@dataclass(frozen=True)
class Verification:
    """What was found of a bundle.

    ``fingerprint`` is the SHA-256 of the key that signed, ``lines`` the same for people;
    ``print_id`` and ``file`` are empty unless the bundle is whole; ``good`` is one that is whole,
    and signed by a trusted key as its journal is.
    """

    whole: bool
    signature: Signature
    fingerprint: str
    changed: tuple[str, ...]
    lines: tuple[str, ...]
    print_id: str
    file: str
    good: bool


class HistoryService:
    """Past prints of this user, of this workspace or of all."""

    def __init__(self, core: Core) -> None:
        self.workspace = core.workspace

    @property
    def folders(self) -> tuple[Path, Path]:
        """Where prints of this workspace leave their journals; either may be on another disk."""
        root = self.workspace.root
        return (root / "runs").resolve(), (root / "jobs").resolve()

    def find(self, query: HistoryQuery) -> HistoryPage:
        """Find a page of prints."""
        prints = PrintHistory().find(query)
        return replace(prints, entries=tuple(tell_running(entry) for entry in prints.entries))

    def listed(self, query: HistoryQuery) -> PrintsPage:
        """Return a page of the prints, without where their files lie."""
        found = self.find(query)
        return PrintsPage(tuple(map(self._listed, found.entries)), found.total, query.offset)

    def entry(self, print_id: str) -> PrintEntry:
        """Return one print's entry, by its whole id; NotFoundError for none."""
        try:
            entry = PrintHistory().one(print_id)
        except NoSuchPrint as exc:
            raise NotFoundError(str(exc)) from exc
        if entry.id != print_id:
            raise NotFoundError(f"no print has the id {print_id[:40]!r}")
        return tell_running(entry)

    def one(self, print_id: str) -> PastPrintDetails:
        """Return one print with all that there is of it; NotFoundError for none."""
        entry = self.entry(print_id)
        try:
            line = time_line(entry.journal)
        except OSError:
            line = TimeLine((), ())
        found = evidence(entry)
        photos = [name.partition("/")[2] for name in found.noted if name.startswith(f"{PHOTOS}/")]
        return PastPrintDetails(
            print=self._listed(entry),
            verdict=outcome(found.verdict),
            reasons=tuple(str(text) for text in (found.verdict or {}).get("reasons", ())),
            gcode_there=found.gcode is not None,
            journal_there=entry.journal.is_file(),
            report=tuple(sorted(found.report)),
            photos=tuple(name for name in photos if Path(name).suffix.lower() in PICTURES),
            note=found.note(),
            missing=found.missing,
            events=line.events,
            more_events=line.more,
            states=line.stretches,
            held_s=line.held_s,
            progress=_progress(entry),
        )

    def bundle(self, print_id: str) -> Path:
        """Write a print's bundle to a file of its own, which the caller deletes.

        RecordsError when the print is still going on, or its journal is gone.
        """
        entry = self.entry(print_id)
        key = None if signing_missing() else lab_key()
        path = self.workspace.private / "bundles" / f"{secrets.token_hex(8)}.zip"
        write_bundle(path, entry, key)
        return path

    def _listed(self, entry: PrintEntry) -> ListedPrint:
        """Return the print with the job of this workspace that it was of."""
        (runs, jobs), path, job = self.folders, Path(entry.path), ""
        if path.name == GCODE and path.parent.parent == runs:
            job = f"run~{path.parent.name}"
        elif path.parent == jobs:
            job = f"file~{path.name}"
        return ListedPrint(**filed(entry).model_dump(), job=job)


def _progress(entry: PrintEntry) -> Progress | None:
    if entry.journal.name != JOURNAL:
        return None
    with contextlib.suppress(LinkError, OSError):
        return read_print(entry.journal.parent).progress
    return None


def verified(stream: BinaryIO, key_pem: bytes = b"") -> Verification:
    """Verify a bundle; without a key this lab's own is the one that is trusted."""
    check = verify_stream(stream, _trusted(key_pem))
    past = check.manifest.print if check.manifest and check.whole else None
    return Verification(
        whole=check.whole,
        signature=check.signature,
        fingerprint=check.fingerprint,
        changed=check.changed,
        lines=tuple(check.lines()),
        print_id=past.id if past else "",
        file=past.file if past else "",
        good=check.good,
    )


def _trusted(key_pem: bytes) -> list[PublicKey]:
    if not key_pem.strip():
        own = known_lab_key()
        return [own] if own is not None else []
    try:
        return [read_public(key_pem, "the key")]
    except KeyTrouble as exc:
        raise BadRequestError(str(exc)) from exc
