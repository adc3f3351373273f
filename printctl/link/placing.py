"""Where the printer is, against where the job's text says it is.

M114 is answered with the position that the last command taken leads to, not with where the motors
are: up to a planner's worth of moves may still be ahead of them. It says that what was taken was
taken as it was meant, and costs a line and its answer; the planner goes on meanwhile. Where the
motors themselves matter, M400 comes first and waits for them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from printctl.link.channel import Channel, Over, Wiring
from printctl.link.job import Job
from printctl.link.modal import Modal, ModalTrail, disagreement, parse_position
from printctl.link.states import LinkState

RETRIES: Final = 8


class Placing(Channel):
    """Verifies positions; see `Channel` for what it is given."""

    def __init__(self, wiring: Wiring, job: Job) -> None:
        super().__init__(wiring, job)
        self._trail = ModalTrail(job.lines)

    def _settle(self) -> None:
        """Send no further job line; wait until what is in flight is taken."""
        self.protocol.held = True
        while not self.protocol.idle:
            self._pump()

    def _where(self) -> Modal:
        """Where the job's text says the printer is; what it doesn't say is asked for."""
        at = self._trail.at(self.protocol.lines_done)
        if at.z is None or at.e is None:
            position = parse_position(self._command(b"M114"))
            at = replace(
                at,
                z=position.get("Z") if at.z is None else at.z,
                e=position.get("E") if at.e is None else at.e,
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
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"after line {done}: {wrong}; `printctl recover` tells how to go on",
                known=False,
            )

    def _verify_in_passing(self) -> None:
        """Compare positions between two lines; the planner isn't drained for it."""
        self._settle()
        self._unverified = False
        self._verify(self._trail.at(self.protocol.lines_done))
        self.protocol.held = False
        self.protocol.go(self.wiring.clock.now())
