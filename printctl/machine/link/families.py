"""Select the link protocol of a printer's firmware family, or refuse one that has none."""

from __future__ import annotations

from dataclasses import replace

from firmware_profiles import Printer, families
from firmware_profiles.families import LinkSetup
from firmware_profiles.families.family import LinkFacts
from firmware_profiles.families.link_protocol import LinkProtocol, Timing
from printctl.machine.link.care import Care
from printctl.machine.link.errors import Refused
from printctl.machine.link.modal import places


def refuse_unsent(printer: Printer, job: str = "the G-code file", then: str = "") -> None:
    """Refuse a printer that takes no lines from a host.

    Parameters
    ----------
    printer : Printer
    job : str
        What is to be loaded in its own software instead.
    then : str
        What else is to be done, a sentence.

    Raises
    ------
    Refused
        For a controller that runs a program file by itself.
    """
    if not printer.streamed:
        raise _unsent(printer, job, then)


def _unsent(printer: Printer, job: str = "the G-code file", then: str = "") -> Refused:
    return Refused(
        f"{printer.name} can't be driven from here: its controller runs a program file "
        f"by itself and takes no lines from a host. Load {job} in the controller's own "
        "software and run it there; pause, stop and the record of the print are that "
        "software's, too" + (f". {then}" if then else "")
    )


def protocol_for(printer: Printer, quiet_s: float, care: Care | None = None) -> LinkProtocol:
    """The state machine for a printer, on a wire of so much latency.

    Parameters
    ----------
    printer : Printer
    quiet_s : float
        See `printctl.machine.link.transport.Transport`.
    care : Care, optional
        Its limits on silence and noise.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    care = care or Care()
    facts = link_facts(printer)
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


def link_facts(printer: Printer) -> LinkFacts:
    """Return what the link knows of the family that a profile names.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    link = families.family_of(printer).link
    if link is None:
        raise _unsent(printer)
    return link
