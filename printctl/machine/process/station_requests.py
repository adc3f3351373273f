"""Requests of a station's clients: taken from any thread, refused at once or queued."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from printctl.machine.control.idle_commands import MOTIONS
from printctl.machine.control.station_status import StationState
from printctl.machine.errors import Refused
from printctl.machine.process.link_owner import LinkOwner
from printctl.machine.process.station_report import DOWN, StationReport, refusal

QUEUE: Final = 20
ALONE: Final = MOTIONS | {"print", "close", "reconnect"}
"""Requests that are refused while one of them goes on."""
NAMES: Final = frozenset({*ALONE, "heat", "touch_off", "set_position", "mount", "stop_motion"})
"""Requests that are known."""
_WHEN_DOWN: Final = frozenset({"reconnect", "close", "mount"})

Say = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Request:
    """What a client asked for, and where the answer goes."""

    do: str
    values: dict[str, Any]
    say: Say


class StationRequests:
    """Queue of requests for the thread that owns the port; the end of a move doesn't wait.

    Parameters
    ----------
    report : StationReport
    speaker : LinkOwner
    """

    def __init__(self, report: StationReport, speaker: LinkOwner) -> None:
        self._report, self._speaker = report, speaker
        self._requests: deque[Request] = deque()
        self._bell = threading.Event()
        self._lock = threading.Lock()
        self._alone = False

    # --- for any thread --------------------------------------------------------------------------

    def ask(self, do: str, values: dict[str, Any], say: Say) -> None:
        """Take a request.

        Raises
        ------
        Refused
            When it can't be granted as the station stands.
        """
        if do == "stop_motion":
            self._stop_motion(say)
        elif self._report.state is StationState.PRINTING:
            self._ask_print(do, values, say)
        else:
            with self._lock:
                self._queue(Request(do, values, say))
            self._bell.set()

    def _queue(self, request: Request) -> None:
        state = self._report.state
        if state in DOWN and request.do not in _WHEN_DOWN:
            raise Refused(f"the station is {state.value}: {self._report.message}")
        if state is StationState.CONNECTING:
            raise Refused("the printer is being connected; wait for it to be ready")
        if request.do in ALONE and self._alone:
            raise Refused("something moves already; wait for its end, or end it (stop_motion)")
        if len(self._requests) >= QUEUE:
            raise Refused(f"{QUEUE} requests wait already; wait for them")
        if request.do in ALONE:
            self._alone = True
            if self._speaker.standby is not None:
                self._speaker.standby.allow_motion()
        self._requests.append(request)

    def _stop_motion(self, say: Say) -> None:
        """End the move that goes on, and forget those that wait."""
        if self._report.state is StationState.PRINTING:
            raise Refused("a print goes on; stop or pause it instead")
        standby = self._speaker.standby
        with self._lock:
            if standby is not None:
                standby.halt_motion()
            dropped = [request for request in self._requests if request.do in MOTIONS]
            for request in dropped:
                self._requests.remove(request)
            self._alone = self._alone and not dropped
        for request in dropped:
            request.say(refusal(Refused("ended before it began")))
        say(self._report.reply("stop_motion", {}))

    def _ask_print(self, do: str, values: dict[str, Any], say: Say) -> None:
        streamer = self._speaker.streamer
        folder = self._report.print_folder
        if do != "command" or streamer is None:
            raise Refused(f"a print goes on in {folder}; pause or stop it, or wait for its end")

        def done(lines: tuple[bytes, ...]) -> None:
            reply = [line.decode("ascii", "backslashreplace") for line in lines]
            say(self._report.reply("command", {"lines": reply}))

        streamer.typed(str(values["text"]), done, lambda why: say(refusal(Refused(why))))

    # --- for the thread that owns the port -------------------------------------------------------

    def wait(self, seconds: float) -> None:
        """Wait until something is asked for, at most so long."""
        self._bell.wait(seconds)

    def take(self) -> Request | None:
        """Return the oldest request; None where there is none."""
        with self._lock:
            self._bell.clear()
            return self._requests.popleft() if self._requests else None

    def answer(self, request: Request, answer: dict[str, Any]) -> None:
        """Tell how a request ended; whoever hears it may ask for the next one."""
        with self._lock:
            if request.do in ALONE:
                self._alone = False
        request.say(answer)

    def grant(self, request: Request, answer: dict[str, Any]) -> None:
        """Tell that a request was granted."""
        self.answer(request, self._report.reply(request.do, answer))

    def drop_all(self, state: StationState) -> list[Request]:
        """Pass to a state in which what waits can't be granted; return what waited."""
        with self._lock:  # what is asked for from here on is of the next connection
            waiting, self._alone = list(self._requests), False
            self._requests.clear()
            self._report.enter(state)
        return waiting
