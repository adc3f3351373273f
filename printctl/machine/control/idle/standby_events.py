"""Handle a printer's events (errors, resets, lost port) while the station is in standby."""

from __future__ import annotations

import threading

from firmware_profiles.families import link_protocol as wire
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.events import PrintEvents
from printctl.machine.control.requests import RequestQueue
from printctl.machine.records.states import LinkState, PrintEnded


class StandbyEvents(PrintEvents):
    """Handles the events of a printer without a job; until it is found, mostly as a print does.

    ``halt`` is set to end the move that goes on.

    Attributes
    ----------
    found : bool
        Whether the printer was found and checked.
    trouble : str
        What is wrong now: read above its limit last, or what the printer complained of by itself.
    """

    def __init__(self, channel: Channel, halt: threading.Event) -> None:
        super().__init__(channel, RequestQueue())
        self._halt = halt
        self.found, self.trouble = False, ""

    # --- always ----------------------------------------------------------------------------------

    def _on_fault(self, event: wire.Fault) -> None:
        self._logbook.complain(f"the printer reports {event.text!r}", event.about_command)
        self._logbook.alarm(self._logbook.fault)

    def _on_went_back(self, event: wire.LinesResent) -> None:
        self._logbook.alarm(
            f"lines {event.first} to {event.last} weren't accepted after all; sent again"
        )

    def _on_action(self, event: wire.Action) -> None:
        if event.name in ("pause", "paused", "cancel"):
            self._logbook.alarm(f"the printer requests {event.name!r}")
            self._halt.set()

    def _on_noisy(self, event: wire.Noisy) -> None:
        self.trouble = (
            f"{event.errors} line errors in {event.lines} lines: check cable and grounding"
        )
        self._logbook.alarm(self.trouble)

    def _on_out_of_step(self, event: wire.LostSynchronisation) -> None:
        raise _lost_place(
            f"the printer's last line is {event.last}, the host's is {event.expected}: another "
            "program may have sent commands; check that nothing else is connected, then reconnect"
        )

    # --- once it is found ------------------------------------------------------------------------

    def _on_booted(self, event: wire.FirmwareStarted) -> None:
        super()._on_booted(event)  # by the reset line of a kill
        if self.found:
            self._on_reset(wire.FirmwareReset())

    def _on_reset(self, event: wire.FirmwareReset) -> None:
        if not self.found:
            super()._on_reset(event)
        raise _lost_place(
            "the printer was reset: position and heater targets are lost; check what the needle is "
            "in, then reconnect"
        )

    def _on_renumbered(self, event: wire.Renumbered) -> None:
        if not self.found:
            super()._on_renumbered(event)
            return
        raise _lost_place(
            f"the printer's line counter became {event.last}, but the host's is {event.expected}: "
            "the board was reset silently, or another program writes to this port (M110); check "
            "where the tip is and that nothing else is connected, then reconnect"
        )

    def _on_stray(self, event: wire.StrayOk) -> None:
        if not self.found or not event.foreign or self._kill.asked.is_set():
            super()._on_stray(event)
            return
        raise _lost_place(
            f"the printer sent {event.foreign} more replies than lines: another program or noise "
            "wrote to it, and may have moved it or changed its position; check that nothing else "
            "is connected and where the tip is, then reconnect"
        )

    def _on_silent(self, event: wire.NoReply) -> None:
        if not self.found:
            super()._on_silent(event)
        raise PrintEnded(
            LinkState.FAILED,
            f"no valid reply from the printer for {event.seconds:.0f} s; check power and cable, "
            "then reconnect",
            known=False,
        )

    def _on_line_refused(self, event: wire.LineRefused) -> None:
        if not self.found:
            super()._on_line_refused(event)
        answer = f"; it replies {event.text!r}" if event.text else ""
        raise PrintEnded(
            LinkState.FAILED,
            f"the printer didn't accept {event.command!r} in {event.times} attempts{answer}; check "
            "cable, grounding and firmware, restart it, then reconnect",
            known=False,
        )


def _lost_place(message: str) -> PrintEnded:
    return PrintEnded(LinkState.POSITION_UNKNOWN, message, known=False)
