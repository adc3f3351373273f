"""Progress of a running job: lines accepted, refused and surely executed; commanded position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from printctl.machine.control.board.standstill import Standstill, StandstillWatch, is_unbounded
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.job.coordinates import Modal, ModalTrail, modal_state, relieved_mm
from printctl.machine.job.dispensing import head_at
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.moves import (
    Answers,
    MotorRunOn,
    longest_run_on,
    moves_ahead,
    planned_moves,
    planned_s,
    surely_moved,
)
from printctl.machine.job.stop_place import StopPlace, find_stop_line

_BEFORE: Final = 4
"""Lines before the first move under way, which is entered at a speed that they decide."""
MAX_LEFT_S: Final = 600.0
"""More than a planner holds: a move comes from a place that isn't known."""
_MAX_LINES_AHEAD: Final = 64
"""Lines looked back for moves: more than a planner holds."""


class JobProgress:
    """How far a job is; what counts as made is never more than is true."""

    def __init__(self, wiring: Wiring, job: Job) -> None:
        self.job = job  # with what was put in so far
        self._wiring, self._protocol, self._printer = wiring, wiring.protocol, wiring.printer
        self._trail = ModalTrail(job.lines)
        # something that wasn't sent was answered: compare the position before the job goes on
        self.unverified = False
        self.foreign = 0  # answers beyond those to the host's lines, on a wire without errors
        self.doubled: list[int] = []  # job lines, one-based, that may have been made twice
        self.meddled = False  # such came since the firmware's settings were last compared
        # job lines taken and made as the journal knows, until a printer that is found again has
        # proved to be the print's own
        self.journalled: tuple[int, int] | None = None
        self.standstills = StandstillWatch(wiring.printer, job.lines)
        self.refused: int | None = None  # job lines before the one that the printer refused
        self.about_command = False  # by words about a command, not by the printer's own fault
        self._answers = Answers(0, 0.0, 0, 0.0)
        self._ahead = moves_ahead(wiring.printer)
        self._sure = self._compared = 0
        self.dropped = False  # moves that the printer held; for good
        self.was_reset = False  # its motors and heaters are off

    @property
    def done(self) -> int:
        """Job lines that were taken, and not refused: none behind a refused one counts."""
        done = self._protocol.lines_done
        return done if self.refused is None else min(done, self.refused)

    @property
    def known(self) -> tuple[int, int]:
        """Job lines taken, and those of them surely made, as far as they are proved."""
        return self.journalled or (self.done, self.executed(self.done))

    @property
    def taken(self) -> list[bytes]:
        """The lines that were taken."""
        return self.job.lines[: self.done]

    def executed(self, done: int) -> int:
        """Return how many of ``done`` lines have certainly been made; any thread may ask."""
        made = surely_moved(self.job.lines, done, self._ahead, self._sure)
        self._sure = max(self._sure, made)
        return made

    def words(self) -> str:
        """Return how far the job is, for a message."""
        if not len(self.job):
            return "no print was running"
        done = self.known[0]
        file_line = self.job.file_line(done)
        return f"{done} of {len(self.job)} lines were acknowledged (line {file_line} of the file)"

    # --- where the job's text says that needle and plunger are -----------------------------------

    def modal(self) -> Modal:
        """Return the coordinates after the lines that were taken; the streamer's thread alone."""
        return self._trail.at(self.done)

    def heights(self) -> list[float]:
        """Return the needle's heights after each line that may not have been made yet, mm."""
        heights = self._each_after(self.executed(self.done), self._protocol.lines_done)
        return [at.z for at in heights if at.z is not None]

    def places_under_way(self) -> list[dict[str, float]]:
        """Return the places between which the motors may be, mm, by `Modal`'s names."""
        done = self.done
        first = max(self.executed(done), done - _MAX_LINES_AHEAD)
        return [at.place() for at in self._each_after(first, done)]

    def _each_after(self, first: int, last: int) -> list[Modal]:
        """Coordinates after ``first`` lines, one more each, to ``last``; any thread may ask."""
        trail = ModalTrail(self.job.lines)
        return [trail.at(k) for k in range(first, last + 1)]

    def stood(self, place: Modal) -> StopPlace:
        """Return with which line it can be gone on after the moves ahead were dropped."""
        done = self.done
        return find_stop_line(self.job.lines, self.executed(done), done, place)

    def run_on(self, now: float) -> MotorRunOn | None:
        """Return how far motors may run on, halted at ``now``; None where the job doesn't tell.

        Moves in flight are among those under way: an arc is answered when all but its end was made.
        """
        lines, done = self.job.lines, self.done
        sure = max(self.executed(done), done - _MAX_LINES_AHEAD)
        first, end = max(sure - _BEFORE, 0), done + self._printer.lines_in_flight
        at = modal_state(lines, first)
        moves = planned_moves(lines, first, min(end, len(lines)), at, self._printer)
        return longest_run_on(moves, sure, self._answers, now, self._printer) if moves else None

    def left_s(self) -> float | None:
        """Return how long motors go on at most with what was taken or sent; None for unknown."""
        lines, done = self.job.lines, self.done
        first = max(self.executed(done), done - _MAX_LINES_AHEAD)
        end = min(done + self._printer.lines_in_flight, len(lines))
        if is_unbounded(lines, first, end):
            return None
        at = modal_state(lines, max(first, 0))
        seconds = planned_s(lines, first, end, at, self._printer)
        return None if seconds > MAX_LEFT_S else seconds

    @property
    def head(self) -> int | None:
        """The head that the job has in use; None where there is one alone, or none was chosen."""
        return head_at(self.job.lines, self.done, self._printer)

    @property
    def relieved_mm(self) -> float:
        """How far the job itself has drawn the plunger back just here, mm."""
        return relieved_mm(self.job.lines, self.done)

    def grow(self, job: Job) -> None:
        """Take the job with lines put in behind those that were taken; the printer stands still."""
        self.job = job  # with what was put in so far
        self._trail.grow(job.lines)
        self.standstills.grow(job.lines)

    # --- what was taken and made -----------------------------------------------------------------

    def restore(self, done: int, made: int) -> None:
        """Set the lines taken and surely made before the host died."""
        self._sure, self._compared = max(self._sure, made), made
        self.journalled = done, self.executed(done)

    def answered(self, lines: int, now: float) -> None:
        """Record that ``lines`` of the job were taken by ``now``, s."""
        self._answers = Answers(self._answers.last, self._answers.last_s, lines, now)
        self.standstills.answered(lines, now, self._protocol.line_errors)

    def caught_up(self, now: float) -> None:
        """Record for standstills alone the lines that are taken by ``now``, s."""
        self.standstills.answered(self._protocol.lines_done, now, self._protocol.line_errors)

    def stands_still(self) -> None:
        """Record that the printer has made all that it took."""
        if not self.dropped:
            self._sure = self.done
        self.leaves()

    def leaves(self) -> None:
        """Record that the machine stands, or that what comes leads the needle away."""
        now, protocol = self._wiring.exchange.now_s, self._protocol
        self.standstills.rest(protocol.lines_done, now, protocol.line_errors)

    def compared(self) -> None:
        """Record that the printer stands, at the place where the lines taken lead."""
        self._compared = self.done

    def stopped_at(self, stop_place: StopPlace) -> None:
        """Record where the printer stood: the lines before a certain place were made."""
        if stop_place.certain:
            self._sure = max(self._sure, stop_place.line)

    def moves_dropped(self) -> None:
        """Record that the printer has dropped the moves that it held: no more will be made."""
        self.dropped = True
        self.standstills.drop(self._wiring.exchange.now_s)

    def reset(self) -> None:
        """Record that the printer was reset."""
        self.moves_dropped()
        self.was_reset = True

    def not_made(self) -> None:
        """Record that the printer acknowledged moves and didn't make them all.

        Made are those before the last place that was compared and found right.
        """
        self._ahead, self._sure, self.dropped = math.inf, self._compared, True

    def went_back(self) -> None:
        """Record that lines weren't taken after all: what is there must be verified."""
        self._sure, self._compared = min(self._sure, self.done), min(self._compared, self.done)
        self.unverified = True

    # --- standstills -----------------------------------------------------------------------------

    def stood_without_host(self, seconds: float) -> None:
        """Record that the print is gone on with; no host spoke to the printer for so long."""
        self.standstills.without_host(self.done, seconds)

    def overdue(self) -> bool:
        """Whether the line in flight would be answered by now, by plan."""
        return self.standstills.overdue(self._wiring.exchange.now_s)

    def all_made(self) -> bool:
        """Whether all that was sent has ended by plan, though nothing says so."""
        return self.standstills.all_made(self._wiring.exchange.now_s)

    def standing_words(self) -> str:
        """Return for how long and where the motors stand by plan; empty where it doesn't tell."""
        one = self.standstills.standing(self._wiring.exchange.now_s)
        return (
            (f"according to the plan its motors stopped {self.standstill_words(one)}")
            if one
            else ""
        )

    def standstill_words(self, one: Standstill) -> str:
        """Return for how long and where the ink stood, for a message."""
        ways = [
            " ".join(f"{k.upper()}{v:.2f}" for k, v in at.place().items() if k in "xyz")
            for at in (self._each_after(line, line)[0] for line in (one.line, one.last))
        ]
        marks = [self.job.marks.next(kind, one.line) for kind in (MarkKind.LAYER, MarkKind.VESSEL)]
        parts = [str(mark).removeprefix("end of ") for mark in marks if mark and mark.number >= 0]
        where = ", ".join(filter(None, [ways[1], *parts]))
        place = f"line {self.job.file_line(one.last)}" + (f" ({where})" if where else "")
        if one.last == one.line:
            return f"for {one.seconds:.1f} s at {place}"
        before = f"line {self.job.file_line(one.line)}" + (f" ({ways[0]})" if ways[0] else "")
        return f"for {one.seconds:.1f} s between the end of {before} and that of {place}"

    # --- refused lines, other programs -----------------------------------------------------------

    def refuse(self, line: int, about_command: bool = False) -> bool:
        """Record that line ``line`` of the job was refused; return False where one was before.

        ``about_command``: by words about a command; else by the printer's own fault.
        """
        first = self.refused is None and line > 0
        if first:
            self.refused, self.about_command = line - 1, about_command
        return first

    def behind_refused(self) -> Modal | None:
        """Return where the line that was refused leads to, if none was sent after it; else None."""
        if self.refused is None or self._protocol.lines_done != self.refused + 1:
            return None
        return modal_state(self.job.lines, self.refused + 1)

    def not_refused(self) -> None:
        """Record that the refused line was carried out, and all before it."""
        self.refused = None
        self.stands_still()

    def count_foreign(self, answers: int) -> None:
        """Record answers to lines that the host didn't write."""
        self.foreign += answers
        self.meddled = True

    def doubled_words(self) -> str:
        """Return what to say of lines that may have been made twice; empty for none."""
        lines = sorted({self.job.file_line(line) for line in self.doubled})
        if not lines:
            return ""
        many = "line" if len(lines) == 1 else "lines"
        return f"{many} {', '.join(map(str, lines))} may have been executed twice; inspect the part"

    def foreign_words(self) -> str:
        """Return what to say of lines that others wrote; empty for none."""
        if not self.foreign:
            return ""
        many = "1 reply" if self.foreign == 1 else f"{self.foreign} replies"
        return f"another program or noise wrote to this printer: {many} more than lines sent"


@dataclass(frozen=True)
class Pace:
    """Last time at which a print's pace and settings were compared."""

    since: int = 0  # job lines taken by then
    since_s: float = 0.0
    errors: int = 0  # lines sent again by then
