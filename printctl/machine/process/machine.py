"""One printer and what goes on with it: mode and status, requests, kill, for any thread.

The thread that owns the port changes the mode (`printctl.machine.process.station`,
`printctl.machine.process.one_print`); the socket's thread gives requests to the print that goes on,
or queues them for that thread; the thread that kills waits for neither.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import time
from collections import deque
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from printctl.checks.gate import Bounds, reach
from printctl.machine.control.board.heat import parse_temperatures
from printctl.machine.control.idle.idle_commands import IdleCommands
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.standby import Standby
from printctl.machine.control.idle.station_status import Place, StationState, StationStatus
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import JournalError, NoLink, PortLost, Refused
from printctl.machine.process.contact import save_station
from printctl.machine.process.plug import Plug
from printctl.machine.process.socket_server import Guest, Server, forget, listen, refusal
from printctl.machine.process.vocabulary import (
    WORDS,
    Asked,
    Idle,
    Reply,
    Values,
    action_of,
    read_values,
)
from printctl.machine.records.actor import actor, read_actor
from printctl.machine.records.journal import Journal
from printctl.machine.records.mounting import Mounting, as_kept, save_mounting
from printctl.machine.records.record import ContactRecord
from printctl.machine.records.states import Status, state_words
from printctl.processes.alive import ignore_signals

DOWN: Final = frozenset({StationState.HALTED, StationState.LOST})
"""States in which the printer can't be spoken to."""
QUEUE: Final = 20
SYSTEM: Final = "the system (SIGTERM, as when it shuts down)"
HOMING: Final = "home"
"""Message of a station that is busy homing."""
_UP: Final = frozenset({StationState.CONNECTING, StationState.READY, StationState.BUSY})
_HALTING: Final = (
    "an emergency stop was sent but isn't confirmed yet; if anything moves, cut its power"
)
_HALT: Final = b"\nM112\n"
_NO_PRINT: Final = "no print is running here"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Request:
    """What a client asks of a standing printer, and where the answer goes."""

    do: str
    values: Values
    reply: Reply
    by: dict[str, str] = field(default_factory=actor)

    @property
    def alone(self) -> bool:
        """Whether it is refused while another one of these goes on."""
        return WORDS[self.do].idle is not Idle.BESIDE


