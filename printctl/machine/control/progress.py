"""Progress of a running job: lines accepted, refused and surely executed; commanded position."""

from __future__ import annotations

from typing import Final

from printctl.machine.control.standstill import Standstill, StandstillWatch
from printctl.machine.control.wiring import Wiring
from printctl.machine.job.completed_moves import CompletedMoves
from printctl.machine.job.coordinates import Modal, ModalTrail, modal_state, relieved_mm
from printctl.machine.job.dispensing import head_at
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.motor_run_on import Answers, MotorRunOn, longest_run_on
from printctl.machine.job.planned_moves import planned_moves
from printctl.machine.job.stop_place import StopPlace, find_stop_line

_BEFORE: Final = 4
"""Lines before the first move under way, which is entered at a speed that they decide."""
_MOST_AHEAD: Final = 64
"""Lines looked back for moves: more than a planner holds."""


class JobProgress:
    """How far a job is.

    Parameters
    ----------
    wiring : Wiring
    job : Job

    Attributes
    ----------
    job : Job
        With what was put in so far.
    unverified : bool
        Whether something that nobody sent was answered, so that the position must be compared
        before the job goes on.
    foreign : int
        Answers of the printer beyond those to the host's lines, on a wire without errors.
    meddled : bool
        Whether such came since the firmware's settings were last compared.
    journalled : (int, int) or None
        Job lines taken and made as the journal knows, until a printer that is found again has
        proved to be the print's own; None from then on.
    standstills : StandstillWatch
    about_command : bool
        Whether a line was refused by words about a command, not by the printer's own fault.
    """

    def __init__(self, wiring: Wiring, job: Job) -> None:
        self.job = job
        self._protocol, self._printer = wiring.protocol, wiring.printer
        self._trail = ModalTrail(job.lines)
        self._made = CompletedMoves(job.lines, wiring.printer)
        self.unverified, self.foreign, self.meddled = False, 0, False
        self.journalled: tuple[int, int] | None = None
        self._answers = Answers(0, 0.0, 0, 0.0)
        self.standstills = StandstillWatch(wiring.printer)
        self._wiring = wiring
        self._refused: int | None = None
        self.about_command = False

    @property
    def done(self) -> int:
        """Job lines that were taken, and not refused: none behind a refused one counts."""
        done = self._protocol.lines_done
        return done if self._refused is None else min(done, self._refused)

    @property
    def known(self) -> tuple[int, int]:
        """Job lines taken, and those of them surely made, as far as they are proved."""
        return self.journalled or (self.done, self.executed(self.done))

    @property
    def refused(self) -> int | None:
        """Job lines before the one that the printer refused; None where it refused none."""
        return self._refused

    @property
    def taken(self) -> list[bytes]:
        """Those lines."""
        return self.job.lines[: self.done]

    def executed(self, done: int) -> int:
        """Return how many of ``done`` lines have certainly been made; any thread may ask."""
        return self._made.after(done)

    def words(self) -> str:
        """Return how far the job is, for a message."""
        if not len(self.job):
            return "no print was going on"
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
        first = max(self.executed(done), done - _MOST_AHEAD)
        return [at.place() for at in self._each_after(first, done)]

    def _each_after(self, first: int, last: int) -> list[Modal]:
        """Coordinates after ``first`` lines, one more each, to ``last``; any thread may ask."""
        trail = ModalTrail(self.job.lines)
        return [trail.at(k) for k in range(first, last + 1)]

    def stood(self, place: Modal) -> StopPlace:
        """Return with which line it can be gone on after the moves ahead were dropped."""
        done = self.done
        return find_stop_line(self.job.lines, self.executed(done), done, place)

    def stopped_at(self, stop_place: StopPlace) -> None:
        """Take notice of where the printer stood: the lines before a certain place were made."""
        if stop_place.certain:
            self._made.stood(stop_place.line)

    def run_on(self, now: float) -> MotorRunOn | None:
        """Return how far motors may run on, halted at ``now``; None where the job doesn't tell.

        Moves in flight are among those under way: an arc is answered when all but its end was made.
        """
        lines, done = self.job.lines, self.done
        sure = max(self.executed(done), done - _MOST_AHEAD)
        first, end = max(sure - _BEFORE, 0), done + self._printer.lines_in_flight
        at = modal_state(lines, first)
        moves = planned_moves(lines, first, min(end, len(lines)), at, self._printer)
        return longest_run_on(moves, sure, self._answers, now, self._printer) if moves else None

    @property
    def head(self) -> int | None:
        """The head that the job has in use; None where there is one alone, or none was chosen."""
        return head_at(self.job.lines, self.done) if self._printer.heads else None

    @property
    def relieved_mm(self) -> float:
        """How far the job itself has drawn the plunger back just here, mm."""
        return relieved_mm(self.job.lines, self.done)

    def grow(self, job: Job) -> None:
        """Take the job with lines put in behind those that were taken; the printer stands still."""
        self.job = job
        self._trail.grow(job.lines)
        self._made.grow(job.lines)

    # --- what the streamer learns ----------------------------------------------------------------

    def restore(self, done: int, made: int) -> None:
        """Set the lines taken and surely made before the host died."""
        self._made.stood(made)
        self._made.compare(made)
        self.journalled = done, self._made.after(done)

    def answered(self, lines: int, now: float) -> None:
        """Take notice that ``lines`` of the job were taken by ``now``, s."""
        self._answers = Answers(self._answers.last, self._answers.last_s, lines, now)
        self.standstills.answered(self.job.lines, lines, now, self._protocol.line_errors)

    def stands_still(self) -> None:
        """Take notice that the printer has made all that it took."""
        self._made.waited(self.done)
        self.leaves()

    def leaves(self) -> None:
        """Take notice that the machine stands, or that what comes leads the needle away."""
        protocol, now = self._protocol, self._wiring.clock.now()
        self.standstills.rest(self.job.lines, protocol.lines_done, now, protocol.line_errors)

    def stood_without_host(self, seconds: float) -> None:
        """Take notice that the print is gone on with; nobody spoke to the printer for so long."""
        self.standstills.without_host(self.job.lines, self.done, seconds)

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

    def standing_words(self) -> str:
        """Return for how long and where the motors stand by plan; empty where it doesn't tell."""
        one = self.standstills.standing(self.job.lines, self._wiring.clock.now())
        return f"by plan its motors have stood {self.standstill_words(one)}" if one else ""

    def overdue(self) -> bool:
        """Whether the line in flight would be answered by now, by plan."""
        return self.standstills.overdue(self.job.lines, self._wiring.clock.now())

    def all_made(self) -> bool:
        """Whether all that was sent has ended by plan, though nothing says so."""
        return self.standstills.all_made(self.job.lines, self._wiring.clock.now())

    def compared(self) -> None:
        """Take notice that the printer stands, at the place where the lines taken lead."""
        self._made.compare(self.done)

    def moves_dropped(self) -> None:
        """Take notice that the printer has dropped the moves that it held."""
        self._made.drop()

    def not_made(self) -> None:
        """Take notice that the printer acknowledged moves and didn't make them all."""
        self._made.doubt()

    def refuse(self, line: int, about_command: bool = False) -> bool:
        """Take notice that line ``line`` of the job was refused; False where one was before.

        ``about_command``: by words about a command; else by the printer's own fault.
        """
        first = self._refused is None and line > 0
        if first:
            self._refused, self.about_command = line - 1, about_command
        return first

    def behind_refused(self) -> Modal | None:
        """Return where the line that was refused leads to, if none was sent after it; else None."""
        if self._refused is None or self._protocol.lines_done != self._refused + 1:
            return None
        return modal_state(self.job.lines, self._refused + 1)

    def not_refused(self) -> None:
        """Take notice that the line was carried out, and all before it."""
        self._refused = None
        self.stands_still()

    def went_back(self) -> None:
        """Take notice that lines weren't taken after all: what is there must be verified."""
        self._made.back(self.done)
        self.doubt()

    def doubt(self) -> None:
        """Have the position compared before the job goes on."""
        self.unverified = True

    def count_foreign(self, answers: int) -> None:
        """Take notice of answers to lines that the host didn't write."""
        self.foreign += answers
        self.meddled = True

    def foreign_words(self) -> str:
        """Return what to say of lines that others wrote; empty for none."""
        if not self.foreign:
            return ""
        many = "1 answer" if self.foreign == 1 else f"{self.foreign} answers"
        return f"another program or noise wrote to this printer: {many} more than lines"

    def verified(self) -> None:
        """Take notice that the position is being compared."""
        self.unverified = False

    def taken_back(self) -> None:
        """Take notice that what others may have set is being taken back."""
        self.meddled = False
