"""Pauses: where the print is held, how it is left and rejoined.

What other threads may call leaves a wish or a word; the streamer's thread looks at it between two
lines. How a syringe is changed meanwhile is in `printctl.link.changing`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from printctl.link.care import Care, NewSyringe
from printctl.link.changing import CHANGE, Changing
from printctl.link.channel import Over, Wiring
from printctl.link.errors import LinkError, Refused
from printctl.link.families import family_of
from printctl.link.gating import PausedTip, settings_changed_by
from printctl.link.job import Job
from printctl.link.marks import MarkKind
from printctl.link.modal import Modal, last_of, relieved_mm
from printctl.link.retreat import heaters_off
from printctl.link.states import LinkState, Status
from printctl.link.watch import Due

PAUSE_SIGN_S: Final = 20.0
"""Interval of the sign of life in a pause."""
_TIMEOUTS: Final = (b"M85", b"SET_IDLE_TIMEOUT")
"""Firmwares that cut the motors' power some time after the last move, unless M84 S0 forbids it."""
_NOTHING_TOLD: Final[tuple[NewSyringe | None, bool]] = None, False


class Pausing(Changing):
    """Holds a print and goes on with it.

    Parameters
    ----------
    wiring : Wiring
    job : Job
    care : Care, optional
    """

    def __init__(self, wiring: Wiring, job: Job, care: Care | None = None) -> None:
        super().__init__(wiring, job, care)
        self._reload_head: int | None = None
        self._told = _NOTHING_TOLD

    # --- for any thread --------------------------------------------------------------------

    def pause(self, after: MarkKind | None = None) -> None:
        """Ask for a pause: now, or once a layer or vessel has ended.

        Raises
        ------
        Refused
            When the job has no such mark ahead.
        """
        if after is None:
            self._wishes.append("pause")
            return
        if self.job.marks.next(after, self.protocol.lines_done) is None:
            what = "safe reload point" if after is MarkKind.RELOAD else f"end of a {after}"
            raise Refused(
                f"{self.job.name} marks no {what} after line "
                f"{self.job.file_line(self.protocol.lines_done)}; pause at once (--now) instead"
            )
        self.watch.after = after
        self._wishes.append("look")

    def reload(self, head: int | None = None) -> None:
        """Ask for a change of syringe: at the next reload point, or here when it is paused.

        Of several heads that of ``head``, or of the one in use there.

        Raises
        ------
        Refused
            When the job has no reload point ahead, or the printer no such head.
        """
        count = len(self.wiring.printer.heads)
        if head is not None and not 0 <= head < count:
            raise Refused(
                f"there is no head {head} to change the syringe of: {self.wiring.printer.name} "
                + (f"has 0 to {count - 1}" if count else "has one alone; don't name it")
            )
        self._reload_head = head
        if self._state is LinkState.PAUSED:
            self._wishes.append("reload")
        else:
            self.pause(MarkKind.RELOAD)

    def resume(self, change: NewSyringe | None = None, unchanged: bool = False) -> None:
        """Ask to go on after a pause; takes back a pause that is still waited for.

        Parameters
        ----------
        change : NewSyringe, optional
            What was put in, in a pause for a change of syringe.
        unchanged : bool
            The syringe wasn't changed after all.

        Raises
        ------
        Refused
            When a change of syringe is to be told, or is told where none is going on.
        """
        if self._changing and self._state is LinkState.PAUSED and not (change or unchanged):
            raise Refused(f"the print is paused for a change of syringe: {CHANGE}")
        if change and not self._changing:
            raise Refused(
                "the print isn't paused for a change of syringe: `printctl reload RUN` first, so "
                "that the change is in the journal"
            )
        if self._state is LinkState.PAUSED:  # later, a second word would belong to the next change
            self._told = change, unchanged
        self._wishes.append("resume")

    def alive(self) -> None:
        """Confirm that somebody is there: the dead-man's time begins anew."""
        self.watch.confirmed = self.wiring.clock.now()

    @property
    def status(self) -> Status:
        """The print as it stands."""
        status = super().status
        if status.ended:
            return status
        left = self.care.deadman_s or None  # it stands still in a pause
        if status.state is LinkState.PRINTING:
            left = self.watch.deadman_left(self.wiring.clock.now())
        return replace(status, waits_for=self._waits_for(), deadman_left_s=left)

    def _waits_for(self) -> str:
        if self._changing:
            number = self._changed_head
            return "syringe" if number is None else f"syringe {number}"
        after = self.watch.after
        if after is None:
            return ""
        return "reload" if after is MarkKind.RELOAD else f"pause after {after}"

    # --- between two lines -------------------------------------------------------------------

    def _at_mark(self) -> None:
        """Do what is due after the lines that were taken; nothing is in flight."""
        clock, done = self.wiring.clock, self.protocol.lines_done
        due = self.watch.due(clock.now(), done)
        where = ", ".join(str(mark) for mark in self.job.marks.here(done)) or f"line {done}"
        if due is Due.RELOAD:
            planned = done in self.watch.reload_at
            self._change_head = self.watch.reload_head(done) if planned else self._reload_head
            self._pause(f"paused at the {where}: {self._what_to_change()}", changing=True)
        elif due is Due.PAUSE:
            self._pause(f"paused at the {where}")
        elif due is Due.DEADMAN:
            self._nobody_there()
        elif due is Due.CHECKPOINT:
            self._verify(self._trail.at(done), mark=where)
            self.watch.checked(clock.now(), done)

    def _nobody_there(self) -> None:
        message = f"nobody confirmed for {self.care.deadman_s / 60:g} min (dead-man)"
        self._alarm(message)
        if self.care.deadman_stops:
            self._retreat_and_end(LinkState.STOPPED, message)
        self._pause(f"paused: {message}; `printctl resume RUN` goes on")

    # --- leaving, waiting, coming back ---------------------------------------------------------

    def _pause(self, message: str = "paused", changing: bool = False) -> None:
        done = self.protocol.lines_done
        self.watch.paused(done)
        self._enter(LinkState.PAUSING, "relieving the plunger and lifting the needle")
        self._hold_motors()
        self._command(b"M400")
        self._shut_valve()  # what was taken is written; nothing more
        at = self._where()
        self._verify(at)
        retreat, printer = self._retreat, self.wiring.printer
        for command in retreat.leave(at, printer, relieved_mm(self.job.lines, done)):
            self._command(command)
        if changing:
            self._begin_change(at)
        self._command(b"M400")
        self._wait_and_come_back(at, message)

    def _wait_and_come_back(self, at: Modal, message: str) -> None:
        self._enter(LinkState.PAUSED, message)
        change = self._stay_paused(at)
        self._enter(LinkState.RESUMING, "returning to where the print was left")
        if change or (self._changing and self._is_idle(self._change_head)):
            self._count_new_syringe(at, change or NewSyringe())
        self._take_head()
        retreat = self._retreat
        for command in retreat.rejoin(at, self.wiring.printer, retreat.prime_mm):
            self._command(command)
        self._command(b"M400")
        self._verify(at)
        self._let_motors_go()
        self._changing, self._change_head = False, None
        self.alive()
        self._enter(LinkState.PRINTING, "printing")
        self._open_valve()

    def _stay_paused(self, at: Modal) -> NewSyringe | None:
        """Wait for the word to go on; give the syringe that was put in, if one was."""
        clock, tip = self.wiring.clock, PausedTip(self.wiring.limits(), self._command)
        while True:
            until = clock.now() + PAUSE_SIGN_S
            while clock.now() < until and not self._wishes and not self._commands:
                self._pump(until)
            while self._commands:
                self._carry_out(self._commands.popleft(), tip.known)
            wish = self._wishes.popleft() if self._wishes else ""
            if wish == "stop":
                self._heaters_off()
                self._undo_settings()
                raise Over(LinkState.STOPPED, "stopped by the user while paused")
            if wish == "reload" and not self._changing:
                self._change_head = self._reload_head
                self._begin_change(at)
                self._enter(LinkState.PAUSED, f"paused: {self._what_to_change()}")
            if wish == "resume":
                change, unchanged = self._take_told()
                problem = self._why_not_resume(at, change, unchanged)
                if not problem:
                    return change if self._changing else None
                self._alarm(problem)
                self._enter(LinkState.PAUSED, problem)
            self._sign_of_life()

    def _take_told(self) -> tuple[NewSyringe | None, bool]:
        """What was told of the syringe, taken once: the door's thread may tell more at any time."""
        told, self._told = self._told, _NOTHING_TOLD
        return told

    def _why_not_resume(self, at: Modal, change: NewSyringe | None, unchanged: bool) -> str:
        """What keeps the needle from coming down; empty for nothing."""
        if self._changing and not (change or unchanged):
            return f"not resumed: {CHANGE}"
        wrong, _ = self._compare(Modal(x=at.x, y=at.y))
        if wrong:
            return f"not resumed: {wrong}; bring the needle back above that place first"
        if self._changing and change:
            try:
                at_lines, heads = self._reloads_with(change)
                self.watch.reload_at, self.watch.reload_heads = at_lines, heads
            except LinkError as exc:
                return f"not resumed: {exc}"
        return ""

    def _hold_motors(self) -> None:
        """Keep the firmware from cutting the motors' power while the needle waits."""
        if family_of(self.wiring.printer).m84_sets_timeout:
            self._command(b"M84 S0")

    def _let_motors_go(self) -> None:
        """Set the time again after which they lose their power, where the job gave one.

        No firmware tells which was in force: a job that gave none leaves them powered.
        """
        given = last_of(self.job.lines, self.protocol.lines_done, (b"M84", b"M18"))
        timed = family_of(self.wiring.printer).m84_sets_timeout
        if timed and given is not None and b"S" in given:
            self._command(given)

    def _sign_of_life(self) -> None:
        """Show that the printer is there, and begin its own switch-off time anew.

        Only moves and the command that sets that time begin it anew; M105 doesn't.
        """
        timeout = last_of(self.job.lines, self.protocol.lines_done, _TIMEOUTS)
        self._command(timeout or b"M105")

    # --- the change of syringe, found again ---------------------------------------------------

    def _await_syringe(self, at: Modal, head: int | None = None) -> None:
        """Go on waiting for a syringe: the host died while it was changed.

        The plunger is left alone, since nobody knows what is in front of it.
        """
        self._changing, self._change_head = True, head
        self._hold_motors()
        z = self._compare(Modal())[1].get("Z")
        for command in self.wiring.retreat.rise(at, self.wiring.printer, self._room_mm):
            if z is None or at.z is None or z < at.z + self._room_mm:
                self._command(command)
        self._take_idle_head()
        self._command(b"M400")
        self._wait_and_come_back(at, f"paused, found again: {self._what_to_change()}")

    # --- ends ------------------------------------------------------------------------------------

    def _retreat_and_end(self, state: LinkState, message: str) -> None:
        self._shut_valve()
        self._enter(LinkState.STOPPING, message)
        self._fault = ""
        relieved = relieved_mm(self.job.lines, self.protocol.lines_done)
        for command in self._retreat.leave(self._really(), self.wiring.printer, relieved):
            self._command(command)
        self._heaters_off()
        self._command(b"M400")
        self._undo_settings()
        if self._fault:
            message += f"; the way out wasn't made as meant: {self._fault}"
        raise Over(state, message)

    def _really(self) -> Modal:
        """Where the printer says it is, if that isn't the job's place: the way out begins there.

        The needle is never lowered: of two heights the upper one holds.
        """
        at = self._where()
        wrong, position = self._compare(at)
        if not wrong or not position:
            return at
        self._alarm(wrong)
        z = position.get("Z") if at.z is None else max(at.z, position.get("Z", at.z))
        return replace(at, z=z, e=position.get("E", at.e))

    def _undo_settings(self) -> None:
        """Set the firmware's settings as they were before the job, where it has changed them."""
        taken = self.job.lines[: self.protocol.lines_done]
        for code in settings_changed_by(taken, self.wiring.printer):
            if code in self._settings:
                self._command(self._settings[code].encode("ascii"))

    def _heaters_off(self) -> None:
        for command in heaters_off(self.wiring.printer):
            self._command(command)
