"""`printctl ports`: which serial ports there are."""

from __future__ import annotations

from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.link.ports import list_ports


def ports(as_json: JsonFlag = False) -> None:
    """List the serial ports of this machine, with what is known of the board behind each."""
    found = list_ports()
    if as_json:
        print_json({"ports": [vars(port) for port in found]})
        return
    print_lines(*(f"{port.device}\t{port.description}" for port in found))
    if not found:
        messages().print(
            "no serial port found; plug the printer in, or use port: simulated in the recipe"
        )
