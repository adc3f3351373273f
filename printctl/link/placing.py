"""Where the printer is, against where the job's text says it is.

M114 is answered with the position that the last command taken leads to, not with where the motors
are: up to a planner's worth of moves may still be ahead of them. It says that what was taken was
taken as it was meant, and costs a line and its answer; the planner goes on meanwhile. Where the
motors themselves matter, M400 comes first and waits for them.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Final

from firmware_profiles.families.position_reply import parse_position
from printctl.link.channel import EARLY, Channel, Over, Wiring
from printctl.link.errors import PortLost
from printctl.link.heads import choose, confirms, head_at, keep_raised
from printctl.link.job import Job
from printctl.link.modal import Modal, ModalTrail, disagreement
from printctl.link.retreat import Retreat
from printctl.link.states import LinkState
from printctl.link.valve import reopen, shut, shut_and_wait

RETRIES: Final = 8


class Placing(Channel):
    """Verifies positions; see `Channel` for what it is given."""

    def __init__(self, wiring: Wiring, job: Job) -> None:
        super().__init__(wiring, job)
        self._trail = ModalTrail(job.lines)
        self._shut = False

    @property
    def _speed_mm_s(self) -> float:
        """How fast the needle may be, mm/s: by the job's last feed rate."""
        feed = self._trail.at(self.protocol.lines_done).f
        return super()._speed_mm_s if feed is None else feed / 60.0

    def _settle(self) -> None:
        """Send no further job line; wait until what is in flight is taken."""
        self.protocol.held = True
        while not self.protocol.idle:
            self._pump()

    def _where(self) -> Modal:
        """Where the job's text says the printer is; what it doesn't say is asked for."""
        at = self._trail.at(self.protocol.lines_done)
        asks_e = at.e is None and not self.wiring.printer.pneumatic
        if at.z is None or asks_e:
            position = parse_position(self._command(b"M114"))
            at = replace(
                at,
                z=position.get("Z") if at.z is None else at.z,
                e=position.get("E") if asks_e else at.e,
            )
        return at

    def _compare(self, at: Modal) -> tuple[str, dict[str, float]]:
        """Ask for the position; give what disagrees with ``at`` (empty for nothing), and it."""
        wrong = "its position can't be read (M114)"
        position: dict[str, float] = {}
        for _ in range(RETRIES):  # a reply may be garbled, where a line can't be
            position = parse_position(self._command(b"M114")) or position
            wrong = disagreement(at, position) if position else wrong
            if position and not wrong:
                break
        return wrong, position

    def _verify(self, at: Modal, mark: str = "") -> None:
        """Compare the printer's position with the job's text; write both down."""
        wrong, position = self._compare(at)
        done = self.protocol.lines_done
        values = {"mark": mark} if mark else {}
        self._record("checkpoint", done=done, position=position, agrees=not wrong, **values)
        if wrong:
            self._shut_valve()
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"after line {done}: {wrong}; `printctl status` says what next",
                known=False,
            )

    def _verify_in_passing(self) -> None:
        """Compare positions between two lines; the planner isn't drained for it."""
        self._settle()
        self._unverified = False
        self._verify(self._trail.at(self.protocol.lines_done))
        self.protocol.held = False
        self.protocol.go(self.wiring.clock.now())

    # --- several heads ---------------------------------------------------------------------------

    @property
    def _head(self) -> int | None:
        """The head that the job has in use; None where there is one alone, or none was chosen."""
        if not self.wiring.printer.heads:
            return None
        return head_at(self.job.lines, self.protocol.lines_done)

    @property
    def _retreat(self) -> Retreat:
        """Relief and prime of the head in use."""
        return self.wiring.retreat.of_head(self._head)

    def _take_head(self) -> None:
        """Choose the head that the job has in use, and see that it is; the others are raised.

        Before any move after a time in which somebody else may have chosen another.
        """
        number = self._head
        if number is not None:
            for command in keep_raised(
                self.job.lines, self.protocol.lines_done, self.wiring.printer
            ):
                self._command(command)
            self._choose(number)

    def _choose(self, number: int) -> None:
        """Have the firmware use a head, and say so."""
        printer = self.wiring.printer
        for _ in range(RETRIES):  # an answer may be garbled
            if confirms(self._command(choose(printer, number)), printer, number):
                return
        raise Over(
            LinkState.POSITION_UNKNOWN,
            f"the firmware doesn't say that it uses head {number} ({choose(printer, number)!r}): "
            "nothing was moved; see that it was built with so many, then `printctl status`",
            known=False,
        )

    # --- a pneumatic head's valve --------------------------------------------------------------

    def _shut_valve(self) -> None:
        """Shut the valve, where there is one: before the needle is lifted, and before questions."""
        for command in shut_and_wait(self.wiring.printer):
            self._command(command)
            self._shut = True

    def _open_valve(self) -> None:
        """Open it again where the link had shut it within a path, with the tip back in place."""
        if self._shut:
            for command in reopen(self.job.lines, self.protocol.lines_done, self.wiring.printer):
                self._command(command)
        self._shut = False

    def _shut_valve_anyhow(self, over: Over) -> None:
        """Shut a pneumatic head's valve where the protocol can't go on but the wire is there.

        Without number and checksum, twice: the last thing that is said, whatever the printer makes
        of it. A firmware that was killed takes nothing; one that was reset may take it.
        """
        begun = self._resumed or self._state not in EARLY
        lost = over.state not in (LinkState.FAILED, LinkState.POSITION_UNKNOWN)
        if lost or over.known or over.error == PortLost.__name__ or not begun:
            return
        for command in shut(self.wiring.printer):
            self._record("notice", text="the valve is told to shut, past the protocol")
            with contextlib.suppress(PortLost):
                self.wiring.transport.write_urgent(b"\n%b\n%b\n" % (command, command))
