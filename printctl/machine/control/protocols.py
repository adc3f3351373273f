"""Make the link protocol of a printer's firmware family."""

from __future__ import annotations

from dataclasses import replace

from firmware_profiles import Printer
from firmware_profiles.families import LinkSetup, family_of
from firmware_profiles.families.link_protocol import LinkProtocol, Timing
from printctl.machine.families import unsent
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import places


def protocol_for(printer: Printer, quiet_s: float, care: Care | None = None) -> LinkProtocol:
    """The state machine for a printer, on a wire of so much latency.

    Parameters
    ----------
    printer : Printer
    quiet_s : float
        See `printctl.machine.ports.transport.Transport`.
    care : Care, optional
        Its limits on silence and noise.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    care = care or Care()
    facts = family_of(printer)
    if facts.make_protocol is None:
        raise unsent(printer)
    timing = Timing(quiet_s=quiet_s, noise_window=care.noise_window, noise_limit=care.noise_limit)
    if care.silent_limit_s is not None:
        seconds = care.silent_limit_s
        if facts.remembers:
            timing = replace(timing, silent_limit_s=seconds)
        else:
            timing = replace(timing, busy_limit_s=seconds)
    setup = LinkSetup(
        timing, printer.lines_in_flight, printer.receive_buffer_bytes, places, printer.withholds
    )
    return facts.make_protocol(setup)
