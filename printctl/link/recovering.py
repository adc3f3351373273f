"""After the printer has lost its position: the rest of a job as a file of its own.

Nothing here speaks to a printer. What a person has to do first is told as steps, because only a
person sees where the needle stands; the file then comes from high above, over the point, down,
primes, and goes on with the job's own lines.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from printctl.link.errors import LinkError
from printctl.link.firmware import modes
from printctl.link.heads import all_raised, choose, head_at, is_about_heads, lowered
from printctl.link.job import Job
from printctl.link.job_frame import JobFrame, frame_at
from printctl.link.journal import History, Record
from printctl.link.made import surely_moved
from printctl.link.marks import MarkKind
from printctl.link.modal import Modal, modal_state, places_told, relieved_mm
from printctl.link.retreat import Retreat, count_from
from printctl.link.valve import is_about_valve, reopen, shut
from printctl.link.written_twice import written_twice
from sim.reading import code_of

CLEARANCE_MM: Final = 5.0
TRAVEL_MM_S: Final = 20.0
_NO_SETUP: Final = frozenset(
    (b"G0", b"G1", b"G2", b"G3", b"G4", b"G10", b"G11", b"G28", b"G29", b"G92")
    + (b"M400", b"M105", b"M114", b"M73")
)


class NoCheckpoint(LinkError):  # noqa: N818
    """The journal doesn't tell where to begin: a person must."""


@dataclass(frozen=True)
class Recovery:
    """How to go on.

    Attributes
    ----------
    begin : int
        Command lines of the job that aren't printed again.
    gcode : bytes
        The rest of the job, with a way to it.
    steps : tuple of str
        What a person does first, in order.
    start : (x, y, z) or None, mm
        Where the file takes the tip to stand before its first line; None for a homed machine.
    """

    begin: int
    gcode: bytes
    steps: tuple[str, ...]
    start: tuple[float, float, float] | None


def plan_recovery(
    job: Job,
    data: bytes,
    history: History,
    printer: Printer,
    retreat: Retreat,
    from_line: int | None = None,
    ul_per_mm: float | None = None,
    start_mm: tuple[float, float, float] | None = None,
) -> Recovery:
    """Plan how to go on after the position was lost.

    From the last checkpoint whose lines had surely been moved, not only taken: the planner may
    have held some when the power went.

    Parameters
    ----------
    job : Job
    data : bytes
        The job's file.
    history : History
    printer : Printer
    retreat : Retreat
        How the plunger is primed.
    from_line : int, optional
        Line of the file to begin with instead.
    ul_per_mm : float, µL/mm, optional
        Ink of the plunger's travel; None where nobody knows the syringe.
    start_mm : (x, y, z) or None, mm
        Where the checks took the tip to stand before the first line (`Care.start_mm`).

    Raises
    ------
    NoCheckpoint
        When there is no checkpoint, and no line was given.
    LinkError
        When the job doesn't say where the needle is there.
    """
    found = _beginning(job, history, printer, from_line)
    begin, at = found.index, found.at
    if None in (at.x, at.y, at.z) or (at.e is None and not printer.pneumatic):
        raise LinkError(
            f"before line {job.file_lines[begin]} the job doesn't say where the needle and the "
            "plunger are; give a later line (--from-line)"
        )
    frame = frame_at(job, begin, start_mm)
    gcode = _way_in(job, found, printer, retreat, frame) + _rest(job, data, begin)
    steps = (
        *_by_hand(job, printer, frame.start),
        *_what_is_there(job, history, found, printer, ul_per_mm),
    )
    return Recovery(begin, gcode, steps, frame.start)


