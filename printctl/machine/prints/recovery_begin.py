"""Find the job line to restart from after a lost printer position: checkpoint or stop place."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass

from firmware_profiles import Printer
from printctl.machine.errors import LinkError
from printctl.machine.job.job import Job
from printctl.machine.job.modal import Modal, modal_state, relieved_mm
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.records.journal import Record
from printctl.machine.records.journalled_print import JournalledPrint


class NoCheckpoint(LinkError):  # noqa: N818
    """The journal doesn't tell where to begin: a person must.

    Attributes
    ----------
    line : int
        Of the file, the first whose move may not have been made; 0 where no move surely was.
    """

    def __init__(self, message: str, line: int = 0) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True)
class RestStart:
    """Job line and position at which the rest begins.

    Attributes
    ----------
    index : int
        Command lines left out.
    why : str
    at : Modal
        Where needle and plunger were.
    relieved_mm : float
        How far the job itself had drawn the plunger back there.
    stood : str
        What is told of a stop whose place in the job was found; else empty.
    """

    index: int
    why: str
    at: Modal
    relieved_mm: float
    stood: str = ""


def _where_it_stood(job: Job, stood: Record) -> RestStart:
    """Go on with the line in whose middle a printer was stopped, or with one that is surely open.

    Raises
    ------
    LinkError
        Where no line is left.
    """
    index = int(stood["line"])
    if index >= len(job):
        raise LinkError("every line of the job was made before the print was stopped")
    at, relieved = modal_state(job.lines, index), relieved_mm(job.lines, index)
    line = job.file_lines[index]
    if stood["dropped"]:
        relieved = 0.0
    if stood["begin_at"] is not None:
        at = Modal(**stood["begin_at"])
    if stood["certain"] and stood["begin_at"] is None:
        told = f"All lines before line {line} were made, and none after: nothing is written twice."
    elif stood["certain"]:
        told = (
            f"The printer was stopped at X{at.x:g} Y{at.y:g} Z{at.z:g}, on its way of line {line}: "
            "the file goes on with the rest of that line, so nothing is left out or written twice."
        )
    else:
        told = (
            f"The printer was stopped where more than one line passes, or at a place that the "
            f"journal can't tell exactly; line {line} is the first that may not have been made. "
            "Nothing is left out, but what follows may be written already: look at the part."
        )
    return RestStart(index, "where it was stopped", at, relieved, told)


def most_unmade(history: JournalledPrint, printer: Printer) -> float:
    """Return the most moves that were taken and not made.

    Infinite where the printer acknowledged all and didn't stand where the job ends.
    """
    last = history.checkpoint or {}
    if "compared" in last and not last["agrees"]:
        return math.inf
    return moves_ahead(printer)


def beginning(
    job: Job, history: JournalledPrint, printer: Printer, from_line: int | None
) -> RestStart:
    """Find where the rest begins: as asked, where the printer stood, or behind a sure checkpoint.

    Raises
    ------
    NoCheckpoint
        When there is none, and no line was given.
    LinkError
        When no line is left, or the one that was given isn't the job's.
    """
    if from_line is None and history.stood is not None:
        return _where_it_stood(job, history.stood)
    index, why = _line_to_begin(job, history, printer, from_line)
    return RestStart(index, why, modal_state(job.lines, index), relieved_mm(job.lines, index))


def _line_to_begin(
    job: Job, history: JournalledPrint, printer: Printer, from_line: int | None
) -> tuple[int, str]:
    if from_line is not None:
        begin = bisect_left(job.file_lines, from_line)
        if not 0 < begin < len(job):
            raise LinkError(f"line {from_line} isn't between the job's first line and its last")
        return begin, "as asked"
    refused = _refused(history)
    if refused is not None:
        return refused, "the printer refused it"
    ahead = most_unmade(history, printer)
    sure = max(surely_moved(job.lines, history.done, ahead), history.made)
    for record in reversed(history.checkpoints):
        if record["done"] <= sure and record["done"] < len(job):
            return record["done"], f"checkpoint, {record['mark']}"
    raise _no_checkpoint(job, history, printer, sure)


def _no_checkpoint(job: Job, history: JournalledPrint, printer: Printer, sure: int) -> NoCheckpoint:
    """Return what tells a person where to begin, or what to look up."""
    made = surely_moved(job.lines, history.done, most_unmade(history, printer))
    if not 0 < made < len(job):
        return NoCheckpoint(
            f"{history.done} lines were acknowledged, and the journal has no checkpoint that tells "
            f"how many of them were made: look up in {job.name} the first line that isn't on the "
            "part, and give it as --from-line"
        )
    line = job.file_lines[made]
    return NoCheckpoint(
        f"the journal has no checkpoint before line {job.file_line(sure)}; line {line} is the "
        "first whose move may not have been made: look at the part, and begin there or, where "
        "more is written, with a later line (--from-line)",
        line,
    )


def _refused(history: JournalledPrint) -> int | None:
    """Lines before the one that the printer refused, if all of those were surely made."""
    end = history.end or {}
    refused = end.get("refused")
    return refused if refused and refused == end.get("made") else None
