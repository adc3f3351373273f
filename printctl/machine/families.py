"""Facts of a printer's firmware family for the link; refuse a printer that takes no lines."""

from __future__ import annotations

from firmware_profiles import Printer, families
from firmware_profiles.families import Family
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
        raise unsent(printer, job, then)


def unsent(printer: Printer, job: str = "the G-code file", then: str = "") -> Refused:
    """Return the refusal of a printer that takes no lines; see `refuse_unsent`."""
    return Refused(
        f"{printer.name} can't be driven from here: its controller runs a program file "
        f"by itself and takes no lines from a host. Load {job} in the controller's own "
        "software and run it there; pause, stop and the record of the print are that "
        "software's, too" + (f". {then}" if then else "")
    )


def link_facts(printer: Printer) -> Family:
    """Return what the link knows of the family that a profile names.

    Raises
    ------
    Refused
        For a printer that takes no lines.
    """
    family = families.family_of(printer)
    if family.make_protocol is None:
        raise unsent(printer)
    return family
