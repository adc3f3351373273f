"""Service behind the History page: find past prints, give reports and bundles, verify, repeat."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Final, Literal

from printctl.history.bundle import write_bundle
from printctl.history.repeat import RepeatPlan, make_job, plan_repeat
from printctl.history.signing import (
    KeyTrouble,
    PublicKey,
    known_lab_key,
    lab_key,
    read_public,
    signing_missing,
)
from printctl.history.table import csv_lines
from printctl.history.timeline import TimeLine, time_line
from printctl.history.verify import BundleCheck, verify_stream
from printctl.machine.link.errors import NoSuchPrint
from printctl.machine.link.find_link import alive
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.history_entry import INTERRUPTED, PrintEntry
from printctl.machine.link.history_query import HistoryPage, HistoryQuery
from printctl.machine.link.record import JOURNAL
from printctl.pipeline.evidence import PHOTOS, Evidence, evidence
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, NotFoundError

RUNNING: Final = "running"
_PICTURES: Final = {".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".png": "image/png"}


@dataclass(frozen=True)
class PastPrintDetails:
    """One print with all that there is of it.

    Attributes
    ----------
    entry : PrintEntry
    found : Evidence
    line : TimeLine or None
        None when the journal is gone.
    """

    entry: PrintEntry
    found: Evidence
    line: TimeLine | None


@dataclass(frozen=True)
class Choices:
    """What the history can be narrowed to.

    Attributes
    ----------
    profiles, people, states : list of str
    """

    profiles: list[str]
    people: list[str]
    states: list[str]


class HistoryService:
    """Past prints of this user, whatever workspace they were made in.

    Parameters
    ----------
    core : Core
    """

    def __init__(self, core: Core) -> None:
        self._core = core

    def find(self, query: HistoryQuery) -> HistoryPage:
        """A page of the prints that are asked for."""
        prints = PrintHistory().find(query)
        return replace(prints, entries=tuple(_running(entry) for entry in prints.entries))

    def choices(self) -> Choices:
        """What there is to narrow to."""
        history = PrintHistory()
        return Choices(history.known("profile"), history.known("who"), history.known("state"))

    def entry(self, print_id: str) -> PrintEntry:
        """One print's entry, by its whole id.

        Raises
        ------
        NotFoundError
        """
        try:
            entry = PrintHistory().one(print_id)
        except NoSuchPrint as exc:
            raise NotFoundError(str(exc)) from exc
        if entry.id != print_id:
            raise NotFoundError(f"no print has the id {print_id[:40]!r}")
        return _running(entry)

    def one(self, print_id: str) -> PastPrintDetails:
        """One print with all that there is of it.

        Raises
        ------
        NotFoundError
        """
        entry = self.entry(print_id)
        try:
            line = time_line(entry.journal)
        except OSError:
            line = None
        return PastPrintDetails(entry, evidence(entry), line)

    def csv(self, query: HistoryQuery) -> Iterator[str]:
        """The prints that are asked for as CSV, a line at a time."""
        yield from csv_lines(self.find(replace(query, limit=None, offset=0)).entries)

    def report(self, print_id: str, kind: Literal["html", "json", "pdf"]) -> Path:
        """File of a print's report.

        Raises
        ------
        NotFoundError
            When there is none, or it is of another print.
        """
        path = evidence(self.entry(print_id)).report.get(f"report.{kind}")
        if path is None:
            raise NotFoundError(f"print {print_id} has no report as {kind.upper()}")
        return path

    def photo(self, print_id: str, name: str) -> tuple[Path, str]:
        """File and media type of a photo that the operator took.

        Raises
        ------
        NotFoundError
        """
        path = evidence(self.entry(print_id)).noted.get(f"{PHOTOS}/{name}")
        media = _PICTURES.get(path.suffix.lower()) if path is not None else None
        if path is None or media is None:
            raise NotFoundError(f"print {print_id} has no such photo")
        return path, media

    def bundle(self, print_id: str) -> Path:
        """Write a print's bundle to a file of its own, which the caller deletes.

        Raises
        ------
        NotFoundError
        RecordsError
            When the print is still going on, or its journal is gone.
        """
        entry = self.entry(print_id)
        key = None if signing_missing() else lab_key()
        path = self._core.workspace.private / "bundles" / f"{secrets.token_hex(8)}.zip"
        write_bundle(path, entry, key)
        return path

    def incoming(self, name: str) -> Path:
        """Where an upload may lie while it is looked at; the caller deletes it."""
        folder = self._core.workspace.private / "bundles"
        folder.mkdir(parents=True, exist_ok=True)
        return folder / f"{name}.upload"

    def verify(self, stream: BinaryIO, key_pem: bytes = b"") -> BundleCheck:
        """Verify a bundle; without a key this lab's own is the one that is trusted.

        Raises
        ------
        BadRequestError
            When the key is none.
        """
        return verify_stream(stream, self._trusted(key_pem))

    def verify_file(self, path: Path, key_pem: bytes = b"") -> BundleCheck:
        """`verify` of a file."""
        with path.open("rb") as stream:
            return self.verify(stream, key_pem)

    def public_key(self) -> PublicKey:
        """The lab's public key, made if there is none.

        Raises
        ------
        KeyTrouble
        """
        return lab_key().public

    def plan_repeat(self, print_id: str) -> RepeatPlan:
        """What it would mean to print the same again.

        Raises
        ------
        NotFoundError
        RecordsError
            When the bytes that were printed aren't there any more.
        """
        return plan_repeat(self.entry(print_id))

    def repeat(self, print_id: str) -> str:
        """Make a job of the same bytes, and give its name; nothing is started.

        Raises
        ------
        NotFoundError
        RecordsError
            When the bytes that were printed aren't there any more.
        """
        folder = self._core.workspace.root / "jobs"
        return f"file~{make_job(self.plan_repeat(print_id), folder).name}"

    def _trusted(self, key_pem: bytes) -> list[PublicKey]:
        if not key_pem.strip():
            own = known_lab_key()
            return [own] if own is not None else []
        try:
            return [read_public(key_pem, "the key")]
        except KeyTrouble as exc:
            raise BadRequestError(str(exc)) from exc


def _running(entry: PrintEntry) -> PrintEntry:
    """Tell a print that is going on from one whose link process died."""
    latest = entry.journal.name == JOURNAL and entry.state == INTERRUPTED
    if latest and entry.journal.exists() and alive(entry.journal.parent):
        return replace(entry, state=RUNNING)
    return entry
