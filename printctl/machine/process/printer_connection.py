"""Connect a station to its printer, notice the printer's loss, and reconnect."""

from __future__ import annotations

from printctl.machine.control.connecting import protocol_for
from printctl.machine.control.idle_commands import AXES, IdleCommands
from printctl.machine.control.known_state import Knowledge
from printctl.machine.control.standby import Standby
from printctl.machine.control.station_status import StationState
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import HandshakeError, LinkError, PortLost
from printctl.machine.ports.clock import RealClock
from printctl.machine.process.link_owner import LinkOwner
from printctl.machine.process.station_port import StationPort
from printctl.machine.process.station_report import StationReport, refusal
from printctl.machine.process.station_requests import StationRequests
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import LinkState, PrintEnded


class PrinterConnection:
    """Finds the printer at the port, and notices when it is gone.

    Parameters
    ----------
    port : StationPort
    known : Knowledge
    journal : Journal
    report : StationReport
    requests : StationRequests
    speaker : LinkOwner
    """

    def __init__(
        self,
        port: StationPort,
        known: Knowledge,
        journal: Journal,
        report: StationReport,
        requests: StationRequests,
        speaker: LinkOwner,
    ) -> None:
        self._port, self._known, self._journal = port, known, journal
        self._report, self._requests, self._speaker = report, requests, speaker
        self._hands: IdleCommands | None = None

    @property
    def hands(self) -> IdleCommands:
        """What a person may ask the standing printer to do.

        Raises
        ------
        PortLost
            Before it was connected.
        """
        if self._hands is None:
            raise PortLost(f"{self._port.socket.port} isn't open")
        return self._hands

    @property
    def reports(self) -> bool:
        """Whether the firmware can tell its temperatures unasked, so that no line waits for it."""
        standby = self._speaker.standby
        return standby is not None and standby.firmware.capabilities.get("AUTOREPORT_TEMP", False)

    def connect(self, ready: str = "ready", *, trusted: bool = True) -> None:
        """Open the port, find the printer and check it; ``ready`` is said when that is done.

        A simulated printer, ``trusted``, stands where it was started; after a stop it isn't: like
        any board it must be homed then, or told its place.

        Raises
        ------
        LinkError
            When that fails; the port is let go of.
        """
        port, report = self._port, self._report
        self._speaker.switch()
        report.tell(StationState.CONNECTING, f"opening {port.socket.port}", error="")
        try:
            port.open()
            self.stand_by(fresh=True)
        except (PrintEnded, LinkError) as exc:
            port.close()
            raise exc if isinstance(exc, LinkError) else HandshakeError(exc.message) from exc
        finally:
            self._speaker.switched()
        if port.socket.simulated and trusted:
            self.hands.declare(port.start, set(AXES))
        report.write_down("state", state="ready", message="connected", port=port.socket.port)
        report.tell(StationState.READY, ready)

    def stand_by(self, fresh: bool) -> None:
        """Speak through the open port."""
        transport, printer = self._port.opened(), self._known.printer
        wiring = Wiring(
            transport=transport,
            protocol=protocol_for(printer, transport.quiet_s),
            clock=RealClock(),
            journal=self._journal,
            printer=printer,
            fresh=fresh,
        )
        standby = Standby(wiring, self._port.socket.pace, self._report.tell_live)
        self._speaker.stand_by(standby)
        standby.begin()
        self._hands = IdleCommands(standby, self._known)

    def reconnect(self) -> None:
        """Connect once more.

        Raises
        ------
        LinkError
            When that fails; the station is down.
        """
        self._port.close()
        try:
            self.connect(trusted=False)
        except LinkError as exc:
            self.down(StationState.LOST, str(exc), type(exc).__name__)
            raise

    # --- down ------------------------------------------------------------------------------------

    def end_by(self, exc: PrintEnded | PortLost) -> None:
        """Take notice that the printer has halted or is gone, and its place with it."""
        if isinstance(exc, PortLost):
            self.down(StationState.LOST, str(exc), type(exc).__name__)
            return
        lost = exc.state is LinkState.FAILED or exc.error == PortLost.__name__
        self.down(StationState.LOST if lost else StationState.HALTED, exc.message, exc.error)

    def down(self, state: StationState, message: str, error: str = "") -> None:
        """Take notice that the printer can't be used until it is connected again."""
        if state is StationState.LOST:
            self._port.close()
        standby, report = self._speaker.standby, self._report
        if standby is not None and standby.position is not None:
            self._port.stands_at(standby.position)
        self._speaker.fall_silent()
        self._known.lose_position()
        report.write_down("state", state=state.value, message=message)
        waiting = self._requests.drop_all(state)
        remedy = "" if "reconnect" in message else "; see to the printer, then reconnect"
        report.tell(state, message + remedy, error=error, position_mm=None, temperatures=())
        for request in waiting:
            request.say(refusal(LinkError(message)))
