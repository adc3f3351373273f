"""Service behind the History page: find past prints, give reports and bundles, verify, repeat."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal

from pydantic import Field

from printctl.history.bundle import filed, write_bundle
from printctl.history.repeat import Difference, make_job, plan_repeat
from printctl.history.signing import (
    FiledPrint,
    KeyTrouble,
    PublicKey,
    known_lab_key,
    lab_key,
    read_public,
    signing_missing,
)
from printctl.history.table import Outcome, csv_lines, outcome
from printctl.history.timeline import Event, Stretch, time_line
from printctl.history.verify import Signature, verify_stream
from printctl.machine.link.errors import LinkError, NoSuchPrint
from printctl.machine.link.find_link import alive
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.history_entry import INTERRUPTED, PrintEntry
from printctl.machine.link.history_query import HistoryPage, HistoryQuery
from printctl.machine.link.record import JOURNAL
from printctl.machine.print_state.state import read_print
from printctl.machine.printing.progress import Progress
from printctl.pipeline.evidence import GCODE, PHOTOS, evidence
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, NotFoundError

RUNNING: Final = "running"
_PICTURES: Final = {".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".png": "image/png"}


class ListedPrint(FiledPrint):
    """A print as it is filed, and the job of this workspace that it was of."""

    job: str = Field(description="run~NAME or file~NAME; empty for a print of elsewhere")


@dataclass(frozen=True)
class PrintsPage:
    """Some of the prints that were asked for.

    Attributes
    ----------
    prints : tuple of ListedPrint
    total : int
        On all pages.
    offset : int
    """

    prints: tuple[ListedPrint, ...]
    total: int
    offset: int


@dataclass(frozen=True)
class PastPrintDetails:
    """One print with all that there is of it.

    Attributes
    ----------
    print : ListedPrint
    verdict : str
        Of the scan: ``pass``, ``fail``, ``undecided``; empty for none.
    reasons : tuple of str
        Of the verdict.
    gcode_there, journal_there : bool
        Whether the bytes that were printed, and the journal, are still there.
    report, photos : tuple of str
        Files of the report; photos that the operator took.
    note : dict
        What the operator noted.
    missing : tuple of str
        What isn't there any more, or is of another print.
    events : tuple of Event
        The first of them.
    more_events : int
    states : tuple of Stretch
    held_s : float, s
        How long the print was held.
    progress : Progress or None
        How far it came, as the Job page tells it; None of an earlier print of the same folder, or
        without its job's table.
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

    Attributes
    ----------
    whole : bool
    signature : Signature
    fingerprint : str
        SHA-256 of the key that signed.
    changed : tuple of str
    lines : tuple of str
        The same for people.
    print_id, file : str
        Of the print, where the bundle is whole.
    """

    whole: bool
    signature: Signature
    fingerprint: str
    changed: tuple[str, ...]
    lines: tuple[str, ...]
    print_id: str
    file: str


@dataclass(frozen=True)
class Repetition:
    """What it would mean to print the same again.

    Attributes
    ----------
    sha256 : str
        Of the G-code.
    differences : tuple of Difference
        What isn't as it was when it was printed.
    unknown : tuple of str
        What nobody can tell whether it differs.
    set_up : dict
        Names of profiles.
    """

    sha256: str
    differences: tuple[Difference, ...]
    unknown: tuple[str, ...]
    set_up: dict[str, Any]


@dataclass(frozen=True)
class NewJob:
    """A job that is ready for the Job page.

    Attributes
    ----------
    job : str
        ``file~NAME``.
    """

    job: str


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
    """Past prints of this user, of this workspace or of all.

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

    def listed(self, query: HistoryQuery) -> PrintsPage:
        """Return a page of the prints, without where their files lie."""
        found = self.find(query)
        return PrintsPage(tuple(map(self._listed, found.entries)), found.total, query.offset)

    def _listed(self, entry: PrintEntry) -> ListedPrint:
        return ListedPrint(**filed(entry).model_dump(), job=self._job(entry))

    def here(self, query: HistoryQuery) -> HistoryQuery:
        """Narrow a query to prints of this workspace."""
        return replace(query, within=self._folders())

    def _folders(self) -> tuple[Path, ...]:
        """Where prints of this workspace leave their journals; either may be on another disk."""
        return tuple((self._core.workspace.root / name).resolve() for name in ("runs", "jobs"))

    def choices(self, here: bool = False) -> Choices:
        """Return what there is to narrow to, in this workspace or in all."""
        history, within = PrintHistory(), self._folders() if here else ()
        return Choices(
            history.known("profile", within),
            history.known("who", within),
            history.known("state", within),
        )

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
        found = evidence(entry)
        photos = [name.partition("/")[2] for name in found.noted if name.startswith(f"{PHOTOS}/")]
        return PastPrintDetails(
            print=self._listed(entry),
            verdict=outcome(found.verdict),
            reasons=tuple(str(text) for text in (found.verdict or {}).get("reasons", ())),
            gcode_there=found.gcode is not None,
            journal_there=entry.journal.is_file(),
            report=tuple(sorted(found.report)),
            photos=tuple(name for name in photos if Path(name).suffix.lower() in _PICTURES),
            note=found.note(),
            missing=found.missing,
            events=line.events if line else (),
            more_events=line.more if line else 0,
            states=line.stretches if line else (),
            held_s=line.held_s if line else 0.0,
            progress=_progress(entry),
        )

    def _job(self, entry: PrintEntry) -> str:
        """Return the job of this workspace that was printed; empty for one of elsewhere."""
        runs, jobs = self._folders()
        path = Path(entry.path)
        if path.name == GCODE and path.parent.parent == runs:
            return f"run~{path.parent.name}"
        return f"file~{path.name}" if path.parent == jobs else ""

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

    def verify(self, stream: BinaryIO, key_pem: bytes = b"") -> Verification:
        """Verify a bundle; without a key this lab's own is the one that is trusted.

        Raises
        ------
        BadRequestError
            When the key is none.
        """
        check = verify_stream(stream, self._trusted(key_pem))
        past = check.manifest.print if check.manifest and check.whole else None
        return Verification(
            whole=check.whole,
            signature=check.signature,
            fingerprint=check.fingerprint,
            changed=check.changed,
            lines=tuple(check.lines()),
            print_id=past.id if past else "",
            file=past.file if past else "",
        )

    def public_key(self) -> PublicKey:
        """The lab's public key, made if there is none.

        Raises
        ------
        KeyTrouble
        """
        return lab_key().public

    def repetition(self, print_id: str) -> Repetition:
        """Compare today with the print: what it would mean to print the same again.

        Raises
        ------
        NotFoundError
        RecordsError
            When the bytes that were printed aren't there any more.
        """
        plan = plan_repeat(self.entry(print_id))
        return Repetition(plan.entry.sha256, plan.differences, plan.unknown, plan.set_up)

    def repeat(self, print_id: str) -> NewJob:
        """Make a job of the same bytes; nothing is started.

        Raises
        ------
        NotFoundError
        RecordsError
            When the bytes that were printed aren't there any more.
        """
        folder = self._core.workspace.root / "jobs"
        return NewJob(f"file~{make_job(plan_repeat(self.entry(print_id)), folder).name}")

    def _trusted(self, key_pem: bytes) -> list[PublicKey]:
        if not key_pem.strip():
            own = known_lab_key()
            return [own] if own is not None else []
        try:
            return [read_public(key_pem, "the key")]
        except KeyTrouble as exc:
            raise BadRequestError(str(exc)) from exc


def _progress(entry: PrintEntry) -> Progress | None:
    if entry.journal.name != JOURNAL:
        return None
    with contextlib.suppress(LinkError, OSError):
        return read_print(entry.journal.parent).progress
    return None


def _running(entry: PrintEntry) -> PrintEntry:
    """Tell a print that is going on from one whose link process died."""
    latest = entry.journal.name == JOURNAL and entry.state == INTERRUPTED
    if latest and entry.journal.exists() and alive(entry.journal.parent):
        return replace(entry, state=RUNNING)
    return entry
