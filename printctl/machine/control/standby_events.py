"""Handle a printer's events (errors, resets, lost port) while the station is in standby."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from firmware_profiles.families import link_protocol as said
from printctl.machine.control.channel import EventHandler
from printctl.machine.control.logbook import Logbook
from printctl.machine.records.states import LinkState, PrintEnded


class StandbyEvents:
    """Handles the events of a printer without a job; until it is found, as a print does.

    Parameters
    ----------
    logbook : Logbook
    halt : threading.Event
        Set to end the move that goes on.
    killed : threading.Event
        Set once a halt of the firmware was asked for: what is written then has answers of its own.
    otherwise : EventHandler
        Handles the rest: a print's.

    Attributes
    ----------
    found : bool
        Whether the printer was found and checked.
    trouble : str
        What is wrong now: read above its limit last, or what the printer complained of by itself.
    """

    def __init__(
        self,
        logbook: Logbook,
        halt: threading.Event,
        killed: threading.Event,
        otherwise: EventHandler,
    ) -> None:
        self._logbook, self._halt, self._killed = logbook, halt, killed
        self._otherwise = otherwise
        self.found = False
        self.trouble = ""
        self.step_made = otherwise.step_made
        self.between_commands = otherwise.between_commands
        self._always: dict[type, Callable[[Any], None]] = {
            said.Fault: self._on_fault,
            said.LinesResent: self._on_went_back,
            said.Action: self._on_action,
            said.Noisy: self._on_noisy,
            said.LostSynchronisation: self._on_out_of_step,
        }
        self._once_found: dict[type, Callable[[Any], None]] = {
            said.FirmwareStarted: self._on_booted,
            said.FirmwareReset: self._on_reset,
            said.StrayOk: self._on_stray,
            said.NoReply: self._on_silent,
            said.LineRefused: self._on_line_refused,
        }

    def handle(self, event: said.Event) -> None:
        """See `EventHandler`."""
        own = self._always.get(type(event))
        if own is None and self.found:
            own = self._once_found.get(type(event))
        (own or self._otherwise.handle)(event)

    # --- always ----------------------------------------------------------------------------------

    def _on_fault(self, event: said.Fault) -> None:
        self._logbook.complain(f"the printer says {event.text!r}", event.about_command)
        self._logbook.alarm(self._logbook.fault)

    def _on_went_back(self, event: said.LinesResent) -> None:
        self._logbook.alarm(
            f"lines {event.first} to {event.last} weren't taken after all; sent again"
        )

    def _on_action(self, event: said.Action) -> None:
        if event.name in ("pause", "paused", "cancel"):
            self._logbook.alarm(f"the printer asks for {event.name!r}")
            self._halt.set()

    def _on_noisy(self, event: said.Noisy) -> None:
        self.trouble = (
            f"{event.errors} line errors in {event.lines} lines: check cable and earthing"
        )
        self._logbook.alarm(self.trouble)

    def _on_out_of_step(self, event: said.LostSynchronisation) -> None:
        raise _lost_place(
            f"the printer's last line is {event.last}, ours {event.expected}: another program may "
            "have spoken to it; see that nothing else is connected, then reconnect"
        )

    # --- once it is found ------------------------------------------------------------------------

    def _on_booted(self, event: said.FirmwareStarted) -> None:
        self._otherwise.handle(event)  # by the reset line of a kill
        self._on_reset(said.FirmwareReset())

    def _on_reset(self, event: said.FirmwareReset) -> None:
        raise _lost_place(
            "the printer was reset: its position and its heaters' targets are gone; see what it "
            "stands in, then reconnect"
        )

    def _on_stray(self, event: said.StrayOk) -> None:
        if not event.foreign or self._killed.is_set():
            self._otherwise.handle(event)
            return
        raise _lost_place(
            f"the printer gave {event.foreign} more answers than lines: another program or noise "
            "wrote to it, and may have moved or renamed its place; see that nothing else "
            "is connected and where the tip stands, then reconnect"
        )

    def _on_silent(self, event: said.NoReply) -> None:
        raise PrintEnded(
            LinkState.FAILED,
            f"the printer gave no usable answer for {event.seconds:.0f} s; check power and cable, "
            "then reconnect",
            known=False,
        )

    def _on_line_refused(self, event: said.LineRefused) -> None:
        answer = f"; it answers {event.text!r}" if event.text else ""
        raise PrintEnded(
            LinkState.FAILED,
            f"the printer didn't take {event.command!r} in {event.times} tries{answer}; check "
            "cable, earthing and firmware, restart it, then reconnect",
            known=False,
        )


def _lost_place(message: str) -> PrintEnded:
    return PrintEnded(LinkState.POSITION_UNKNOWN, message, known=False)
