"""Operator's instructions before a recovered print, after the printer lost its position."""

from __future__ import annotations

from firmware_profiles import Printer
from printctl.machine.job.frame import JobFrame
from printctl.machine.job.heads import head_at
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.prints.recovery_begin import RestStart
from printctl.machine.prints.written_twice import describe_rewritten_ink
from printctl.machine.records.journalled_print import JournalledPrint


def manual_steps(printer: Printer, frame: JobFrame) -> tuple[str, ...]:
    """Return what to do at the machine, in order: needle, place, plunger."""
    lift = (
        "Lift the needle out before anything else moves: straight up, by hand on the Z screw or "
        "by Z alone, until its tip is above the dish's wall. No X or Y before that: the needle "
        "would plough through the part."
    )
    plunger = "Leave the plunger as it is; wipe the tip, the file primes at the point."
    if printer.pneumatic:
        plunger = (
            "Take the air's pressure off before that: the valve may stand open. Wipe the tip; set "
            "the pressure again when the file runs, which shuts the valve first."
        )
    if frame.start is None:
        place = (
            "This job needs a homed machine. Home X and Y (G28 X Y) once the needle is above the "
            "dish and can't touch it. Don't home Z with the needle mounted: it would be driven "
            "into the dish; touch it off at a known height and tell it by G92 Z."
        )
    else:
        x, y, z = frame.start
        place = (
            "Don't home. Once it is clear of the dish, bring the tip back to the very place where "
            f"it was touched off before the print, which the new file calls X{x:g} Y{y:g} Z{z:g}: "
            "the rest is written as far beside the part as the tip is beside that place now."
        )
        if frame.renamed:
            place += (
                " The job calls places otherwise (G92); the new file counts all from there, as the "
                "checks of the print did."
            )
    limits = (
        f"Check that the path is free at the height of the file's first move; Z ends at "
        f"{printer.z_mm.high:g} mm."
    )
    if printer.pneumatic:
        return plunger, lift, place, limits
    return lift, place, plunger, limits


def describe_rest(
    job: Job,
    history: JournalledPrint,
    rest_start: RestStart,
    printer: Printer,
    ul_per_mm: float | None,
) -> tuple[str, ...]:
    """From where the file goes on, and what may be written twice."""
    begin = rest_start.index
    first = job.file_lines[begin]
    steps = [f"The file begins with line {first} of {job.name} ({rest_start.why})."]
    head = head_at(job.lines, begin) if printer.heads else None
    amount = (
        describe_rewritten_ink(job, begin, history.done, head, ul_per_mm)
        if history.done > begin
        else ""
    )
    if rest_start.stood:
        unsure = history.stood is not None and not history.stood["certain"]
        twice = f" Written twice may be {amount}." if unsure and amount else ""
        return (*steps, rest_start.stood + twice)
    refused = (history.end or {}).get("refused")
    if refused is not None and refused >= begin:
        words = job.lines[refused].decode("ascii", "replace")
        steps.append(
            f"The printer refused line {job.file_lines[refused]} ({words}): change it in "
            "the new file, or mend at the printer what it complained of, else it is refused again."
        )
    if history.done > begin:
        amount = f" ({amount})" if amount else ""
        steps.append(
            f"Lines {first} to {job.file_line(history.done)}, and up to half a second more, were "
            f"taken after that and are perhaps written already{amount}: they "
            "would be written twice. Look at the part; to begin later, give --from-line"
            + _later(job, history.done)
            + "."
            + _through_vessels(job, history, begin, printer)
        )
    return tuple(steps)


def _through_vessels(job: Job, history: JournalledPrint, begin: int, printer: Printer) -> str:
    """Tell a print of vessels how the needle passes through the least of its fresh ink."""
    if not job.marks.of(MarkKind.VESSEL):
        return ""
    told = " Vessels that are written twice are passed through by the needle."
    made = surely_moved(job.lines, history.done, moves_ahead(printer), history.made)
    if not begin < made < len(job):
        return told
    return (
        f"{told} It does so least with --from-line {job.file_lines[made]}, the first line whose "
        "move may not have been made; the needle comes down there where it stood when it wrote."
    )


def _later(job: Job, done: int) -> str:
    marks = [job.marks.next(kind, done) for kind in (MarkKind.LAYER, MarkKind.VESSEL)]
    later = [
        f" {job.file_lines[mark.index]} (after the {mark})"
        for mark in marks
        if mark is not None and mark.index < len(job)
    ]
    return ", such as" + " or".join(later) if later else ""
