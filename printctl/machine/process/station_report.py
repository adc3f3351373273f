"""Keep a station's status, send it to clients, and write it to the journal."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from printctl.checks.gate import Bounds, reach
from printctl.machine.control.heat import parse_temperatures
from printctl.machine.control.known_state import Knowledge
from printctl.machine.control.station_status import Place, StationState, StationStatus
from printctl.machine.errors import JournalError, LinkError
from printctl.machine.process.link_owner import LinkOwner
from printctl.machine.process.open_connection import Socket
from printctl.machine.records.journal import Journal

DOWN: Final = frozenset({StationState.HALTED, StationState.LOST})

_UP: Final = frozenset({StationState.CONNECTING, StationState.READY, StationState.BUSY})
_HALTING: Final = (
    "a halt was sent and the printer hasn't confirmed it yet; if anything moves, cut its power"
)

log = logging.getLogger(__name__)


class StationReport:
    """Owns the status; any thread may read it.

    Parameters
    ----------
    socket : Socket
    known : Knowledge
    journal : Journal
    speaker : LinkOwner
    """

    def __init__(
        self, socket: Socket, known: Knowledge, journal: Journal, speaker: LinkOwner
    ) -> None:
        self._known, self._journal, self._speaker = known, journal, speaker
        self._on_change: Callable[[StationStatus], None] = lambda status: None
        self._status = StationStatus(
            StationState.CONNECTING, profile=socket.profile, port=socket.port
        )
        self._reach_of: tuple[Bounds, Place] | None = None
        self._reached: tuple[tuple[float, ...], tuple[float, ...]] = (), ()

    # --- for any thread --------------------------------------------------------------------------

    @property
    def state(self) -> StationState:
        """Where the station stands."""
        return self._status.state

    @property
    def message(self) -> str:
        """What happened last, the trouble of the moment apart."""
        return self._status.message

    @property
    def print_folder(self) -> str:
        """Of the print that goes on, or was last; empty for none."""
        return self._status.print_folder

    @property
    def status(self) -> StationStatus:
        """The station as it stands."""
        status, speaker = self._status, self._speaker
        streamer, standby = speaker.streamer, speaker.standby
        if streamer is None or status.state is not StationState.PRINTING:
            if standby is not None and standby.halt_asked and status.state in _UP:
                return replace(status, state=StationState.HALTING, message=_HALTING)
            trouble = standby.trouble if standby is not None and status.open else ""
            return replace(status, message=trouble or status.message)
        printing = streamer.status
        message = f"{printing.state.value}: {printing.message}"
        warm = parse_temperatures((streamer.protocol.report,)) or status.temperatures
        return replace(status, message=message, readings=printing.readings, temperatures=warm)

    def subscribe(self, on_change: Callable[[StationStatus], None]) -> None:
        """Have someone told of each change."""
        self._on_change = on_change

    def reply(self, do: str, answer: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to a request that was granted."""
        return {"event": "reply", "do": do, **answer, "status": self.status.to_dict()}

    # --- for the thread that owns the port -------------------------------------------------------

    def write_down(self, sort: str, **values: Any) -> None:
        """Add to the journal; a full disk mustn't keep a needle from being lifted."""
        try:
            self._journal.add(sort, **values)
        except JournalError as exc:
            log.error("%s", exc)

    def enter(self, state: StationState) -> None:
        """Pass to a state that is told of later."""
        self._status = replace(self._status, state=state)

    def tell(self, state: StationState, message: str, **values: Any) -> None:
        """Pass to a state, and tell of it."""
        self._status = replace(self._status, state=state, message=message, **values)
        self.tell_live()

    def tell_live(self) -> None:
        """Tell what is known now."""
        standby, known, status = self._speaker.standby, self._known, self._status
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
        self.publish()

    def publish(self) -> None:
        """Tell the status as it stands."""
        self._on_change(self.status)

    def _reach(self, at: Place | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the soft limits from here; reckoned anew when something has changed."""
        if at is None or not self._known.trusted:
            return (), ()
        asked = (self._known.bounds, at)
        if asked != self._reach_of:
            self._reach_of, self._reached = asked, reach(*asked)
        return self._reached


def refusal(exc: LinkError) -> dict[str, Any]:
    """Return the answer to a request that wasn't granted."""
    return {"event": "refused", "message": str(exc), "error": type(exc).__name__}
