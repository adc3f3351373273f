"""Compare the position that the printer reports with the job's commanded position.

M114 is answered with the position that the last command taken leads to, not with where the motors
are: up to a planner's worth of moves may still be ahead of them. It says that what was taken was
taken as it was meant, and costs a line and its answer; the planner goes on meanwhile. Where the
motors themselves matter, M400 comes first and waits for them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NoReturn

from firmware_profiles.families.position_reply import parse_position, parse_shifted
from gcode.reading import is_motion, read_sent
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.position.firmware import RETRIES
from printctl.machine.control.position.frame_check import FrameCheck
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import (
    AXES,
    Modal,
    axes_placed,
    disagreement,
    mismatched_axes,
    modal_state,
)
from printctl.machine.job.dispensing import shut_and_wait
from printctl.machine.records.states import LinkState, PrintEnded

WITHIN_MM: Final = 0.011
"""Of the two decimals that M114 tells."""
MOVED: Final = "it was reset silently, or moved by something else"
"""Why a printer isn't where it was led to."""


@dataclass(frozen=True)
class Standstill:
    """Where a printer stands whose motors were stopped.

    ``at``: of two heights the upper one, so that a way out is never lowered.
    """

    at: Modal
    read: bool  # the printer's own word could be read; else it is the job's
    dropped: bool  # moves of the job weren't made
    place: Modal = field(default_factory=Modal)  # as reported, where the motors were stopped
    wrong: str = ""  # what of it can't be true, in words

    def words(self) -> str:
        """Return what to add to the message of the end."""
        if self.wrong:
            return f"; {self.wrong}: {MOVED}; nothing was moved"
        if not self.read:
            return "; its motors were stopped, and its position can't be read (M114)"
        if not self.dropped:
            return ""
        place = f"X{self.at.x:.2f} Y{self.at.y:.2f}"
        return f"; its motors were stopped at {place}, its queued moves weren't executed"


