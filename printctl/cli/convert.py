"""`printctl convert`: convert a vessel network between file formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from printctl.analysis.networks import LOSSES, check_target, read_noted, write_network
from printctl.cli.network_options import UnitOption
from printctl.cli.options import (
    JsonFlag,
    messages,
    print_json,
    print_lines,
    refuse_input_as_output,
)


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            help="Network: .csv, .vtp, .swc, .json, .npz, or X-CAVATE's .txt.", show_default=False
        ),
    ],
    target: Annotated[
        Path,
        typer.Argument(
            help="The same formats but .txt; without a suffix a new folder of SimVascular paths.",
            show_default=False,
        ),
    ],
    unit: UnitOption = None,
    ends: Annotated[
        Path | None,
        typer.Option("--inlet-outlet", help="Inlets and outlets that come with X-CAVATE's .txt."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Convert a vessel network between CSV, VTP, SWC, JSON and npz, and to SimVascular paths.

    X-CAVATE's networks (.txt, cm) are read, and their vessels joined. All our files are in mm, but
    for SWC (µm) and SimVascular's (cm). An old file is replaced only by a whole new one.
    """
    check_target(target)
    refuse_input_as_output(target, source)
    network, notes = read_noted(source, unit, ends)
    write_network(target, network)
    loss = LOSSES.get(target.suffix.lower())
    if as_json:
        facts = {"file": str(target), "vessels": network.vessel_count, "loses": loss}
        print_json(facts | {"notes": list(notes)})
        return
    for note in notes:
        messages().print(note, style="dim", markup=False)
    if loss:
        messages().print(f"[dim]{loss}[/]")
    print_lines(f"{target}: {network.vessel_count} vessels, {len(network.points)} points")
