"""What a printer without a job may say, and what it means then."""

from __future__ import annotations

import threading

from firmware_profiles.families import link_protocol as said
from printctl.link.channel import Over, Wiring
from printctl.link.checking import Checking
from printctl.link.job import Job
from printctl.link.states import LinkState


class Listening(Checking):
    """Hears a printer that has no job; see `Checking` for the rest.

    Parameters
    ----------
    wiring : Wiring

    Attributes
    ----------
    trouble : str
        What was read above its limit last, or what the printer complained of unasked.
    """

    def __init__(self, wiring: Wiring) -> None:
        super().__init__(wiring, Job([], [], "", "no job"))
        self._begun = False
        self._halt = threading.Event()
        self.trouble = ""

    def _taken_fault(self) -> str:
        text, self._fault = self._fault, ""
        return text

    def _progress(self) -> str:
        return "no print was going on"

    def _record(self, sort: str, **values: object) -> None:
        if sort != "reading":  # once a second for days
            super()._record(sort, **values)

    def _on_fault(self, event: said.Fault) -> None:
        self._fault = self._fault or f"the printer says {event.text!r}"
        self._alarm(self._fault)

    def _on_went_back(self, event: said.WentBack) -> None:
        self._alarm(f"lines {event.first} to {event.last} weren't taken after all; sent again")
        if event.controls:
            self._awaited = event.first + len(event.controls) - 1

    def _on_action(self, event: said.Action) -> None:
        if event.name in ("pause", "paused", "cancel"):
            self._alarm(f"the printer asks for {event.name!r}")
            self._halt.set()

    def _on_noisy(self, event: said.Noisy) -> None:
        self.trouble = (
            f"{event.errors} line errors in {event.lines} lines: check cable and earthing"
        )
        self._alarm(self.trouble)

    def _on_booted(self, event: said.Booted) -> None:
        super()._on_booted(event)
        if self._begun:
            self._on_reset(said.WasReset())

    def _on_reset(self, event: said.WasReset) -> None:
        if not self._begun:
            super()._on_reset(event)
        raise Over(
            LinkState.POSITION_UNKNOWN,
            "the printer was reset: its position and its heaters' targets are gone; see what it "
            "stands in, then reconnect",
            known=False,
        )

    def _on_out_of_step(self, event: said.OutOfStep) -> None:
        raise Over(
            LinkState.POSITION_UNKNOWN,
            f"the printer's last line is {event.last}, ours {event.expected}: another program may "
            "have spoken to it; see that nothing else is connected, then reconnect",
            known=False,
        )

    def _on_silent(self, event: said.Silent) -> None:
        if not self._begun:
            super()._on_silent(event)
        raise Over(
            LinkState.FAILED,
            f"the printer gave no usable answer for {event.seconds:.0f} s; check power and cable, "
            "then reconnect",
            known=False,
        )
