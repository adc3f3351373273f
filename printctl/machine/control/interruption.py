"""Cut short a wait of the link on a stop request, by quickstop if the firmware has one.

A stop can't wait until a pause is made, the needle is back or the last move is over. Where the
firmware has a quickstop it is written past the line in flight, without a number; that line is then
answered soon, and the print ends by `ending`. No further command of what was going on is sent, with
any firmware.
"""

from __future__ import annotations

import math
from typing import Final

from printctl.machine.control.channel import PrinterReplies
from printctl.machine.control.kill import Kill
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.requests import Request, RequestQueue
from printctl.machine.control.wiring import Wiring
from printctl.machine.families import link_facts
from printctl.machine.job.dispensing import shut
from printctl.machine.records.states import EARLY, LinkState, PrintEnded

AGAIN_S: Final = 3.0
MOST: Final = 3
"""So often the motors are told to stop while the line in flight isn't answered; each takes 1 s."""
DEAD_S: Final = 2.5
"""Without a word for so long what was written may have been lost: it counts for nothing."""
SILENT_S: Final = 1.2
"""Without a word for so long a line may be dead: a firmware that is busy says so each second."""
SETTLED_S: Final = 1.0
"""Within so long of the first word behind that a doubt is settled, where nothing is left to do."""
BREAKABLE: Final = (b" W:", b"paused for ")
"""In what is told while heat, or a person at the printer's own button, is waited for."""
WAITS: Final = (
    "stopping; this firmware can't drop the moves that it holds, so they are made first: "
    "kill doesn't wait"
)


FIRST: Final = "stopping behind the line that is being made: kill doesn't wait"
SILENT: Final = "stopping once the printer answers: by plan it has made all that was sent"


class StopRequested(Exception):  # noqa: N818
    """A stop was asked for and nothing is in flight: go no further, end the print."""


class Interruption:
    """Looks for a stop while the link waits.

    Parameters
    ----------
    wiring : Wiring
    logbook : Logbook
    queue : RequestQueue
    kill : Kill
        Knows whether the firmware has an emergency parser.
    heard : PrinterReplies
    """

    def __init__(
        self,
        wiring: Wiring,
        logbook: Logbook,
        queue: RequestQueue,
        kill: Kill,
        heard: PrinterReplies,
    ) -> None:
        self._wiring, self._logbook, self._queue, self._kill = wiring, logbook, queue, kill
        self._over = self._told = False
        self._cuts, self._again_s = 0, -math.inf
        self._silent_s = -math.inf
        self._asked_s: float | None = None
        self._heard, self._heard_count, self._heard_s = heard, 0, math.inf

    def disarm(self) -> None:
        """Let nothing cut what follows: the way out, or a print that is over."""
        self._over = True

    def look(self) -> None:
        """Act on a stop that was asked for since the last look, with a line in flight.

        Raises
        ------
        PrintEnded
            Where the printer hasn't got the job's first line.
        """
        if not self._asked:
            return
        if self._logbook.state in EARLY:
            self._end_early()
        if not self._wiring.protocol.idle:
            self._cut_in()

    def check(self) -> None:
        """Go no further where a stop was asked for and nothing is in flight.

        Raises
        ------
        StopRequested
        """
        if self._asked and self._logbook.state not in EARLY and self._wiring.protocol.idle:
            raise StopRequested

    @property
    def _asked(self) -> bool:
        return not self._over and Request.STOP in self._queue.requests

    @property
    def stopped_by(self) -> str:
        """Who has asked for the stop."""
        return self._queue.stopped_by

    def _cut_in(self) -> None:
        wiring = self._wiring
        link, now = link_facts(wiring.printer), wiring.clock.now()
        if not link.quickstop:
            self._tell(WAITS)
            return
        waits = any(one in wiring.protocol.report for one in BREAKABLE)  # else its place is wanted
        if not waits and self._is_silent(now) and self._logbook.progress.all_made():
            self._tell(SILENT)
            return
        if self._asked_s is None:  # M410 into a dead line is obeyed when nothing is left to stop
            overdue = not waits and self._logbook.progress.overdue()
            self._asked_s = now if overdue else -math.inf
            if overdue:
                wiring.protocol.cut_in((), again=False, now=now)
        if self._heard.heard_s <= self._asked_s:
            return
        if self._heard.count != self._heard_count:
            if now - self._heard_s > DEAD_S:
                self._cuts, self._again_s = 0, now
            self._heard_count, self._heard_s = self._heard.count, now
        if self._cuts == MOST or now < self._again_s:
            return
        # a second would hold up a firmware that looks at it in its turn
        again = self._kill.halting.stops_at_once
        commands = (*shut(wiring.printer), link.ends_waits if waits else b"", link.quickstop)
        if not wiring.protocol.cut_in([text for text in commands if text], again, now):
            if not wiring.protocol.idle:
                self._tell(FIRST)
            return
        wiring.transport.write(wiring.protocol.take_output())
        self._cuts, self._again_s = self._cuts + 1, now + AGAIN_S
        self._heard_s = min(self._heard_s, now)
        self._logbook.progress.moves_dropped()
        self._tell(f"stopping the motors ({link.quickstop.decode()})")

    def _is_silent(self, now: float) -> bool:
        """Whether no word comes, or some came just now, whose doubt is being settled."""
        if now - self._heard.heard_s > SILENT_S:
            self._silent_s = now
        return now - self._silent_s < SETTLED_S

    def _tell(self, message: str) -> None:
        if not self._told:
            self._told = True
            self._logbook.enter(LinkState.STOPPING, message)

    def _end_early(self) -> None:
        if not self._logbook.resumed:
            message = f"stopped by {self.stopped_by} before the first line"
            raise PrintEnded(LinkState.STOPPED, message)
        message = f"stopped by {self.stopped_by} before the printer was found again"
        quickstop = link_facts(self._wiring.printer).quickstop
        if quickstop:
            self._wiring.transport.write_urgent(b"\n%b\n" % quickstop)
            message += f"; its motors were told to stop ({quickstop.decode()})"
        raise PrintEnded(LinkState.FAILED, message, known=False)
