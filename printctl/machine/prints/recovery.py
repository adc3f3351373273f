"""Plan the rest of a job after a lost position: where it begins, G-code, steps for the operator.

Nothing here speaks to a printer. A person has to take the first steps, because only a person sees
where the needle stands; the file then comes from high above, over the point, down, primes, and goes
on with the job's own lines.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer
from gcode.reading import code_of, is_motion
from printctl.checks.made_for import header_lines, read_made_for
from printctl.machine.control.position.firmware import mode_lines
from printctl.machine.errors import LinkError
from printctl.machine.job.coordinates import (
    HOMING,
    JobFrame,
    Modal,
    Place,
    Spot,
    declared_axes,
    frame_at,
    modal_state,
    moves_of,
    relieved_mm,
)
from printctl.machine.job.dispensing import (
    all_raised,
    choose,
    head_at,
    is_about_heads,
    is_about_valve,
    lowered,
    pressures,
    reopen,
    shut,
)
from printctl.machine.job.job import GrownText, Job, grown_text, with_comment
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.job.retreat import Retreat, count_from
from printctl.machine.job.syringes import plunger_travel
from printctl.machine.records.journal import Record
from printctl.machine.records.replay import JournalledPrint

CLEARANCE_MM: Final = 5.0
TRAVEL_MM_S: Final = 20.0
_OPENING_BYTES: Final = 4096
"""Of a file, in which the record of its set-up stands."""
_PLACE_WORD: Final = re.compile(rb"(?P<begin> (?P<axis>[XYZ])=?)(?P<mm>[-\d.]+)(?= |$)")
_NO_SETUP: Final = frozenset(
    (b"G0", b"G1", b"G2", b"G3", b"G4", b"G10", b"G11", b"G28", b"G29", b"G92")
    + (b"M400", b"M105", b"M114", b"M73")
)


class NoCheckpoint(LinkError):  # noqa: N818
    """The journal doesn't tell where to begin: a person must.

    ``line`` of the file is the first whose move may not have been made; 0 where no move surely was.
    """

    def __init__(self, message: str, line: int = 0) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True)
class RestStart:
    """Job line at which the rest begins (``index`` are left out), and why there.

    ``at`` is where needle and plunger were, ``relieved_mm`` how far the job itself had drawn the
    plunger back; ``stood`` is what to say of a stop whose place in the job is known, else empty.
    """

    index: int
    why: str
    at: Modal
    relieved_mm: float
    stood: str = ""


@dataclass(frozen=True)
class Recovery:
    """Plan for continuing after a lost position.

    The ``gcode`` is a way to, and then, the rest of the job, whose first ``begin`` command lines
    aren't printed again; a person takes the ``steps`` before it. It takes the tip to stand at
    ``start``, mm, before its first line; None for a homed machine. ``rows`` are those of the job's
    file, from 0, of each of its last rows; -1 for what was put in.
    """

    begin: int
    gcode: bytes
    steps: tuple[str, ...]
    start: Place | None
    rows: tuple[int, ...] = ()


def plan_recovery(
    job: Job,
    data: bytes,
    history: JournalledPrint,
    printer: Printer,
    retreat: Retreat,
    from_line: int | None = None,
    ul_per_mm: float | None = None,
    start_mm: Place | None = None,
) -> Recovery:
    """Plan how to go on after the position was lost.

    From the last checkpoint whose lines had surely been moved, not only taken: the planner may have
    held some when the power went. ``data`` is the job's file; ``from_line`` of it is where to begin
    instead; ``ul_per_mm`` the ink of the plunger's travel, None where the syringe is unknown;
    ``start_mm`` where the checks took the tip to stand before the first line (`Care.start_mm`).
    Raises `NoCheckpoint` where a person must say where to begin, else `LinkError` where the job
    doesn't say where the needle is there.
    """
    start = beginning(job, history, printer, from_line)
    begin, at = start.index, start.at
    if start_mm is not None and not any(code_of(line) in HOMING for line in job.lines[:begin]):
        at = at.filled(dict(zip("xyz", start_mm, strict=True)))
        start = replace(start, at=at)
    if None in (at.x, at.y, at.z) or (at.e is None and not printer.pneumatic):
        raise LinkError(
            f"before line {job.file_lines[begin]} the job doesn't say where the needle and the "
            "plunger are; give a later line (--from-line)"
        )
    frame = frame_at(job, begin, printer, start_mm)
    shift = zip("xyz", frame.shift_at(begin - 1), strict=True)
    from_touch_off = replace(at, **{axis: at.place()[axis] - mm for axis, mm in shift})
    text = grown_text(job, data)
    way_in = _way_in(job, replace(start, at=from_touch_off), printer, retreat, frame)
    title, _, way_in = way_in.partition(b"\n")
    recorded = (f"; {line}".encode() for line in header_lines(read_made_for(data[:_OPENING_BYTES])))
    return Recovery(
        begin=begin,
        gcode=b"\n".join([title, *recorded, way_in + rest_lines(job, text, begin, frame)]),
        steps=(
            *manual_steps(printer, frame),
            *describe_rest(job, history, start, printer, ul_per_mm),
        ),
        start=frame.start,
        rows=tuple(text.file_row[text.row_of[begin] :]),
    )


def beginning(
    job: Job, history: JournalledPrint, printer: Printer, from_line: int | None
) -> RestStart:
    """Find where the rest begins: as given, where the printer stood, or behind a sure checkpoint.

    Raises `NoCheckpoint` where there is none, and no line was given; else `LinkError` where no line
    is left, or the one that was given isn't the job's.
    """
    if from_line is None and history.stood is not None:
        return _where_it_stood(job, history.stood)
    index, why = _line_to_begin(job, history, printer, from_line)
    return RestStart(index, why, modal_state(job.lines, index), relieved_mm(job.lines, index))


def _where_it_stood(job: Job, stood: Record) -> RestStart:
    """Go on with the line in whose middle a printer was stopped, or with one surely unmade."""
    index = int(stood["line"])
    if index >= len(job):
        raise LinkError("every line of the job was made before the print was stopped")
    at, line = modal_state(job.lines, index), job.file_lines[index]
    relieved = 0.0 if stood["dropped"] else relieved_mm(job.lines, index)
    if stood["begin_at"] is not None:
        at = Modal(**stood["begin_at"])
    if stood["certain"] and stood["begin_at"] is None:
        words = f"All lines before line {line} were made, and none after: nothing is written twice."
    elif stood["certain"]:
        words = (
            f"The printer was stopped at X{at.x:g} Y{at.y:g} Z{at.z:g}, on its way of line {line}: "
            "the file goes on with the rest of that line, so nothing is left out or written twice."
        )
    else:
        words = (
            f"The printer was stopped where more than one line passes, or at a place that the "
            f"journal can't tell exactly; line {line} is the first that may not have been made. "
            "Nothing is left out, but what follows may be written already: look at the part."
        )
    return RestStart(index, "where it was stopped", at, relieved, words)


def most_unmade(history: JournalledPrint, printer: Printer) -> float:
    """Return the most moves that were taken and not made.

    Infinite where the printer acknowledged all and didn't stand where the job ends.
    """
    last = history.checkpoint or {}
    if "compared" in last and not last["agrees"]:
        return math.inf
    return moves_ahead(printer)


def _line_to_begin(
    job: Job, history: JournalledPrint, printer: Printer, from_line: int | None
) -> tuple[int, str]:
    if from_line is not None:
        begin = bisect_left(job.file_lines, from_line)
        if not 0 < begin < len(job):
            raise LinkError(f"line {from_line} isn't between the job's first line and its last")
        return begin, "as asked"
    end = history.end or {}
    refused = end.get("refused")
    if refused and refused == end.get("made"):  # all lines before it were surely made
        return int(refused), "the printer refused it"
    made = surely_moved(job.lines, history.done, most_unmade(history, printer))
    sure = max(made, history.made)
    for record in reversed(history.checkpoints):
        if record["done"] <= sure and record["done"] < len(job):
            return record["done"], f"checkpoint, {record['mark']}"
    if not 0 < made < len(job):
        raise NoCheckpoint(
            f"{history.done} lines were acknowledged, and the journal has no checkpoint that tells "
            f"how many of them were made: look up in {job.name} the first line that isn't on the "
            "part, and give it as --from-line"
        )
    line = job.file_lines[made]
    raise NoCheckpoint(
        f"the journal has no checkpoint before line {job.file_line(sure)}; line {line} is the "
        "first whose move may not have been made: look at the part, and begin there or, where "
        "more is written, with a later line (--from-line)",
        line,
    )


def rest_lines(job: Job, text: GrownText, begin: int, frame: JobFrame) -> bytes:
    """Return the job's text from command line ``begin``, after what it last said of its height.

    What a line adds to the count of the touch-off is taken off its places, so that a line that
    calls a place otherwise (G92) names the place where the tip stands anyway.
    """
    lines, first = list(text.lines), text.row_of[begin]
    heights = (line for line in reversed(lines[:first]) if line.startswith(b";HEIGHT:"))
    for index in range(begin, len(job)) if frame.renamed else ():
        shift, row = frame.shift_at(index), text.row_of[index]
        if any(shift) and (is_motion(job.lines[index]) or declared_axes(job.lines[index])):
            lines[row] = with_comment(_moved(job.lines[index], shift), lines[row])
    return b"".join([next(heights, b""), *lines[first:]])


def _moved(line: bytes, shift: Place) -> bytes:
    """Take ``shift`` off the places that a line names as it is sent."""
    by = dict(zip((b"X", b"Y", b"Z"), shift, strict=True))

    def moved(word: re.Match[bytes]) -> bytes:
        value = b"%.5f" % (float(word["mm"]) - by[word["axis"]])
        return word["begin"] + value.rstrip(b"0").rstrip(b".") if by[word["axis"]] else word[0]

    return _PLACE_WORD.sub(moved, line)


def _way_in(
    job: Job, rest_start: RestStart, printer: Printer, retreat: Retreat, frame: JobFrame
) -> bytes:
    """Settings of the job so far; then up, across, down and prime.

    Pneumatic heads' valves are shut and their pressures at rest first of all; above the place the
    pressures are the job's again, and its valve is opened once the tip is in place. Of several
    heads all are raised, the job's is chosen, and lowered above its place.
    """
    begin, at = rest_start.index, rest_start.at
    head = head_at(job.lines, begin, printer)
    retreat = retreat.of_head(head)
    x, y, z, e = (float(value or 0.0) for value in (at.x, at.y, at.z, at.e))
    top = max(z, frame.top)
    touched_off = top if frame.start is None else frame.start[2]
    high = max(min(top + CLEARANCE_MM, printer.z_mm.high), top, touched_off)
    speed = printer.max_speed_mm_s
    level, rise = min(TRAVEL_MM_S, speed.x, speed.y), min(TRAVEL_MM_S, speed.z)
    commands = [*shut(printer), *_settings(job, begin, printer), *frame.lines]
    commands += all_raised(printer)
    if head is not None and not printer.airs:
        commands.append(choose(printer, head))
    if not printer.pneumatic:
        commands.append(count_from(retreat.relieved_e(e, rest_start.relieved_mm)))
    commands += [
        b"G0 Z%.4f F%.0f" % (high, rise * 60),
        b"G0 X%.4f Y%.4f F%.0f" % (x, y, level * 60),
        *pressures(job.lines, begin, printer),
        *lowered(job.lines, begin, printer),
        *retreat.rejoin(at, printer, retreat.prime_mm),
        *([b"M400"] if printer.airs else []),  # the rest may begin where a valve opens
        *reopen(job.lines, begin, printer),
    ]
    title = f"; rest of {job.name} (sha256 {job.sha256}) from its line {job.file_lines[begin]}"
    return b"\n".join([title.encode("ascii", "replace"), *commands]) + b"\n"


def _settings(job: Job, begin: int, printer: Printer) -> list[bytes]:
    """Modes, temperatures and the like as they stand, each as it was last given.

    The valve isn't one of them: it would open before the needle is in place. Nor are the heads'
    own commands; what sets one of several heads (``M218 T1``, ``G10 P1``) stands for itself.
    """
    last: dict[bytes, bytes] = {mode: mode for mode in mode_lines(printer)}
    for line in job.lines[:begin]:
        if is_about_valve(line, printer) or is_about_heads(line, printer):
            continue
        code, *words = line.split(b" ")
        letters = b"TD" if code[:1] == b"M" else b"P" if code == b"G10" else b""
        key = b""
        if printer.heads and words and words[0][:1] in letters and words[0][1:].isdigit():
            key = b" ".join([code, words[0]])
        elif code not in _NO_SETUP and not declared_axes(line):
            key = code
        if key:
            last.pop(key, None)  # the order in which they were last given
            last[key] = line
    return list(last.values())


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
            "Take the air's pressure off before that: the valve may stand open. Wipe the tip; let "
            "the air on again when the file runs, which shuts the valve first."
        )
    if frame.start is None:
        place = (
            "This job needs a homed machine. Home X and Y (G28 X Y) once the needle is above the "
            "dish and can't touch it. Don't home Z with the needle mounted: it would be driven "
            "into the dish; touch it off at a known height and tell it by G92 Z."
        )
    else:
        x, y, z = frame.start
        whose = f" of the first head ({printer.heads[0].name}), lowered," if printer.heads else ""
        place = (
            f"Don't home. Once it is clear of the dish, bring the tip{whose} back to the very "
            "place where it was touched off before the print, which the new file calls "
            f"X{x:g} Y{y:g} Z{z:g}: the rest is written as far beside the part as the tip is "
            "beside that place now."
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
    """Say from where the file goes on, and what may be written twice."""
    begin, done = rest_start.index, history.done
    first = job.file_lines[begin]
    steps = [f"The file begins with line {first} of {job.name} ({rest_start.why})."]
    head = head_at(job.lines, begin, printer)
    amount = describe_rewritten_ink(job, begin, done, head, ul_per_mm) if done > begin else ""
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
    if done > begin:
        amount = f" ({amount})" if amount else ""
        steps.append(
            f"Lines {first} to {job.file_line(done)}, and up to half a second more, were "
            f"taken after that and are perhaps written already{amount}: they "
            "would be written twice. Look at the part; to begin later, give --from-line"
            + _later(job, done)
            + "."
            + _through_vessels(job, history, begin, printer)
        )
    return tuple(steps)


def _through_vessels(job: Job, history: JournalledPrint, begin: int, printer: Printer) -> str:
    """Say of a print of vessels how the needle passes through the least of its fresh ink."""
    if not job.marks.of(MarkKind.VESSEL):
        return ""
    words = " Vessels that are written twice are passed through by the needle."
    made = surely_moved(job.lines, history.done, moves_ahead(printer), history.made)
    if not begin < made < len(job):
        return words
    return (
        f"{words} It does so least with --from-line {job.file_lines[made]}, the first line whose "
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


def describe_rewritten_ink(
    job: Job, first: int, last: int, head: int | None = None, ul_per_mm: float | None = None
) -> str:
    """Describe how much ink lines ``first`` to ``last`` - 1 write; empty for none.

    Of several heads ``head`` is the one in use. ``ul_per_mm`` is the ink of the plunger's travel,
    µL/mm; None where the syringe is unknown.
    """
    travel = plunger_travel(job.lines, head)
    pushed = max(travel[first : last + 1]) - travel[first]
    any_plunger = any(travel)  # else all moves count
    path = sum(
        move.path_mm
        for move in moves_of(job.lines, first, last, Spot.of(modal_state(job.lines, first)))
        if travel[move.line + 1] > travel[move.line] or not any_plunger
    )
    if path <= 0 and pushed <= 0:
        return ""
    plunger = f"{pushed:.3f} mm of plunger"
    ink = plunger if ul_per_mm is None else f"{pushed * ul_per_mm:.2f} µL ({plunger})"
    amount = f"{path:.1f} mm of path" + (f" and {ink}" if pushed > 0 else "")
    return f"at most {amount}, lines {job.file_lines[first]} to {job.file_line(last)}"
