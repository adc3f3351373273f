"""Facts of a printer's firmware family for the link; refuse a printer that takes no lines."""

from __future__ import annotations

from firmware_profiles import Printer, families
from firmware_profiles.families.family import LinkFacts
from printctl.machine.errors import Refused


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
