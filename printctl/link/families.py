"""Firmware families: which state machine speaks to each, and what may be asked of it.

``verified`` families were tried against the transcripts of a real firmware; the others are built
after its public source or documentation, which each protocol's module names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from printctl.link.care import Care
from printctl.link.errors import Refused
from printctl.link.marlin_doubt import Timing
from printctl.link.pairing import Pairing
from printctl.link.protocol import LinkProtocol
from printctl.link.protocol_klipper import KlipperProtocol
from printctl.link.protocol_marlin import MarlinProtocol
from printctl.link.protocol_rrf import RrfProtocol
from printctl.link.protocol_smoothie import SmoothieProtocol


@dataclass(frozen=True)
class Family:
    """A firmware family.

    Attributes
    ----------
    says : str
        What its FIRMWARE_NAME (M115) contains, in small letters.
    make : callable
        Makes its state machine.
    verified : bool
        Whether a real one's transcripts were replayed against it.
    keepalive : bool
        Whether it can be told to say that it is busy (M113).
    tells_steps : bool
        Whether M92 tells the steps per mm.
    remembers : bool
        Whether it can be asked which line it took last, so that a print can be gone on with
        after the host died.
    """

    says: str
    make: Callable[[Timing], LinkProtocol]
    verified: bool = False
    keepalive: bool = True
    tells_steps: bool = True
    remembers: bool = True


FAMILIES: Final[dict[str, Family]] = {
    "marlin": Family("marlin", MarlinProtocol, verified=True),
    "prusa": Family("prusa", MarlinProtocol),
    "smoothieware": Family("smoothie", SmoothieProtocol, keepalive=False, tells_steps=False),
    "reprapfirmware": Family("reprapfirmware", RrfProtocol, keepalive=False, remembers=False),
    "klipper": Family(
        "klipper", KlipperProtocol, keepalive=False, tells_steps=False, remembers=False
    ),
}
"""By the profile's ``firmware``; an Aerotech controller isn't among them, see `refuse_unsent`."""


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
        For an Aerotech controller.
    """
    if not printer.streamed:
        raise Refused(
            f"{printer.name} can't be driven from here: an Aerotech controller runs a program file "
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
        See `printctl.link.transport.Transport`.
    care : Care, optional
        Its limits on silence and noise.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    refuse_unsent(printer)
    care = care or Care()
    timing = Timing(
        quiet_s=quiet_s,
        silent_limit_s=care.silent_limit_s,
        noise_window=care.noise_window,
        noise_limit=care.noise_limit,
    )
    if printer.lines_in_flight == 2:  # the profile allows it for Marlin and its fork alone
        return MarlinProtocol(timing, Pairing(printer.receive_buffer_bytes))
    return family_of(printer).make(timing)


def family_of(printer: Printer) -> Family:
    """The family that a profile names.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    refuse_unsent(printer)
    return FAMILIES[printer.firmware]
