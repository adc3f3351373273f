"""`printctl ports`: list serial ports and the printer profiles that match them."""

from __future__ import annotations

from typing import Any

import typer

from firmware_profiles import Printer, load, shipped
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.machine.link.port_detection import AUTO, locate, matches
from printctl.machine.link.ports import PortInfo, list_ports
from printctl.settings import opt


@command
def ports(
    printer: str | None = opt("Profile to look for, beside the shipped ones."),
    find: bool = opt(
        "Open the port that is --printer's, and try baud rates until it answers.", False
    ),
    as_json: JsonFlag = False,
) -> None:
    """List serial ports with their USB ids and the profiles that these match.

    Nothing is opened but with --find: that may reset the board, and moves nothing.
    """
    if find:
        _find(printer, as_json)
        return
    wanted = [*shipped(Printer), *filter(None, [printer])]
    known = {name: load(Printer, name) for name in wanted}
    rows = [(p, [n for n, facts in known.items() if matches(facts, p)]) for p in list_ports()]
    if as_json:
        print_json({"ports": [vars(port) | {"profiles": names} for port, names in rows]})
        return
    for port, names in rows:
        print_lines(_line(port, names))
    if not rows:
        messages().print(
            "no serial port found; plug the printer in, or use port: simulated in the recipe"
        )


def _line(port: PortInfo, profiles: list[str]) -> str:
    cells: list[Any] = [port.device, port.usb_id or "-", port.serial_number or "-"]
    return "\t".join([*cells, port.description, ", ".join(profiles) or "no profile's"])


def _find(printer: str | None, as_json: bool) -> None:
    if printer is None:
        raise typer.BadParameter("--find needs --printer: only a port with its USB id is opened")
    place = locate(AUTO, AUTO, load(Printer, printer))
    if as_json:
        print_json(vars(place))
        return
    print_lines(f"{place.port}\t{place.baud} Bd")
