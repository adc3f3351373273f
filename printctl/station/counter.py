"""What other threads may say to a station, and what is told of it.

Wishes of clients wait in a queue for the thread that owns the port; `kill` and the end of a move
don't wait.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from printctl.gate import Bounds, reach
from printctl.link.errors import JournalError, LinkError, PortLost, Refused
from printctl.link.journal import Journal
from printctl.link.streamer import Streamer
from printctl.link.transport import Transport
from printctl.station.hands import MOTIONS
from printctl.station.knowledge import Knowledge
from printctl.station.standby import Standby
from printctl.station.status import Place, StationState, StationStatus
from printctl.station.temperatures import parse_temperatures
from printctl.station.wire import Socket

QUEUE: Final = 20
_HALT: Final = b"\nM112\n"
ALONE: Final = MOTIONS | {"print", "close", "reconnect"}
"""Wishes that are refused while one of them goes on."""
DOWN: Final = frozenset({StationState.HALTED, StationState.LOST})
_WHEN_DOWN: Final = frozenset({"reconnect", "close", "mount"})

log = logging.getLogger(__name__)

Say = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Wish:
    """What a client asked for, and where the answer goes."""

    do: str
    values: dict[str, Any]
    say: Say


class Counter:
    """A station as other threads see it.

    Parameters
    ----------
    socket : Socket
    known : Knowledge
    journal : Journal
    start : (x, y, z), mm
        Where a simulated printer's tip stands.
    """

    def __init__(self, socket: Socket, known: Knowledge, journal: Journal, start: Place) -> None:
        self.socket, self.known, self.journal = socket, known, journal
        self.on_change: Callable[[StationStatus], None] = lambda status: None
        self.closing = False
        self._start = start
        self._status = StationStatus(
            StationState.CONNECTING, profile=socket.profile, port=socket.port
        )
        self._wishes: deque[Wish] = deque()
        self._bell = threading.Event()
        self._lock = threading.Lock()
        self._alone = False
        self._switching = True
        self._reach_of: tuple[Bounds, Place] | None = None
        self._reached: tuple[tuple[float, ...], tuple[float, ...]] = (), ()
        self._transport: Transport | None = None
        self._standby: Standby | None = None
        self._streamer: Streamer | None = None

    # --- for any thread --------------------------------------------------------------------

    @property
    def names(self) -> frozenset[str]:
        """Wishes that are known."""
        return frozenset({*ALONE, "heat", "touch_off", "set_position", "mount", "stop_motion"})

    @property
    def status(self) -> StationStatus:
        """The station as it stands."""
        status, streamer, standby = self._status, self._streamer, self._standby
        if streamer is None or status.state is not StationState.PRINTING:
            trouble = standby.trouble if standby is not None and status.open else ""
            return replace(status, message=trouble or status.message)
        told = streamer.status
        message = f"{told.state.value}: {told.message}"
        warm = parse_temperatures((streamer.protocol.report,)) or status.temperatures
        return replace(status, message=message, readings=told.readings, temperatures=warm)

    def kill(self) -> None:
        """Halt the firmware at once. Called in a thread of its own; nothing here waits for others.

        Whoever speaks to the printer may change meanwhile (a print begins or ends): then it is
        told to the next one as well.
        """
        while True:
            channel = self._streamer or self._standby
            if channel is not None:
                channel.kill()
            if self._status.state in DOWN and self._transport is not None:
                with contextlib.suppress(PortLost):
                    self._transport.write_urgent(_HALT)
            while self._switching and (self._streamer or self._standby) is channel:
                time.sleep(0.005)
            if (self._streamer or self._standby) is channel or self.closing:
                return

    def ask(self, do: str, values: dict[str, Any], say: Say) -> None:
        """Take a wish.

        Raises
        ------
        Refused
            When it can't be granted as the station stands.
        """
        if do == "stop_motion":
            self._stop_motion(say)
        elif self._status.state is StationState.PRINTING:
            self._ask_print(do, values, say)
        else:
            with self._lock:
                self._queue(Wish(do, values, say))
            self._bell.set()

    def _queue(self, wish: Wish) -> None:
        state = self._status.state
        if state in DOWN and wish.do not in _WHEN_DOWN:
            raise Refused(f"the station is {state.value}: {self._status.message}")
        if state is StationState.CONNECTING:
            raise Refused("the printer is being connected; wait for it to be ready")
        if wish.do in ALONE and self._alone:
            raise Refused("something moves already; wait for its end, or end it (stop_motion)")
        if len(self._wishes) >= QUEUE:
            raise Refused(f"{QUEUE} wishes wait already; wait for them")
        if wish.do in ALONE:
            self._alone = True
            if self._standby is not None:
                self._standby.allow_motion()
        self._wishes.append(wish)

    def _stop_motion(self, say: Say) -> None:
        """End the move that goes on, and forget those that wait."""
        if self._status.state is StationState.PRINTING:
            raise Refused("a print goes on; stop or pause it instead")
        standby = self._standby
        with self._lock:
            if standby is not None:
                standby.halt_motion()
            dropped = [wish for wish in self._wishes if wish.do in MOTIONS]
            for wish in dropped:
                self._wishes.remove(wish)
            self._alone = self._alone and not dropped
        for wish in dropped:
            wish.say(refusal(Refused("ended before it began")))
        say(self._reply("stop_motion", {}))

    def _ask_print(self, do: str, values: dict[str, Any], say: Say) -> None:
        streamer = self._streamer
        folder = self._status.print_folder
        if do != "command" or streamer is None:
            raise Refused(f"a print goes on in {folder}; pause or stop it, or wait for its end")

        def done(lines: tuple[bytes, ...]) -> None:
            said = [line.decode("ascii", "backslashreplace") for line in lines]
            say(self._reply("command", {"lines": said}))

        streamer.typed(str(values["text"]), done, lambda why: say(refusal(Refused(why))))

    # --- telling -------------------------------------------------------------------------------

    def _write_down(self, sort: str, **values: Any) -> None:
        """Add to the journal; a full disk mustn't keep a needle from being lifted."""
        try:
            self.journal.add(sort, **values)
        except JournalError as exc:
            log.error("%s", exc)

    def _reply(self, do: str, answer: dict[str, Any]) -> dict[str, Any]:
        return {"event": "reply", "do": do, **answer, "status": self.status.to_dict()}

    def _tell(self, state: StationState, message: str, **values: Any) -> None:
        self._status = replace(self._status, state=state, message=message, **values)
        self._tell_live()

    def _tell_live(self) -> None:
        """Tell what is known now."""
        standby, known, status = self._standby, self.known, self._status
        if standby is not None and status.open and status.state is not StationState.PRINTING:
            status = replace(
                status,
                firmware=standby.firmware.name,
                position_mm=standby.position,
                temperatures=standby.temperatures,
                readings=standby.readings,
            )
        low, high = self._reach(status.position_mm)
        self._status = replace(
            status,
            position_trusted=known.trusted,
            homed=known.homed,
            plunger_mm=known.plunger_mm,
            plunger_left_mm=known.plunger_left_mm,
            ul_left=known.ul_left,
            soft_low_mm=low,
            soft_high_mm=high,
            mounted=known.mounted,
        )
        self.on_change(self.status)

    def _reach(self, at: Place | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The soft limits from here; reckoned anew when something has changed."""
        if at is None or not self.known.trusted:
            return (), ()
        asked = (self.known.bounds, at)
        if asked != self._reach_of:
            self._reach_of, self._reached = asked, reach(*asked)
        return self._reached


def refusal(exc: LinkError) -> dict[str, Any]:
    """The answer to a wish that wasn't granted."""
    return {"event": "refused", "message": str(exc), "error": type(exc).__name__}