@dataclass(frozen=True)
class _Beginning:
    """Where the rest begins.

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


def _where_it_stood(job: Job, stood: Record) -> _Beginning:
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
    return _Beginning(index, "where it was stopped", at, relieved, told)


def _beginning(job: Job, history: History, printer: Printer, from_line: int | None) -> _Beginning:
    if from_line is None and history.stood is not None:
        return _where_it_stood(job, history.stood)
    index, why = _line_to_begin(job, history, printer, from_line)
    return _Beginning(index, why, modal_state(job.lines, index), relieved_mm(job.lines, index))


def _line_to_begin(
    job: Job, history: History, printer: Printer, from_line: int | None
) -> tuple[int, str]:
    if from_line is not None:
        begin = bisect_left(job.file_lines, from_line)
        if not 0 < begin < len(job):
            raise LinkError(f"line {from_line} isn't between the job's first line and its last")
        return begin, "as asked"
    refused = _refused(history)
    if refused is not None:
        return refused, "the printer refused it"
    queued = printer.planner_blocks + printer.command_queue
    sure = surely_moved(job.lines, history.done, queued)
    for record in reversed(history.checkpoints):
        if record["done"] <= sure and record["done"] < len(job):
            return record["done"], f"checkpoint, {record['mark']}"
    raise NoCheckpoint(
        f"the journal has no checkpoint before line {job.file_line(sure)}, up to which the moves "
        "were surely made; look at the part and give --from-line"
    )


def _refused(history: History) -> int | None:
    """Lines before the one that the printer refused, if all of those were surely made."""
    end = history.end or {}
    refused = end.get("refused")
    return refused if refused and refused == end.get("made") else None


def _way_in(
    job: Job,
    found: _Beginning,
    printer: Printer,
    retreat: Retreat,
    frame: JobFrame,
) -> bytes:
    """Settings of the job so far; then up, across, down and prime.

    A pneumatic head's valve is shut first of all, and opened once the tip is in place. Of several
    heads all are raised, the job's is chosen, and lowered above its place.
    """
    begin, at = found.index, found.at
    head = head_at(job.lines, begin) if printer.heads else None
    retreat = retreat.of_head(head)
    x, y, z, e = (float(value or 0.0) for value in (at.x, at.y, at.z, at.e))
    shift = frame.shift[2]
    top = max(z - shift, frame.top)
    touched_off = top if frame.start is None else frame.start[2]
    high = max(min(top + CLEARANCE_MM, printer.z_mm.high), top, touched_off) + shift
    speed = printer.max_speed_mm_s
    level, rise = min(TRAVEL_MM_S, speed.x, speed.y), min(TRAVEL_MM_S, speed.z)
    commands = [*shut(printer), *_settings(job, begin, printer, frame.lines)]
    if head is not None:
        commands += [*all_raised(printer), choose(printer, head)]
    if not printer.pneumatic:
        commands.append(count_from(retreat.relieved_e(e, found.relieved_mm)))
    opens = reopen(job.lines, begin, printer)
    commands += [
        b"G0 Z%.4f F%.0f" % (high, rise * 60),
        b"G0 X%.4f Y%.4f F%.0f" % (x, y, level * 60),
        *lowered(printer, head),
        *retreat.rejoin(at, printer, retreat.prime_mm),
        *([b"M400"] if opens else []),
        *opens,
    ]
    title = f"; rest of {job.name} (sha256 {job.sha256}) from its line {job.file_lines[begin]}"
    return b"\n".join([title.encode("ascii", "replace"), *commands]) + b"\n"


def _settings(
    job: Job, begin: int, printer: Printer, placed: tuple[bytes, ...] = ()
) -> list[bytes]:
    """Modes, temperatures and the like as they stand, each as it was last given; then ``placed``.

    The valve isn't one of them: it would open before the needle is in place. Nor are the heads'
    own commands; what is told of each head stands for itself.
    """
    last: dict[bytes, bytes] = {mode: mode for mode in modes(printer)}
    for line in job.lines[:begin]:
        if is_about_valve(line, printer) or is_about_heads(line, printer):
            continue
        of_head = _told_of_head(line) if printer.heads else b""
        if of_head:
            last.pop(of_head, None)
            last[of_head] = line
        elif code_of(line) not in _NO_SETUP and not places_told(line):
            word = code_of(line)
            last.pop(word, None)  # the order in which they were last given
            last[word] = line
    return [*last.values(), *placed]


def _told_of_head(line: bytes) -> bytes:
    """What is told of one of several heads: ``M218 T1``, ``G10 P1``; empty for any other line."""
    code, *words = line.split(b" ")
    letters = b"TD" if code[:1] == b"M" else b"P" if code == b"G10" else b""
    told = len(words) > 1 and words[0][:1] in letters and words[0][1:].isdigit()
    return b" ".join([code, words[0]]) if told else b""


def _rest(job: Job, data: bytes, begin: int) -> bytes:
    lines = data.splitlines(keepends=True)
    return b"".join(lines[job.file_lines[begin] - 1 :])


def _by_hand(
    job: Job, printer: Printer, start: tuple[float, float, float] | None
) -> tuple[str, ...]:
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
    if start is None:
        place = (
            "This job needs a homed machine. Home X and Y (G28 X Y) once the needle is above the "
            "dish and can't touch it. Don't home Z with the needle mounted: it would be driven "
            "into the dish; touch it off at a known height and tell it by G92 Z."
        )
    else:
        x, y, z = start
        place = (
            "Don't home. Once it is clear of the dish, bring the tip back to the very place where "
            f"it was touched off before the print, which the job calls X{x:g} Y{y:g} Z{z:g}: the "
            "rest is written as far beside the part as the tip is beside that place now."
        )
    limits = (
        f"Check that the path is free at the height of the file's first move; Z ends at "
        f"{printer.z_mm.high:g} mm."
    )
    if printer.pneumatic:
        return plunger, lift, place, limits
    return lift, place, plunger, limits


def _what_is_there(
    job: Job, history: History, found: _Beginning, printer: Printer, ul_per_mm: float | None
) -> tuple[str, ...]:
    """From where the file goes on, and what may be written twice."""
    begin = found.index
    first = job.file_lines[begin]
    steps = [f"The file begins with line {first} of {job.name} ({found.why})."]
    head = head_at(job.lines, begin) if printer.heads else None
    amount = (
        written_twice(job, begin, history.done, head, ul_per_mm) if history.done > begin else ""
    )
    if found.stood:
        unsure = history.stood is not None and not history.stood["certain"]
        twice = f" Written twice may be {amount}." if unsure and amount else ""
        return (*steps, found.stood + twice)
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
        )
    return tuple(steps)


def _later(job: Job, done: int) -> str:
    marks = [job.marks.next(kind, done) for kind in (MarkKind.LAYER, MarkKind.VESSEL)]
    found = [
        f" {job.file_lines[mark.index]} (after the {mark})"
        for mark in marks
        if mark is not None and mark.index < len(job)
    ]
    return ", such as" + " or".join(found) if found else ""