class Machine:
    """A printer from connecting to parting.

    ``journal`` is a station's; a print has one of its own.

    Attributes
    ----------
    server, address : Server or None, str
        Tells clients of each change, once there is one; where it listens.
    standby, idle : Standby, IdleCommands, or None
        Speaks to the standing printer, and what a person may ask of it; the last ones.
    streamer : Streamer or None
        The print that goes on.
    switching : bool
        Whether another one is about to speak to the printer.
    closing : bool
        Whether nobody will speak any more.
    """

    def __init__(self, plug: Plug, known: Knowledge, journal: Journal | None = None) -> None:
        self.plug, self.known, self.journal = plug, known, journal
        self.server: Server | None = None
        self.address = ""
        self._record: ContactRecord | None = None
        self._facts: tuple[object, ...] = ()
        self._mounting: Mounting | None = None
        self.standby: Standby | None = None
        self.idle: IdleCommands | None = None
        self.streamer: Streamer | None = None
        self.switching, self.closing = True, False
        self._print_id = ""
        self._status = StationStatus(StationState.CONNECTING, profile=plug.profile, port=plug.port)
        self._reach_of: tuple[Bounds, Place] | None = None
        self._reached: tuple[tuple[float, ...], tuple[float, ...]] = (), ()
        self._requests: deque[Request] = deque()
        self._actions: deque[dict[str, Any]] = deque()
        self._bell, self._lock = threading.Event(), threading.Lock()
        self._alone = False

    # --- for any thread: status ------------------------------------------------------------------

    @property
    def state(self) -> StationState:
        """The mode."""
        return self._status.state

    @property
    def message(self) -> str:
        """What happened last, the trouble of the moment apart."""
        return self._status.message

    @property
    def status(self) -> StationStatus:
        """The printer as it stands."""
        status, streamer, standby = self._status, self.streamer, self.standby
        if streamer is None or status.state is not StationState.PRINTING:
            if standby is not None and standby.halt_asked and status.state in _UP:
                return replace(status, state=StationState.HALTING, message=_HALTING)
            trouble = standby.trouble if standby is not None and status.open else ""
            return replace(status, message=trouble or status.message)
        printing = streamer.status
        message = f"{state_words(printing.state)}: {printing.message}"
        warm = parse_temperatures((streamer.protocol.report,)) or status.temperatures
        return replace(status, message=message, readings=printing.readings, temperatures=warm)

    def publish(self, printing: Status | None = None) -> None:
        """Tell subscribers how the printer stands, and the print that goes on."""
        status = self.status
        if self.server is not None:
            if printing is not None:
                self.server.tell("print", printing.to_dict())
            self.server.tell("printer", status.to_dict())
        self._save_changes(status)

    # --- for any thread: ends and emergencies ----------------------------------------------------

    def take_signals(self) -> None:
        """End in order where the system shuts down; Ctrl-C and hang-ups are the client's affair."""
        ignore_signals()
        signal.signal(signal.SIGTERM, lambda *_: self.leave())

    def leave(self) -> None:
        """Close, because the system shuts down; a print is stopped first."""
        self.closing = True
        if self.streamer is not None:
            self.streamer.stop(SYSTEM)

    def kill(self) -> None:
        """Halt the firmware at once. Called in a thread of its own; nothing here waits for others.

        Whoever speaks to the printer may change meanwhile (a print begins or ends): then the next
        one is killed as well.
        """
        while True:
            speaker = self._speaker
            if speaker is not None:
                speaker.kill()
            transport = self.plug.transport
            if self.state in DOWN and transport is not None:
                with contextlib.suppress(PortLost):
                    transport.write_halt(_HALT)
            while self._speaker is speaker and (self.switching or self._print_has_ended):
                time.sleep(0.005)
            if self._speaker is speaker or self.closing:
                return

    @property
    def _print_has_ended(self) -> bool:
        """Whether a station's print no longer speaks, and the next standby doesn't yet."""
        streamer = self.streamer
        return streamer is not None and self.standby is not None and streamer.status.ended

    @property
    def _speaker(self) -> Standby | Streamer | None:
        return self.streamer or self.standby

    # --- for any thread: requests ----------------------------------------------------------------

    def take(self, guest: Guest, request: dict[str, Any]) -> bool:
        """Take a request; return whether it has an answer of its own, given now or later.

        Refused when it can't be granted in this mode.
        """
        do, word = request["do"], WORDS[request["do"]]
        guest.known = True
        values, streamer = read_values(request), self.streamer
        reply = partial(self._post, guest)
        own = bool(request.get("print")) and do != "kill"
        if own and request["print"] != self._print_id:  # of one that is over
            over = refusal(NoLink("that print is over; the records in its folder contain its end"))
            reply({**over, "over": True})
            self._hang_up(guest)
            return True
        if do in ("status", "subscribe"):
            self._tell(guest, do, values["of"])
        elif do == "detach":
            guest.subscribed = ""
        elif do == "kill":
            if self.server is not None:
                self.server.kill()
            self._note(action_of(request, values))
            return False
        elif do == "stop_motion":
            self._stop_motion(reply)
        elif streamer is not None and word.on_print is not None:
            guest.of_print = guest.of_print or own or word.answers
            word.on_print(streamer, Asked(values, reply))
            self._note(action_of(request, values))
            if do in ("pause", "reload"):
                self.publish(streamer.status)
            return word.answers
        else:
            self._queue(Request(do, values, reply, read_actor(request.get("by"))))
        return do != "detach"

    def _note(self, action: dict[str, Any]) -> None:
        """Have an action written down by the thread that owns the port: this one mustn't wait."""
        if (streamer := self.streamer) is not None:
            streamer.note(action)
        else:
            self._actions.append(action)

    def _post(self, guest: Guest, message: dict[str, Any]) -> None:
        if self.server is not None:
            self.server.post(guest, message)

    def _hang_up(self, guest: Guest) -> None:
        if self.server is not None:
            self.server.hang_up(guest)

    def _tell(self, guest: Guest, do: str, of: str) -> None:
        """Send a status, and the next ones where that is wanted."""
        streamer = self.streamer
        if of == "print" and streamer is None:
            raise Refused(_NO_PRINT)
        if do == "subscribe":
            guest.subscribed, guest.of_print = of, of == "print"
        told = streamer.status.to_dict() if of == "print" and streamer else self.status.to_dict()
        asked = {"asked": True} if do == "status" else {}
        self._post(guest, {"event": "status", **asked, **told})

    def _queue(self, request: Request) -> None:
        """Have the thread that owns the port grant a request."""
        with self._lock:
            self._refuse_by_mode(request)
            if request.alone:
                self._alone = True
                if self.standby is not None:
                    self.standby.allow_motion()
            self._requests.append(request)
        self._bell.set()

    def _refuse_by_mode(self, request: Request) -> None:
        state, word = self.state, WORDS[request.do]
        if state is StationState.PRINTING:
            where = self._status.print_folder
            raise Refused(f"a print is running in {where}; pause or cancel it, or wait for its end")
        if word.idle is None:
            raise Refused(_NO_PRINT)
        if state in DOWN and not word.when_down:
            raise Refused(f"the station is {state.value}: {self.message}")
        if state is StationState.CONNECTING:
            raise Refused("the printer is being connected; wait for it to be ready")
        if request.alone and self._alone:
            raise Refused("a move is in progress; wait for its end, or stop it (stop_motion)")
        if len(self._requests) >= QUEUE:
            raise Refused(f"{QUEUE} requests are already queued; wait for them")

    def _stop_motion(self, reply: Reply) -> None:
        """End the move that goes on, and forget those that wait; the queue isn't waited for."""
        if self.state is StationState.PRINTING:
            raise Refused("a print is running; pause or cancel it instead")
        if self.state is StationState.BUSY and self._status.message == HOMING:
            raise Refused(
                "homing can't be stopped, as the firmware does it by itself. Wait for its end, or "
                "use the emergency stop; the position is then lost"
            )
        with self._lock:
            if self.standby is not None:
                self.standby.halt_motion()
            dropped = [one for one in self._requests if WORDS[one.do].idle is Idle.MOVES]
            for request in dropped:
                self._requests.remove(request)
            self._alone = self._alone and not dropped
        for request in dropped:
            request.reply(refusal(Refused("ended before it started")))
        reply(self._granted("stop_motion", {}))

    def _granted(self, do: str, answer: dict[str, Any]) -> dict[str, Any]:
        return {"event": "reply", "do": do, **answer, "status": self.status.to_dict()}

    # --- for the thread that owns the port: requests ---------------------------------------------

    def next_request(self, wait_s: float = 0.0) -> Request | None:
        """Return the oldest request; None where there is none within ``wait_s``."""
        if wait_s:
            self._bell.wait(wait_s)
        while self._actions:
            self.write_down("asked", **self._actions.popleft())
        with self._lock:
            self._bell.clear()
            return self._requests.popleft() if self._requests else None

    def answer(self, request: Request, answer: dict[str, Any]) -> None:
        """Tell how a request ended; whoever hears it may ask for the next one."""
        with self._lock:
            if request.alone:
                self._alone = False
        request.reply(answer)

    def grant(self, request: Request, answer: dict[str, Any] | None = None) -> None:
        """Tell that a request was granted."""
        self.answer(request, self._granted(request.do, answer or {}))

    def fall_silent(self, state: StationState, message: str, error: str) -> list[Request]:
        """Pass to a mode in which the printer can't be spoken to; return requests that waited."""
        self.known.lose_position()
        status = replace(self._status, state=state, message=message, error=error, position_mm=None)
        with self._lock:  # what is asked for from here on is of the next connection
            waiting, self._alone = list(self._requests), False
            self._requests.clear()
            self._status = self._with_known(replace(status, temperatures=()))
        if self.standby is not None:
            self.standby.end()
        self.streamer, self.switching = None, False
        return waiting

    # --- for the thread that owns the port: who speaks -------------------------------------------

    @property
    def listens_at(self) -> tuple[str, str]:
        """Address and token for its clients."""
        return self.address, self.server.token if self.server is not None else ""

    @property
    def reports(self) -> bool:
        """Whether the firmware can report temperatures unasked, so that no line waits for them."""
        standby = self.standby
        return standby is not None and standby.firmware.capabilities.get("AUTOREPORT_TEMP", False)

    def stand_by(self, standby: Standby) -> None:
        """Have the standby speak; a kill finds it from here on."""
        self.standby, self.streamer, self.switching = standby, None, False

    def begin_print(self, streamer: Streamer, print_id: str) -> None:
        """Have a print speak, and take requests."""
        self._print_id, self.streamer, self.switching = print_id, streamer, False
        if self.standby is not None:
            self.standby.end()
        if self.closing:  # the system shut down before the print could be stopped
            streamer.stop(SYSTEM)

    def end_print(self) -> None:
        """Hang up on the clients of a print that is over, and is in its records."""
        self.switching = True  # until the printer is stood by again, or can't be spoken to
        self.streamer, self._print_id = None, ""
        if self.server is not None:
            self.server.hang_up()

    # --- for the thread that owns the port: mode and status --------------------------------------

    def keep(self, record: ContactRecord) -> None:
        """Write down from now on, in a station's record, what must outlive the process."""
        self._record = record
        self._save_changes(self.status)

    def kept(self, status: StationStatus) -> ContactRecord | None:
        """Return a station's record as it would be saved now."""
        if self._record is None:
            return None
        return replace(self._record, status=status.to_dict())

    def _save_changes(self, status: StationStatus) -> None:
        facts = status.state, status.mounted
        record = self.kept(status)
        if record is None:
            return
        if facts != self._facts:
            self._facts = facts
            save_station(record, self.plug.folder)
        self._save_mounting(status)

    def _save_mounting(self, status: StationStatus) -> None:
        """Keep what is mounted; how full the syringe is isn't known if this process dies now."""
        plug, kept = self.plug, replace(self.known.mounting, printer=as_kept(self.plug.profile))
        if status.state is StationState.PRINTING:
            kept = replace(kept, plunger_mm=None)
        if not plug.simulated:
            kept = replace(kept, holder=str(plug.folder.resolve()))
        if kept != self._mounting:
            self._mounting = kept
            try:
                save_mounting(kept, plug.folder if plug.simulated else None)
            except OSError:  # a full disk mustn't end a station that holds a needle in a gel
                log.exception("the mounted parts can't be saved")

    def write_down(self, sort: str, **values: Any) -> None:
        """Add to the journal; a full disk mustn't keep a needle from being lifted."""
        try:
            if self.journal is not None:
                self.journal.add(sort, **values)
        except JournalError as exc:
            log.error("%s", exc)

    def enter(self, state: StationState, message: str, **values: Any) -> None:
        """Pass to a mode, and tell of it."""
        self._status = replace(self._status, state=state, message=message, **values)
        self.tell_live()

    def tell_live(self) -> None:
        """Tell what is known now."""
        standby, status = self.standby, self._status
        if standby is not None and status.open and status.state is not StationState.PRINTING:
            status = replace(
                status,
                firmware=standby.firmware.name,
                position_mm=standby.position,
                temperatures=standby.temperatures,
                readings=standby.readings,
            )
        self._status = self._with_known(status)
        self.publish()

    def _with_known(self, status: StationStatus) -> StationStatus:
        known, (low, high) = self.known, self._reach(status.position_mm)
        return replace(
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

    def _reach(self, at: Place | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the soft limits from here; reckoned anew when something has changed."""
        if at is None or not self.known.trusted:
            return (), ()
        asked = (self.known.bounds, at)
        if asked != self._reach_of:
            self._reach_of, self._reached = asked, reach(*asked)
        return self._reached


def serve_in(machine: Machine, folder: Path, parting: ExitStack, name: str = "link.sock") -> None:
    """Have clients reach a machine by a socket in a folder, until the parting."""
    listener, machine.address, token = listen(folder, name)
    machine.server = Server(listener, token, machine)
    parting.callback(forget, machine.address)
    parting.callback(machine.server.finish)
    machine.server.start()
