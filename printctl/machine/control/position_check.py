"""Compare the position that the printer reports with the job's commanded position.

M114 is answered with the position that the last command taken leads to, not with where the motors
are: up to a planner's worth of moves may still be ahead of them. It says that what was taken was
taken as it was meant, and costs a line and its answer; the planner goes on meanwhile. Where the
motors themselves matter, M400 comes first and waits for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NoReturn

from firmware_profiles.families.position_reply import parse_position, parse_shifted
from printctl.machine.control.channel import Channel
from printctl.machine.control.frame_check import FrameCheck
from printctl.machine.control.valve_switch import ValveSwitch
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import AXES, Modal, disagreement, modal_state
from printctl.machine.records.states import LinkState, PrintEnded
from sim.gcode.reading import is_motion, read_sent

RETRIES: Final = 8
"""So often a question is asked whose answer may be garbled."""
WITHIN_MM: Final = 0.011
"""Of the two decimals that M114 tells."""


@dataclass(frozen=True)
class Standstill:
    """Where a printer stands whose motors were stopped.

    Attributes
    ----------
    at : Modal
        Of two heights the upper one, so that a way out is never lowered.
    read : bool
        Whether the printer's own word could be read; else it is the job's.
    dropped : bool
        Whether moves of the job weren't made.
    place : Modal
        What the printer told, where its motors were stopped.
    """

    at: Modal
    read: bool
    dropped: bool
    place: Modal = field(default_factory=Modal)

    def words(self) -> str:
        """Return what to add to the message of the end."""
        if not self.read:
            return "; its motors were stopped, and where it stands can't be read (M114)"
        if not self.dropped:
            return ""
        place = f"X{self.at.x:.2f} Y{self.at.y:.2f}"
        return f"; its motors were stopped at {place}, what it held ahead wasn't made"


class PositionCheck:
    """Asks one printer where it is.

    Parameters
    ----------
    channel : Channel
    valve : ValveSwitch
        Shut where the position is wrong.
    frame : FrameCheck
        Looks whether another program has renamed the place.
    """

    def __init__(self, channel: Channel, valve: ValveSwitch, frame: FrameCheck) -> None:
        self._channel, self._valve, self._frame = channel, valve, frame
        self._logbook, self._progress = channel.logbook, channel.logbook.progress

    def expected(self, left: Mapping[str, float] | None = None) -> Modal:
        """Return where the job's text says the printer is.

        What it doesn't say is taken from the place that the needle left for a pause, where there
        is one, else the printer is asked.
        """
        at = self._progress.modal().filled(left or {})
        asks_e = at.e is None and not self._channel.wiring.printer.pneumatic
        if at.z is None or asks_e:
            position = parse_position(self._channel.command(b"M114"))
            at = replace(
                at,
                z=position.get("Z") if at.z is None else at.z,
                e=position.get("E") if asks_e else at.e,
            )
        return at

    def actual(self) -> Modal:
        """Return where the printer says it is, if that isn't the job's place.

        A way out begins there. The needle is never lowered: of two heights the upper one holds.
        """
        at = self.expected()
        wrong, position = self.compare(at)
        if not wrong or not position:
            return at
        if self._was_of_others(position):
            return self._progress.modal()
        self._logbook.alarm(wrong)
        self._progress.moves_dropped()  # nobody knows which lines led to where the job says
        z = position.get("Z") if at.z is None else max(at.z, position.get("Z", at.z))
        return replace(at, z=z, e=position.get("E", at.e))

    def _was_of_others(self, position: Mapping[str, float]) -> bool:
        """Whether the line that seemed refused was carried out: the complaint wasn't of it."""
        behind = self._progress.behind_refused()
        facts = link_facts(self._channel.wiring.printer)
        of_line = self._progress.about_command and not facts.complains_to_all
        if behind is None or of_line or disagreement(behind, dict(position)):
            return False
        self._progress.not_refused()
        of = "another program's command" if self._progress.about_command else "a fault of its own"
        self._logbook.alarm(
            f"{self._progress.words()}, the last of them all the same: the printer complained of "
            f"{of}"
        )
        return True

    def height(self) -> float:
        """Return the needle's height, mm.

        Raises
        ------
        PrintEnded
            Where it can't be read.
        """
        position = self._said_twice()
        if not position:
            self._valve.shut()
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                "where the needle stands can't be read (M114), so it wasn't lowered; `printctl "
                "status` says what next",
                known=False,
            )
        return position["Z"]

    def standing_away(self) -> Standstill:
        """Return where the printer says it stands, whatever the job's text says."""
        position = self._said_twice()
        words = {axis.lower(): value for axis, value in position.items() if axis in AXES}
        return Standstill(Modal(**words), read=bool(position), dropped=False)

    def made(self) -> bool:
        """Whether the motors stand where the job's last line leads: nothing is left to be dropped.

        M114 doesn't count the plunger's steps: not behind a line that moves it alone.
        """
        moves = (line for line in reversed(self._progress.taken) if is_motion(line))
        last = read_sent(next(moves, b"")).words
        return bool(set("XYZ") & last.keys()) and self._frame.stands_at(self._progress.modal())

    def standstill(self) -> Standstill:
        """Return where the printer stands after it dropped moves."""
        at, heights = self._progress.modal(), self._progress.heights()
        position = self._said_twice()
        if not position:
            return Standstill(replace(at, z=max(heights, default=None)), read=False, dropped=True)
        z = position["Z"]
        if heights and not min(heights) - WITHIN_MM <= z <= max(heights) + WITHIN_MM:
            self._logbook.alarm(disagreement(Modal(z=at.z), position))
        x, y, e = position["X"], position["Y"], position.get("E")
        there = replace(at, x=x, y=y, z=max([z, *heights]), e=e)
        dropped = bool(disagreement(at, position))
        return Standstill(there, read=True, dropped=dropped, place=Modal(x=x, y=y, z=z, e=e))

    def _said_twice(self) -> dict[str, float]:
        """Return the position once it was said twice running: no checksum guards it; else empty."""
        position: dict[str, float] = {}
        for _ in range(RETRIES):
            before, position = position, parse_position(self._channel.command(b"M114"))
            if set("XYZ") <= set(position) and position == before:
                return position
        return {}

    def compare(self, at: Modal) -> tuple[str, dict[str, float]]:
        """Ask for the position; return what disagrees with ``at`` (empty for nothing), and it."""
        wrong = "its position can't be read (M114)"
        position: dict[str, float] = {}
        for _ in range(RETRIES):  # a reply may be garbled, where a line can't be
            position = self._last_place() or position
            wrong = disagreement(at, position) if position else wrong
            if position and not wrong:
                break
        return wrong, position

    def _last_place(self) -> dict[str, float]:
        """Return where the last command leads, mm, by axis; of E what was pushed, where told."""
        if not self._frame.tells_shifts:
            return parse_position(self._channel.command(b"M114"))
        question = link_facts(self._channel.wiring.printer).place_question
        return parse_shifted(self._channel.command(question))[0]

    def missed_height(self, way: Sequence[bytes]) -> str:
        """Return how far from its end a way out ended, which was acknowledged; '' for nothing."""
        wrong, told = self.compare(Modal(z=modal_state(way, len(way)).z))
        return wrong.replace("the job says", "it was sent to") if told else ""

    def note_plunger(self) -> None:
        """Take the plunger's count as the link has set it; see `FrameCheck.note_plunger`."""
        self._frame.note_plunger()

    def refuse_astray(self) -> None:
        """Compare place and name of the place with the job's; nothing stands still for it.

        Raises
        ------
        PrintEnded
            Where they disagree.
        """
        wrong, _ = self.compare(self._progress.modal())
        wrong = wrong or self._frame.renamed()
        if wrong:
            self.end_astray(f"{wrong} (another client of this printer wrote to it)")

    def verify(self, at: Modal, mark: str = "", stands: bool = False) -> None:
        """Compare the printer's position with the job's text; write both down.

        ``stands``: M400 was just answered, so that all that was taken is made.

        Raises
        ------
        PrintEnded
            Where they disagree.
        """
        wrong, position = self.compare(at)
        if not wrong and (self._progress.meddled or self._frame.doubtful()):
            wrong = self._frame.renamed()
        done = self._progress.done
        values: dict[str, str | bool] = {"mark": mark} if mark else {}
        values |= {"stands": True} if stands else {}
        self._logbook.record("checkpoint", done=done, position=position, agrees=not wrong, **values)
        if wrong:
            self.end_astray(wrong)
        if stands:
            self._progress.compared()

    def verify_end(self) -> str:
        """Compare where the motors rest behind the last move with where the job ends.

        Returns
        -------
        str
            What to add to the message of the end where something can't be compared.

        Raises
        ------
        PrintEnded
            Where they disagree: the printer didn't make what it acknowledged.
        """
        progress, at = self._progress, self._progress.modal()
        progress.verified()
        wrong, told, by_steps = self._frame.compare_end(at)
        if not told:
            words = "; the end's place isn't compared: the printer tells none (M114)"
        elif not set(told) & set(at.place_axes()):
            words = "; the end's place isn't compared: the job names none"
        elif not by_steps:
            words = (
                "; the end's place is compared as told, its motors' steps aren't: the printer "
                "doesn't tell them by axis"
            )
        else:
            words = ""
        if told and not (self._frame.tells_shifts or self._channel.wiring.printer.pneumatic):
            words += "; the plunger isn't compared"
        self._logbook.record(
            "checkpoint",
            done=progress.done,
            position=told,
            agrees=not wrong,
            stands=True,
            compared=(f"place and steps{words}" if by_steps and told else words).removeprefix("; "),
        )
        if wrong:
            progress.not_made()
            others = progress.foreign_words()
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                f"all {progress.done} lines were acknowledged, but the printer isn't where the job "
                f"ends: {wrong} (place compared to {WITHIN_MM:g} mm)"
                f"{f' ({others})' if others else ''}; "
                "look at the part; `printctl status` says what next",
                known=False,
            )
        return words

    def refuse_renamed(self, *, waited: bool = False) -> None:
        """Compare what the printer calls its place with its steps; see `FrameCheck.renamed`.

        Raises
        ------
        PrintEnded
            Where another program has renamed the place.
        """
        wrong = self._frame.renamed(waited=waited)
        if wrong:
            self.end_astray(wrong)

    def refuse_pushed(self, left_e_mm: float | None) -> None:
        """Compare the plunger's count with what it was left at, where another program wrote.

        Whether that program moved the plunger or renamed its place nobody tells.

        Raises
        ------
        PrintEnded
            Where they disagree: to go back to the job's count would move it by what is unknown.
        """
        if left_e_mm is None or not self._progress.meddled:
            return
        e = self._said_twice().get("E", left_e_mm)
        if abs(e - left_e_mm) > WITHIN_MM:
            self.end_astray(f"the plunger is told at E {e:.2f} mm and was left at {left_e_mm:.2f}")

    def end_astray(self, wrong: str) -> NoReturn:
        """End a print whose printer isn't as its job counts on; its moves are dropped.

        Raises
        ------
        PrintEnded
            Always: position unknown.
        """
        self._valve.shut()
        others = self._progress.foreign_words()
        because = f" ({others})" if others else ""
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"after line {self._progress.done}: {wrong}{because}{self._drop_moves()}"
            f"{self._not_lifted()}; `printctl status` says what next",
            known=False,
        )

    def _not_lifted(self) -> str:
        """Return what to do with a needle that was left where the print wrote."""
        if self._logbook.state is not LinkState.PRINTING:
            return ""
        z = self._progress.modal().z
        where = "" if z is None else f" at Z {z:.2f} mm, the job's height"
        return (
            f"; the needle wasn't lifted, it may still be in the ink{where}: lift it straight up "
            "by hand or by Z alone, before X or Y moves"
        )

    def _drop_moves(self) -> str:
        """Have moves that lead astray dropped; return what to add to the message.

        Past the protocol, as the last thing that is said: a stop that was asked for meanwhile
        mustn't make a way out from a place that nobody knows.
        """
        wiring = self._channel.wiring
        quickstop = link_facts(wiring.printer).quickstop
        if not quickstop:
            return ""
        wiring.transport.write_urgent(b"\n%b\n" % quickstop)
        self._progress.moves_dropped()
        return f"; its motors were told to stop ({quickstop.decode()})"

    def verify_in_passing(self) -> None:
        """Compare positions between two lines; the planner isn't drained for it."""
        self._channel.settle()
        self._progress.verified()
        self.verify(self._progress.modal())
