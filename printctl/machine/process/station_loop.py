"""Main loop of a station's process: attend to the idle printer, serve requests, run prints."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any, Final

from printctl.machine.control.idle_commands import MOTIONS
from printctl.machine.control.known_state import Knowledge
from printctl.machine.control.station_status import Place, StationState, StationStatus
from printctl.machine.errors import LinkError, PortLost, Refused
from printctl.machine.process.link_owner import LinkOwner
from printctl.machine.process.open_connection import Socket
from printctl.machine.process.print_session import PrintSession
from printctl.machine.process.printer_connection import PrinterConnection
from printctl.machine.process.station_port import StationPort
from printctl.machine.process.station_report import DOWN, StationReport, refusal
from printctl.machine.process.station_requests import NAMES, Request, Say, StationRequests
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import PrintEnded

IDLE_S: Final = 0.03
"""Longest wait for the printer before requests are looked at."""
_DOWN_S: Final = 0.2
"""Longest wait for a request while nobody can be spoken to."""
_HALT: Final = b"\nM112\n"


class StationLoop:
    """Main loop of one station.

    Parameters
    ----------
    socket : Socket
    known : Knowledge
    journal : Journal
    start : (x, y, z), mm
        Where a simulated printer's tip stands.
    """

    def __init__(self, socket: Socket, known: Knowledge, journal: Journal, start: Place) -> None:
        self.known = known
        self._port, self._speaker = StationPort(socket, start), LinkOwner()
        self._report = StationReport(socket, known, journal, self._speaker)
        self._requests = StationRequests(self._report, self._speaker)
        self._connection = PrinterConnection(
            self._port, known, journal, self._report, self._requests, self._speaker
        )
        self._session = PrintSession(
            port=self._port,
            known=known,
            report=self._report,
            requests=self._requests,
            speaker=self._speaker,
            connection=self._connection,
            leave=self.leave,
        )

    # --- for any thread --------------------------------------------------------------------------

    @property
    def names(self) -> frozenset[str]:
        """Requests that are known."""
        return NAMES

    @property
    def status(self) -> StationStatus:
        """The station as it stands."""
        return self._report.status

    def subscribe(self, on_change: Callable[[StationStatus], None]) -> None:
        """Have someone told of each change."""
        self._report.subscribe(on_change)

    def ask(self, do: str, request: dict[str, Any], say: Say) -> None:
        """Take a request; see `StationRequests.ask`."""
        self._requests.ask(do, request, say)

    def leave(self) -> None:
        """Close, because the system shuts down; a print is stopped first."""
        self._speaker.close()
        if self._speaker.streamer is not None:
            self._speaker.streamer.stop()

    def kill(self) -> None:
        """Halt the firmware at once. Called in a thread of its own; nothing here waits for others.

        Whoever speaks to the printer may change meanwhile (a print begins or ends): then it is
        told to the next one as well.
        """
        speaker = self._speaker
        while True:
            current = speaker.current
            if current is not None:
                current.kill()
            transport = self._port.transport
            if self._report.state in DOWN and transport is not None:
                with contextlib.suppress(PortLost):
                    transport.write_urgent(_HALT)
            while speaker.switching and speaker.current is current:
                time.sleep(0.005)
            if speaker.current is current or speaker.closing:
                return

    # --- for the thread that owns the port -------------------------------------------------------

    def connect(self) -> None:
        """Connect the printer; see `PrinterConnection.connect`."""
        self._connection.connect()

    def run(self) -> None:
        """Serve until closed; the printer has been connected (`connect`)."""
        while not self._speaker.closing:
            try:
                if self._report.state in DOWN:
                    self._wait_down()
                else:
                    self._attend()
            except (PrintEnded, PortLost) as exc:
                self._connection.end_by(exc)
        if self._report.state is not StationState.CLOSED:
            self._close(None)

    def _attend(self) -> None:
        request = self._requests.take()
        if request is None:
            if self._speaker.standby is not None:
                self._speaker.standby.rest(IDLE_S)
            return
        try:
            if request.do == "print":
                self._session.print(request)
            elif request.do == "close":
                self._close(request)
            elif request.do == "reconnect":
                raise Refused("the printer is connected; close the station first, or kill")
            else:
                self._grant(request)
        except (PrintEnded, PortLost) as exc:
            error = exc if isinstance(exc, LinkError) else LinkError(str(exc))
            self._requests.answer(request, refusal(error))
            raise
        except LinkError as exc:
            self._requests.answer(request, refusal(exc))

    def _grant(self, request: Request) -> None:
        """Do what is asked for, and answer."""
        report, do = self._report, request.do
        report.write_down("asked", do=do, values=_plain(request.values))
        before = report.message
        if do in MOTIONS:
            report.tell(StationState.BUSY, do)
        try:
            if do == "mount":
                answer = self._mount(request.values)
            else:
                answer = self._connection.hands.requests[do](request.values)
        except Refused:
            report.tell(StationState.READY, before)
            raise
        except PortLost:
            raise
        except LinkError as exc:
            report.tell(StationState.READY, str(exc))
            raise
        except (KeyError, TypeError, ValueError, AttributeError) as exc:
            report.tell(StationState.READY, before)
            raise Refused(f"{do} can't be read: {exc!r}") from exc
        report.tell(StationState.READY, str(answer.get("message") or "ready"))
        self._requests.grant(request, answer)

    def _mount(self, values: dict[str, Any]) -> dict[str, Any]:
        mounted = _plain(values)
        if self.known.printer.heads and {"needle", "dish", "syringe"} & set(mounted):
            raise Refused(
                f"{self.known.printer.name} has several heads; what each of them holds can't be "
                "told to a station yet, only to a print"
            )
        self.known.mount(mounted)
        return {}

    def _wait_down(self) -> None:
        self._requests.wait(_DOWN_S)
        request = self._requests.take()
        if request is None:
            return
        try:
            if request.do == "close":
                self._close(request)
            elif request.do == "mount":
                self._mount(request.values)
                self._report.tell_live()
                self._requests.grant(request, {})
            else:
                self._connection.reconnect()
                self._requests.grant(request, {})
        except LinkError as exc:
            self._requests.answer(request, refusal(exc))

    def _close(self, request: Request | None) -> None:
        """Switch the heaters off where the printer answers, and let go of the port."""
        message, standby = "closed", self._speaker.standby
        if self._report.state not in DOWN and standby is not None:
            with contextlib.suppress(LinkError, PrintEnded):
                on = ", ".join(standby.let_go())
                message = f"closed; {on} stays on (safe_state_on)" if on else "closed; heaters off"
        self._speaker.close()
        if standby is not None:
            standby.end()
        self._port.close()
        self.known.lose_position()
        self._report.write_down("state", state="closed", message=message)
        self._report.tell(StationState.CLOSED, message, position_mm=None)
        if request is not None:
            self._requests.grant(request, {})


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Return a request's values without its name and token."""
    return {key: value for key, value in values.items() if key not in ("do", "token")}