class PositionCheck:
    """Asks one printer where it is, and compares that with its job.

    ``frame`` finds whether another program has renamed the place.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._progress, self._printer = channel.logbook.progress, channel.wiring.printer
        self.frame = FrameCheck(channel)

    # --- where it is -----------------------------------------------------------------------------

    def expected(self, left: Mapping[str, float] | None = None) -> Steps[Modal]:
        """Return where the job's text says the printer is.

        What it doesn't say is taken from the place that the needle left for a pause, where there
        is one, else the printer is asked.
        """
        at = self._progress.modal().filled(left or {})
        asks_e = at.e is None and not self._printer.pneumatic
        if at.z is None or asks_e:
            position = parse_position((yield from self._channel.command(b"M114")))
            at = replace(
                at,
                z=position.get("Z") if at.z is None else at.z,
                e=position.get("E") if asks_e else at.e,
            )
        return at

    def actual(self) -> Steps[Modal]:
        """Return where the printer says it is, if that isn't the job's place.

        A way out begins there. The needle is never lowered: of two heights the upper one holds.
        """
        at = yield from self.expected()
        wrong, position = yield from self.compare(at)
        if not wrong or not position:
            return at
        if self._was_carried_out(position):
            return self._progress.modal()
        self._logbook.alarm(wrong)
        self._progress.moves_dropped()  # which lines led to where the job says is unknown
        z = position.get("Z") if at.z is None else max(at.z, position.get("Z", at.z))
        return replace(at, z=z, e=position.get("E", at.e))

    def _was_carried_out(self, position: Mapping[str, float]) -> bool:
        """Whether the line that seemed refused was carried out: the complaint wasn't of it."""
        progress = self._progress
        behind = progress.behind_refused()
        of_line = progress.about_command and not link_facts(self._printer).complains_to_all
        if behind is None or of_line or disagreement(behind, dict(position)):
            return False
        progress.not_refused()
        of = "another program's command" if progress.about_command else "a fault of its own"
        self._logbook.alarm(
            f"{progress.words()}, including the last one: the printer complained about {of}"
        )
        return True

    def height(self) -> Steps[float]:
        """Return the needle's height, mm; end the print where it can't be read."""
        position = yield from self._confirmed_position()
        if not position:
            yield from self._channel.commands(shut_and_wait(self._printer))
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                "the needle's position can't be read (M114), so it wasn't lowered; `printctl "
                "status` lists the next steps",
                known=False,
            )
        self._channel.led["Z"] = [position["Z"]]
        return position["Z"]

    def standing_away(self, counted: bool) -> Steps[Standstill]:
        """Return where the printer says it stands, away from the job's place.

        That is compared with where commands have led it; E where it is ``counted``. A motor that
        was stopped stands between two of those places.
        """
        position = yield from self._confirmed_position()
        words = {axis.lower(): value for axis, value in position.items() if axis in AXES}
        wrong = [
            f"{axis} is {position[axis]:.2f} mm where it was led to {places[-1]:.2f} mm"
            for axis, places in sorted(self._channel.led.items())
            if axis in position and (counted or axis != "E")
            if not min(places) - WITHIN_MM <= position[axis] <= max(places) + WITHIN_MM
        ]
        return Standstill(
            Modal(**words), read=bool(position), dropped=False, wrong=", ".join(wrong)
        )

    def refuse_elsewhere(
        self, x_mm: float | None, y_mm: float | None, lowest_mm: float | None
    ) -> Steps[None]:
        """End the print where the needle isn't above a place, before it is led from there.

        A printer that was reset without a word counts from another place, and would be led astray.
        """
        wrong, position = yield from self.compare(Modal(x=x_mm, y=y_mm))
        wrong = wrong.replace("the job says", "it was led to")
        lowest = -math.inf if lowest_mm is None else lowest_mm - WITHIN_MM
        if not wrong and position.get("Z", math.inf) < lowest:
            height = yield from self.height()
            if height < lowest:
                wrong = f"Z is {height:.2f} mm where it was left at {lowest_mm:.2f} mm or above"
        if wrong:
            yield from self.end_astray(f"{wrong}: {MOVED}" if position else wrong)

    def refuse_led_astray(self, counted: bool) -> Steps[None]:
        """End the print where it doesn't stand where it was led to, or that can't be read.

        Of a printer whose count of lines was set back: one that was reset without a word counts
        places from 0 as well. ``counted``: see `standing_away`.
        """
        standing = yield from self.standing_away(counted)
        if standing.wrong:
            yield from self.end_astray(f"{standing.wrong}: {MOVED}")
        if not standing.read:
            yield from self.end_astray("its position can't be read (M114)")

    def standstill(self) -> Steps[Standstill]:
        """Return where the printer stands after it dropped moves."""
        at, heights = self._progress.modal(), self._progress.heights()
        position = yield from self._confirmed_position()
        if not position:
            return Standstill(replace(at, z=max(heights, default=None)), read=False, dropped=True)
        z = position["Z"]
        wrong = ""
        if heights and not min(heights) - WITHIN_MM <= z <= max(heights) + WITHIN_MM:
            self._logbook.alarm(disagreement(Modal(z=at.z), position))
            # Z alone may be a line's that noise garbled; a printer that was reset is wrong in more
            wrong = disagreement(at, position) if self._beside_the_way(position) else ""
        x, y, e = position["X"], position["Y"], position.get("E")
        there = replace(at, x=x, y=y, z=max([z, *heights]), e=e)
        dropped = bool(disagreement(at, position))
        place = Modal(x=x, y=y, z=z, e=e)
        return Standstill(there, read=True, dropped=dropped, place=place, wrong=wrong)

    def _beside_the_way(self, position: Mapping[str, float]) -> bool:
        """Whether X or Y is none that the moves under way lead through, but for arcs' bulges."""
        under_way = self._progress.places_under_way()
        for axis in "xy":
            places = [place[axis] for place in under_way if axis in place]
            mm = position[axis.upper()]
            if places and not min(places) - WITHIN_MM <= mm <= max(places) + WITHIN_MM:
                return True
        return False

    def made(self) -> Steps[bool]:
        """Whether the motors stand where the job's last line leads: nothing is left to be dropped.

        M114 doesn't count the plunger's steps: not behind a line that moves it alone.
        """
        return (yield from self._stands_at(self._progress.modal()))

    def stopped(self) -> Steps[bool]:
        """Whether the motors stand at the place that the printer tells: it has dropped the rest.

        With moves ahead it would tell where they lead. As for `made`, of the plunger nothing is
        known behind a line that moves it alone.
        """
        return (yield from self._stands_at(Modal()))

    def _stands_at(self, at: Modal) -> Steps[bool]:
        moves = (line for line in reversed(self._progress.taken) if is_motion(line))
        last = read_sent(next(moves, b"")).words
        if not set("XYZ") & last.keys():
            return False
        return (yield from self.frame.stands_at(at))

    def _confirmed_position(self) -> Steps[dict[str, float]]:
        """Return the position reported twice running, as no checksum guards it; else empty."""
        position: dict[str, float] = {}
        for _ in range(RETRIES):
            before, position = position, parse_position((yield from self._channel.command(b"M114")))
            if set("XYZ") <= set(position) and position == before:
                return position
        return {}

    def plunger(self) -> Steps[float | None]:
        """Return the plunger's count reported twice running, mm; None where none is."""
        e: float | None = None
        for _ in range(RETRIES):
            before, (_, position) = e, (yield from self.compare(Modal()))
            e = position.get("E")
            if e is not None and e == before:
                return e
        return None

    # --- whether that is right -------------------------------------------------------------------

    def compare(self, at: Modal) -> Steps[tuple[str, dict[str, float]]]:
        """Ask for the position; return what disagrees with ``at`` (empty for nothing), and it.

        Of E of a printer that tells shifts (Klipper) it is what was pushed.
        """
        wrong = "its position can't be read (M114)"
        position: dict[str, float] = {}
        for _ in range(RETRIES):  # a reply may be garbled, where a line can't be
            if self.frame.tells_shifts:
                question = link_facts(self._printer).place_question
                replies = yield from self._channel.command(question)
                last = parse_shifted(replies)[0]
            else:
                replies = yield from self._channel.command(b"M114")
                last = parse_position(replies)
            position = last or position
            wrong = disagreement(at, position) if position else wrong
            if position and not wrong:
                break
        return wrong, position

    def missed_height(self, way: Sequence[bytes]) -> Steps[str]:
        """Return how far from its end a way out ended, which was acknowledged; '' for nothing."""
        wrong, position = yield from self.compare(Modal(z=modal_state(way, len(way)).z))
        return wrong.replace("the job says", "it was sent to") if position else ""

    def verify(self, at: Modal, mark: str = "", stands: bool = False) -> Steps[None]:
        """Compare position and job, write both down; end the print where they disagree.

        ``stands``: M400 was just answered, so that all that was taken is made.
        """
        wrong, position = yield from self.compare(at)
        if not wrong and (self._progress.meddled or (yield from self.frame.doubtful())):
            wrong = yield from self.frame.renamed()
        done = self._progress.done
        values: dict[str, str | bool] = {"mark": mark} if mark else {}
        values |= {"stands": True} if stands else {}
        self._logbook.record("checkpoint", done=done, position=position, agrees=not wrong, **values)
        if wrong:
            if stands:  # an M400 is also answered by a printer that lost its moves
                self._progress.not_made()
            yield from self.end_astray(wrong)
        if stands:
            self._progress.compared()

    def verify_in_passing(self) -> Steps[None]:
        """Compare positions between two lines; the planner isn't drained for it."""
        yield from self._channel.settle()
        self._progress.unverified = False
        yield from self.verify(self._progress.modal())

    def verify_end(self) -> Steps[str]:
        """Compare where the motors rest behind the last move with where the job ends.

        Return what to add to the message of the end where something can't be compared; raise
        `PrintEnded` where they disagree: the printer didn't make what it acknowledged.
        """
        progress, at = self._progress, self._progress.modal()
        progress.unverified = False
        wrong, position, by_steps = yield from self.frame.compare_end(at)
        if not position:
            words = "; end position not verified: the printer reports none (M114)"
        elif not set(position) & set(at.place_axes()):
            words = "; end position not verified: the job specifies none"
        elif not by_steps:
            words = (
                "; end position verified as reported, without motor steps: the printer doesn't "
                "report them per axis"
            )
        else:
            words = ""
        if position and not (self.frame.tells_shifts or self._printer.pneumatic):
            words += "; plunger position not verified"
        steps = f"position and steps{words}" if by_steps and position else words
        self._logbook.record(
            "checkpoint",
            done=progress.done,
            position=position,
            agrees=not wrong,
            stands=True,
            compared=steps.removeprefix("; "),
        )
        if wrong:
            progress.not_made()
            others = progress.foreign_words()
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                f"all {progress.done} lines were acknowledged, but the printer isn't at the job's "
                f"end position: {wrong} (position verified to {WITHIN_MM:g} "
                f"mm){f' ({others})' if others else ''}; inspect the part; `printctl status` lists "
                "the next steps",
                known=False,
            )
        return words

    # --- what another program did to it ----------------------------------------------------------

    def refuse_astray(self) -> Steps[None]:
        """End the print where place or its name aren't the job's; nothing stands still for it."""
        wrong, _ = yield from self.compare(self._progress.modal())
        wrong = wrong or (yield from self.frame.renamed())
        if wrong:
            yield from self.end_astray(f"{wrong} (another client of this printer wrote to it)")

    def refuse_renamed(self, *, waited: bool = False) -> Steps[None]:
        """End the print where another program has renamed the place (`FrameCheck.renamed`)."""
        wrong = yield from self.frame.renamed(waited=waited)
        if wrong:
            yield from self.end_astray(wrong)

    def refuse_pushed(self, left_e_mm: float | None) -> Steps[None]:
        """End the print where another program wrote and the plunger's count isn't as it was left.

        Whether that program moved the plunger or renamed its place is unknown: to go back to the
        job's count would move it by what is unknown.
        """
        if left_e_mm is None or not self._progress.meddled:
            return
        position = yield from self._confirmed_position()
        e = position.get("E", left_e_mm)
        if abs(e - left_e_mm) > WITHIN_MM:
            at = f"at E {e:.2f} mm and was left at {left_e_mm:.2f}"
            yield from self.end_astray(f"the plunger is reported {at}")

    def end_astray(self, wrong: str) -> Steps[NoReturn]:
        """End a print whose printer isn't as its job counts on; its moves are dropped."""
        yield from self._channel.commands(shut_and_wait(self._printer))
        others = self._progress.foreign_words()
        because = f" ({others})" if others else ""
        dropped = yield from self._drop_moves()
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"after line {self._progress.done}: {wrong}{because}{dropped}; `printctl status` lists "
            "the next steps",
            known=False,
        )

    def _drop_moves(self) -> Steps[str]:
        """Have moves that lead astray dropped; return what to add to the message.

        Past the protocol, as the last bytes that are sent: a stop that was requested meanwhile
        mustn't make a way out from an unknown place.
        """
        quickstop = link_facts(self._printer).quickstop
        if not quickstop:
            return ""
        yield from self._channel.send_at_once(b"\n%b\n" % quickstop)
        self._progress.moves_dropped()
        return f"; its motors were told to stop ({quickstop.decode()})"


