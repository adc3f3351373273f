"""`printctl station connect`: start a background process that holds a printer's port open."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag, PrinterOption, three_numbers
from printctl.cli.station_options import FolderOption, folder_of, print_status
from printctl.machine.link.port_detection import read_baud
from printctl.machine.station import connect as open_station


def connect(
    printer: PrinterOption,
    port: Annotated[
        str,
        typer.Option("--port", help="Serial port, tcp:HOST:PORT, auto, or simulated."),
    ],
    baud: Annotated[
        str | None, typer.Option("--baud", help="In place of the profile's; auto tries its list.")
    ] = None,
    speed: Annotated[
        float,
        typer.Option(
            "--speed", help="Of a simulated printer, in times real time; 0 is all it can."
        ),
    ] = 1.0,
    start: Annotated[
        str,
        typer.Option("--start", metavar="X,Y,Z", help="Where a simulated printer's tip stands."),
    ] = "0,0,0",
    discard: Annotated[
        bool,
        typer.Option("--discard", help="Although the last print was interrupted; it is given up."),
    ] = False,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Connect a printer and stand by, in a process that goes on when this command ends.

    Nothing moves, but opening the port resets many boards: their position and heaters' targets
    are gone then.
    """
    station = open_station(
        printer,
        port,
        folder_of(folder),
        baud=read_baud(baud),
        sim_speed=speed,
        start_mm=three_numbers(start, "--start"),
        discard_interrupted=discard,
    )
    print_status(station.status, as_json)
