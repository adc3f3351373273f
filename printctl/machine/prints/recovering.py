"""Plan the rest of a job after a lost position: G-code, approach moves, steps for the operator.

Nothing here speaks to a printer. What a person has to do first is told as steps, because only a
person sees where the needle stands; the file then comes from high above, over the point, down,
primes, and goes on with the job's own lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer
from printctl.machine.control.firmware import mode_lines
from printctl.machine.errors import LinkError
from printctl.machine.job.frame import JobFrame, Place, frame_at
from printctl.machine.job.heads import all_raised, choose, head_at, is_about_heads, lowered
from printctl.machine.job.job import Job
from printctl.machine.job.modal import HOMING, Modal, declared_axes
from printctl.machine.job.retreat import Retreat, count_from
from printctl.machine.job.valve import is_about_valve, reopen, shut
from printctl.machine.prints.grown_text import GrownText, grown_text
from printctl.machine.prints.recovery_begin import RestStart, beginning
from printctl.machine.prints.recovery_steps import describe_rest, manual_steps
from printctl.machine.records.journalled_print import JournalledPrint
from sim.gcode.reading import code_of, is_motion

# G-code of a job from a given line on, its coordinates counted from the touch-off point.


def rest_lines(job: Job, text: GrownText, begin: int, frame: JobFrame) -> bytes:
    """Return the job's text from command line ``begin``, after what it last said of its height.

    What a line adds to the count of the touch-off is taken off its places, so that a line that
    calls a place otherwise (G92) names the place where the tip stands anyway.
    """
    lines, first = list(text.lines), text.row_of[begin]
    said = (line for line in reversed(lines[:first]) if line.startswith(b";HEIGHT:"))
    for index in range(begin, len(job)) if frame.renamed else ():
        shift, row = frame.shift_at(index), text.row_of[index]
        if any(shift) and (is_motion(job.lines[index]) or declared_axes(job.lines[index])):
            _, semicolon, comment = lines[row].rstrip(b"\r\n").partition(b";")
            lines[row] = _moved(job.lines[index], shift) + semicolon + comment + b"\n"
    return b"".join([next(said, b""), *lines[first:]])


def _moved(line: bytes, shift: Place) -> bytes:
    """Take ``shift`` off the places that a line names as it is sent."""
    by = dict(zip((b"X", b"Y", b"Z"), shift, strict=True))
    code, *words = line.split(b" ")
    return b" ".join([code, *(_word(word, by.get(word[:1], 0.0)) for word in words)])


def _word(word: bytes, shift_mm: float) -> bytes:
    if not shift_mm:
        return word
    letter = word[:2] if word[1:2] == b"=" else word[:1]
    value = b"%.5f" % (float(word[len(letter) :]) - shift_mm)
    return letter + value.rstrip(b"0").rstrip(b".")


CLEARANCE_MM: Final = 5.0
TRAVEL_MM_S: Final = 20.0
_NO_SETUP: Final = frozenset(
    (b"G0", b"G1", b"G2", b"G3", b"G4", b"G10", b"G11", b"G28", b"G29", b"G92")
    + (b"M400", b"M105", b"M114", b"M73")
)


@dataclass(frozen=True)
class Recovery:
    """Plan for continuing after a lost position.

    Attributes
    ----------
    begin : int
        Command lines of the job that aren't printed again.
    line : int
        Of the job's file, from 1: the first that is.
    gcode : bytes
        The rest of the job, with a way to it.
    steps : tuple of str
        What a person does first, in order.
    start : (x, y, z) or None, mm
        Where the file takes the tip to stand before its first line; None for a homed machine.
    rows : tuple of int
        Row of the job's file, from 0, of each of the rest's last rows; -1 for what was put in.
    """

    begin: int
    line: int
    gcode: bytes
    steps: tuple[str, ...]
    start: tuple[float, float, float] | None
    rows: tuple[int, ...] = ()


def plan_recovery(
    job: Job,
    data: bytes,
    history: JournalledPrint,
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
    history : JournalledPrint
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
    start = beginning(job, history, printer, from_line)
    start = replace(start, at=_untouched(start.at, job.lines[: start.index], start_mm))
    begin, at = start.index, start.at
    if None in (at.x, at.y, at.z) or (at.e is None and not printer.pneumatic):
        raise LinkError(
            f"before line {job.file_lines[begin]} the job doesn't say where the needle and the "
            "plunger are; give a later line (--from-line)"
        )
    frame = frame_at(job, begin, printer, start_mm)
    there = replace(start, at=_counted(at, frame, begin))
    text = grown_text(job, data)
    rest = rest_lines(job, text, begin, frame)
    gcode = _way_in(job, there, printer, retreat, frame) + rest
    steps = (
        *manual_steps(printer, frame),
        *describe_rest(job, history, start, printer, ul_per_mm),
    )
    rows = tuple(text.file_row[text.row_of[begin] :])
    return Recovery(begin, job.file_lines[begin], gcode, steps, frame.start, rows)


def _untouched(
    at: Modal, before: Sequence[bytes], start_mm: tuple[float, float, float] | None
) -> Modal:
    """Fill in the place of the checks where no line ``before`` has moved or homed an axis."""
    if start_mm is None or any(code_of(line) in HOMING for line in before):
        return at
    return at.filled(dict(zip("xyz", start_mm, strict=True)))


def _counted(at: Modal, frame: JobFrame, begin: int) -> Modal:
    """Count a place before line ``begin`` from where the tip was touched off."""
    x, y, z = frame.shift_at(begin - 1)
    by = {"x": x, "y": y, "z": z}
    return replace(at, **{axis: at.place()[axis] - mm for axis, mm in by.items()})


def _way_in(
    job: Job,
    rest_start: RestStart,
    printer: Printer,
    retreat: Retreat,
    frame: JobFrame,
) -> bytes:
    """Settings of the job so far; then up, across, down and prime.

    A pneumatic head's valve is shut first of all, and opened once the tip is in place. Of several
    heads all are raised, the job's is chosen, and lowered above its place.
    """
    begin, at = rest_start.index, rest_start.at
    head = head_at(job.lines, begin) if printer.heads else None
    retreat = retreat.of_head(head)
    x, y, z, e = (float(value or 0.0) for value in (at.x, at.y, at.z, at.e))
    top = max(z, frame.top)
    touched_off = top if frame.start is None else frame.start[2]
    high = max(min(top + CLEARANCE_MM, printer.z_mm.high), top, touched_off)
    speed = printer.max_speed_mm_s
    level, rise = min(TRAVEL_MM_S, speed.x, speed.y), min(TRAVEL_MM_S, speed.z)
    commands = [*shut(printer), *_settings(job, begin, printer, frame.lines)]
    if head is not None:
        commands += [*all_raised(printer), choose(printer, head)]
    if not printer.pneumatic:
        commands.append(count_from(retreat.relieved_e(e, rest_start.relieved_mm)))
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
    last: dict[bytes, bytes] = {mode: mode for mode in mode_lines(printer)}
    for line in job.lines[:begin]:
        if is_about_valve(line, printer) or is_about_heads(line, printer):
            continue
        of_head = _told_of_head(line) if printer.heads else b""
        if of_head:
            last.pop(of_head, None)
            last[of_head] = line
        elif code_of(line) not in _NO_SETUP and not declared_axes(line):
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