SOONEST_LINES: Final = 5
"""So many lines after an error the position is compared: a word garbled past the checksum (X to Z)
stays wrong until a later line gives it again."""
CHECK_LINES: Final = 40
"""Twice as many after each comparison that agrees, up to this."""
NOISY_LINES: Final = 250
"""For so many lines after an error a line counts as one that makes errors."""
AGAIN_LINES: Final = 2
"""After so many more a position that was wrong is compared again."""


class SlipWatch:
    """Compares the position soon after an error, and often for a while."""

    def __init__(self, channel: Channel, position: PositionCheck) -> None:
        self._channel, self._position = channel, position
        self._progress, self._protocol = channel.logbook.progress, channel.wiring.protocol
        self._checked = self._errors_seen = self._noisy_until = 0
        self._every = SOONEST_LINES
        self._slip = ""

    @property
    def due(self) -> bool:
        """Whether to compare the position now: an error was made, or a program wrote, lately."""
        errors, done = self._protocol.line_errors + self._progress.foreign, self._progress.done
        if errors != self._errors_seen:
            self._errors_seen, self._noisy_until = errors, done + NOISY_LINES
            self._every = AGAIN_LINES if self._slip else SOONEST_LINES
        return done < self._noisy_until and done - self._checked >= self._every

    def next_stop(self, stop: int) -> int:
        """Return after which line the position is to be compared, at most ``stop``."""
        done = self._progress.done
        if done >= self._noisy_until:
            return stop
        return min(stop, max(self._checked + self._every, done + 1))

    def look(self) -> Steps[None]:
        """Compare the position; where the next lines put it right, again after them.

        A word that was garbled past the checksum and given again since did its harm; the print
        goes on, with an alarm. One that would stay wrong (a Z within a layer) ends it at once.
        """
        yield from self._channel.settle()
        done = self._checked = self._progress.done
        at, lines = self._progress.modal(), self._progress.job.lines
        wrong, position = ("", {}) if self._slip else (yield from self._position.compare(at))
        soon = set(axes_placed(lines[done : done + AGAIN_LINES]))
        if wrong and position and soon.issuperset(mismatched_axes(at, position)):
            yield from self._position.refuse_renamed()
            self._slip = f"after line {done}: {wrong}"
            self._every, self._noisy_until = AGAIN_LINES, done + NOISY_LINES
            return
        yield from self._position.verify(at)
        self._every = min(2 * self._every, CHECK_LINES)
        if self._slip:
            self._channel.logbook.alarm(
                f"{self._slip}: a garbled line slipped through its checksum; inspect the part"
            )
            self._slip = ""
