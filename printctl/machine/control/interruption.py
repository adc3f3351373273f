"""Cut short a wait of the link on a stop request, by quickstop if the firmware has one.

A stop can't wait until a pause is made, the needle is back or the last move is over. Where the
firmware has a quickstop it is written past the line in flight, without a number; that line is then
answered soon, and the print ends by `ending`. No further command of what was going on is sent, with
any firmware.
"""

from __future__ import annotations

import math
from typing import Final

from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.steps import Urgent
from printctl.machine.control.requests import Request, RequestQueue
from printctl.machine.families import link_facts
from printctl.machine.job.dispensing import shut_valves
from printctl.machine.records.states import EARLY, LinkState, PrintEnded

AGAIN_S: Final = 3.0
MAX_CUTS: Final = 3
"""So often the motors are told to stop while the line in flight isn't answered; each takes 1 s."""
DEAD_S: Final = 2.5
"""Without a word for so long what was written may have been lost: it counts for nothing."""
SILENT_S: Final = 1.2
"""Without a word for so long a line may be dead: a firmware that is busy says so each second."""
SETTLED_S: Final = 1.0
"""Within so long of the first word behind that a doubt is settled, where nothing is left to do."""
BREAKABLE: Final = (b" W:", b"paused for ")
"""In what is reported while heat, or a person at the printer's own button, is waited for."""
WAITS: Final = (
    "cancelling; this firmware can't drop its queued moves, so they are executed first: the "
    "emergency stop doesn't wait"
)
FIRST: Final = "cancelling after the current line: the emergency stop doesn't wait"
SILENT: Final = (
    "cancelling once the printer replies: according to the plan it has executed everything sent"
)


class StopRequested(Exception):  # noqa: N818
    """A stop was requested and nothing is in flight: go no further, end the print."""


class Interruption:
    """Acts on a stop request while the link waits; `Kill` knows about the emergency parser."""

    def __init__(self, channel: Channel, queue: RequestQueue) -> None:
        self._wiring, self._logbook, self._queue = channel.wiring, channel.logbook, queue
        self._kill = channel.kill
        self._over = self._reported = False
        self._cuts, self._again_s = 0, -math.inf
        self._silent_s = -math.inf
        self._requested_s: float | None = None
        self._heard, self._heard_count, self._heard_s = channel.heard, 0, math.inf

    def disarm(self) -> None:
        """Let nothing cut what follows: the way out, or a print that is over."""
        self._over = True

    def look(self) -> None:
        """Act on a stop with a line in flight; end a print before the job's first line at once."""
        if not self._requested:
            return
        if self._logbook.state in EARLY:
            self._end_early()
        if not self._wiring.protocol.idle:
            self._cut_in()

    def check(self) -> None:
        """Raise `StopRequested` where a stop was requested and nothing is in flight."""
        if self._requested and self._logbook.state not in EARLY and self._wiring.protocol.idle:
            raise StopRequested

    @property
    def _requested(self) -> bool:
        return not self._over and Request.STOP in self._queue.requests

    def _cut_in(self) -> None:
        protocol, progress = self._wiring.protocol, self._logbook.progress
        link, now = link_facts(self._wiring.printer), self._wiring.exchange.now_s
        if not link.quickstop:
            self._report(WAITS)
            return
        waits = any(one in protocol.report for one in BREAKABLE)  # else its place is wanted
        if not waits and self._is_silent(now) and progress.all_made():
            self._report(SILENT)
            return
        if (
            self._requested_s is None
        ):  # M410 into a dead line is obeyed when nothing is left to stop
            overdue = not waits and progress.overdue()
            self._requested_s = now if overdue else -math.inf
            if overdue:
                protocol.cut_in((), again=False, now=now)
        if self._heard.heard_s <= self._requested_s:
            return
        if self._heard.count != self._heard_count:
            if now - self._heard_s > DEAD_S:
                self._cuts, self._again_s = 0, now
            self._heard_count, self._heard_s = self._heard.count, now
        if self._cuts == MAX_CUTS or now < self._again_s:
            return
        # a second would hold up a firmware that looks at it in its turn
        again = self._kill.halting.stops_at_once
        end_of_waits = link.ends_waits if waits else b""
        commands = (*shut_valves(self._wiring.printer), end_of_waits, link.quickstop)
        if not protocol.cut_in([text for text in commands if text], again, now):
            if not protocol.idle:
                self._report(FIRST)
            return
        self._cuts, self._again_s = self._cuts + 1, now + AGAIN_S
        self._heard_s = min(self._heard_s, now)
        progress.moves_dropped()
        # written down first: whoever goes on with a print whose host died here must know of it
        self._report(f"stopping the motors ({link.quickstop.decode()})")
        self._wiring.exchange.effects.append(protocol.take_output())

    def _is_silent(self, now: float) -> bool:
        """Whether no word comes, or some came just now, whose doubt is being settled."""
        if now - self._heard.heard_s > SILENT_S:
            self._silent_s = now
        return now - self._silent_s < SETTLED_S

    def _report(self, message: str) -> None:
        if not self._reported:
            self._reported = True
            self._logbook.enter(LinkState.STOPPING, message)

    def _end_early(self) -> None:
        who = self._queue.stopped_by
        if not self._logbook.resumed:
            raise PrintEnded(LinkState.STOPPED, f"cancelled by {who} before the first line")
        message = f"cancelled by {who} before the printer was found again"
        quickstop = link_facts(self._wiring.printer).quickstop
        if quickstop:
            self._wiring.exchange.effects.append(Urgent(b"\n%b\n" % quickstop))
            message += f"; its motors were told to stop ({quickstop.decode()})"
        raise PrintEnded(LinkState.FAILED, message, known=False)
