"""Make a host of its address; refuse what a host that runs the file can't do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from firmware_profiles import Printer
from printctl.machine.errors import Refused
from printctl.machine.families import link_facts
from printctl.machine.job.care import Care
from printctl.machine.network.duet import Duet
from printctl.machine.network.host import HostAddress, PrintHost
from printctl.machine.network.moonraker import Moonraker
from printctl.machine.network.octoprint import OctoPrint

_KINDS: Final[dict[str, Callable[[HostAddress, str], PrintHost]]] = {
    "moonraker": Moonraker,
    "octoprint": OctoPrint,
    "duet": Duet,
}


def make_host(address: HostAddress, key: str) -> PrintHost:
    """Return a host with a connection of its own; nothing is sent."""
    return _KINDS[address.kind](address, key)


def refuse_unsupported(
    kind: str, printer: Printer, care: Care, baud: int | str | None, prime_mm: float
) -> None:
    """Refuse a print that asks for what can't be done while a host runs the file.

    Raises
    ------
    Refused
        With everything that can't be done, and what to do instead.
    """
    if kind not in link_facts(printer).hosts:
        raise Refused(
            f"{printer.name} runs {printer.firmware}, which {kind} doesn't drive; check the port's "
            "name and the profile"
        )
    asked = list(_unsupported(printer, care, baud, prime_mm))
    if asked:
        raise Refused(
            f"{kind} runs the file by itself, and printctl can't hold it between two lines; "
            f"nothing was sent: {'; '.join(asked)}. Over serial or TCP all this holds"
        )


def _unsupported(
    printer: Printer, care: Care, baud: int | str | None, prime_mm: float
) -> Iterator[str]:
    if care.looks:
        yield "inspection while printing (omit observe)"
    if care.reload_at:
        yield "syringe changes (omit reload, or print a part that one syringe can print)"
    if care.deadman_s:
        yield "the dead-man timer (omit deadman)"
    if prime_mm:
        yield "extra ink after a pause (omit prime_ul)"
    if care.wire_log:
        yield "a wire log (omit it)"
    if baud is not None:
        yield "a baud rate (omit it; the host sets it)"
    if printer.pneumatic is not None:
        yield "a pneumatic valve (a host's cancel doesn't close it first)"
    if printer.watch:
        yield "readings monitored by printctl (omit watch in the profile)"
