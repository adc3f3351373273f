"""Determine the true state of a print from its journal and link process."""

from __future__ import annotations

import contextlib
import math
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_profiles import Syringe, load
from printctl.machine.job.care import Care
from printctl.machine.job.job import file_count
from printctl.machine.prints.actions import Possible, PrintAction, possible_actions
from printctl.machine.prints.alerts import Alert, alert_of
from printctl.machine.prints.inserted_ink import filling_in_file
from printctl.machine.prints.journal_facts import JournalledFacts, read_journal_facts
from printctl.machine.prints.print_words import (
    print_words,
    progress_words,
    state_words,
    tip_words,
)
from printctl.machine.prints.progress import Filling, Progress, predicted_s, progress
from printctl.machine.prints.remaining import Remaining
from printctl.machine.process.client import attach
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.states import LinkState, Status

if TYPE_CHECKING:
    from printctl.machine.prints.job_table import JobTable

TABLE = "progress.{}.npz"
"""A print's table, with the beginning of its job's hash."""


@dataclass(frozen=True)
class PrintTruth:
    """True state of a print.

    Attributes
    ----------
    folder : Path
    status : Status
        State, lines and message: of the link process while it lives, else what it left.
    journal : JournalledFacts
    progress : Progress or None
        By time, layer and ink; None until the job's table was made (the page does, and
        `printctl print`'s checks don't).
    actions : tuple of Possible
        Every action, possible or not.
    """

    folder: Path
    status: Status
    journal: JournalledFacts = field(default_factory=JournalledFacts)
    progress: Progress | None = None
    actions: tuple[Possible, ...] = ()

    @property
    def share(self) -> float:
        """How much of the print is made, 0 to 1: of its time where that is known, else of lines."""
        if self.progress is not None:
            return self.progress.share
        return self.status.lines_executed / max(self.status.lines_total, 1)

    @property
    def time_left_s(self) -> float | None:
        """Time left, s; None for a print that is over, or whose time isn't known."""
        if self.status.ended or self.progress is None:
            return None
        return self.progress.remaining_s

    @property
    def words(self) -> dict[str, str]:
        """State, what is made, time, layer, vessel, ink and tip as a person is told them."""
        made = progress_words(self.status, self.progress)
        state = f"{state_words(self.status.state).capitalize()} · {made.removesuffix(' made')}"
        tip = tip_words(self.status, self.progress, self.journal.stood_mm)
        return {"state": state, "made": made, "tip": tip, **print_words(self.status, self.progress)}

    @property
    def alert(self) -> Alert | None:
        """What somebody must know: an end that wasn't as meant, else the last alarm."""
        if not (self.status.ended or self.status.alarms):
            return None
        go_on = any(one.action is PrintAction.GO_ON and one.possible for one in self.actions)
        return alert_of(self.status, self.journal.last_alarm, go_on)

    def may(self, action: PrintAction) -> Possible:
        """Whether an action can be done now."""
        return next(one for one in self.actions if one.action is action)

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object: the same for page, API and command line."""
        return {
            **self.status.to_dict(),
            "folder": str(self.folder),
            "print_id": self.journal.print_id,
            "started": self.journal.started,
            "ended": self.status.ended,
            "last_alarm": self.journal.last_alarm,
            "alert": None if self.alert is None else asdict(self.alert),
            "share": self.share,
            "words": self.words,
            "time_left_s": self.time_left_s,
            "progress": None if self.progress is None else self.progress.to_dict(),
            "actions": [one.to_dict() for one in self.actions],
        }


def read_print(folder: Path) -> PrintTruth:
    """Tell what is true of the print in ``folder``; ask its link process if that lives.

    Raises
    ------
    NoLink
        When no print was ever started there, or its link process doesn't answer.
    """
    with attach(folder) as client:
        status = client.status
    journal = read_journal_facts(folder / JOURNAL)
    table = kept_table(folder, journal.sha256)
    if table is None or len(table) != file_count(status.lines_total, status.inserted):
        return assemble_state(folder, status, journal)
    remaining = remaining_of(table, journal)
    return assemble_state(folder, status, journal, table, remaining, filling_of(folder, journal))


def assemble_state(
    folder: Path,
    status: Status,
    journal: JournalledFacts,
    table: JobTable | None = None,
    remaining: Remaining | None = None,
    filling: Filling | None = None,
) -> PrintTruth:
    """Put a print's truth together from what was read of it."""
    actions = possible_actions(folder, status)
    if status.state is LinkState.INTERRUPTED:
        status = replace(status, message=f"{status.message}; {_next_step(actions)}")
    own = file_count(status.lines_total, status.inserted)  # a table is of the file's commands
    if table is None or remaining is None or len(table) != own:
        return PrintTruth(folder, status, journal, None, actions)
    now = time.time()
    active = journal.active_until(journal.heard_at if status.ended else now)
    done = file_count(status.lines_executed, status.inserted)
    at = predicted_s(table, done)
    if status.state is LinkState.PRINTING:
        remaining.saw(at, active)
    if filling is not None:
        filling = filling_in_file(filling, journal.inserts, status.lines_executed)
    made = progress(table, done, active, now, remaining.estimate(at), filling)
    return PrintTruth(folder, status, journal, made, actions)


def _next_step(actions: tuple[Possible, ...]) -> str:
    """Say what can be done after an interruption; promise nothing that would be refused."""
    by_action = {one.action: one for one in actions}
    if by_action[PrintAction.GO_ON].possible:
        return (
            "if the printer kept its power, Go on (`printctl resume`) asks it for its last line "
            "and goes on from there"
        )
    recover = by_action[PrintAction.RECOVER]
    ways = f"it can't be gone on with: {by_action[PrintAction.GO_ON].reason}"
    if recover.possible and "recover" not in ways.lower():
        ways += "; Recover (`printctl recover`) plans the rest as a job of its own"
    return ways


def remaining_of(table: JobTable, journal: JournalledFacts) -> Remaining:
    """Return the estimate of what is left, by the pace that the journal's checkpoints tell."""
    estimate = Remaining(float(table.time_s[-1]))
    positions = [(one.after, one.count) for one in journal.inserts]
    for done, active_s in journal.paces:
        estimate.saw(predicted_s(table, file_count(done, positions)), active_s)
    return estimate


def filling_of(folder: Path, journal: JournalledFacts) -> Filling | None:
    """Return the syringe in use; None where nobody knows it, as of several heads."""
    record: ContactRecord = load_record(folder)
    care = Care.from_dict(record.care)
    if care.head_capacity_mm or not care.syringe or not care.capacity_mm:
        return None
    with contextlib.suppress(Exception):  # a profile that is gone: the ink left isn't told
        bore = load(Syringe, care.syringe).inner_mm
        at, used, full = journal.filled or (0, care.used_mm, care.capacity_mm)
        return Filling(at, (full or care.capacity_mm) - used, math.pi / 4 * bore**2)
    return None


def kept_table(folder: Path, sha256: str) -> JobTable | None:
    """Return the table of the file that is printed in ``folder``, if somebody made it."""
    path = folder / TABLE.format(sha256[:16])
    if not path.is_file():
        return None
    from printctl.machine.prints.job_table import JobTable  # NumPy: most prints have no table

    try:
        return JobTable.load(path)
    except (OSError, ValueError, KeyError):
        return None


def keep_table(folder: Path, sha256: str, table: JobTable) -> None:
    """Leave a print's table beside its journal, for whoever tells of it; a full disk may refuse."""
    path = folder / TABLE.format(sha256[:16])
    if sha256 and not path.exists():
        with contextlib.suppress(OSError):
            table.save(path)
