"""`printctl flow`: flow in a network or a part; options, results and figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import typer

from printctl.cli import options as cli
from printctl.cli.declare import json_command
from printctl.cli.design import flow_options as options
from printctl.cli.design.flow_options import SECTIONS
from printctl.settings import opt


@json_command
def flow(
    *,
    context: typer.Context,
    network: cli.SourceArg,
    unit: cli.UnitOption = None,
    out: Path = opt(
        "Folder for the tables; made where it isn't.", Path("flow"), callback=cli.folder_to_write
    ),
    typed: dict[str, Any] = SECTIONS,
    fluid: Path | None = opt("YAML with a recipe's flow.viscosity: model: carreau and so on."),
    stenosis: list[str] | None = opt(
        "Vessel, diameter left (0.1 to 1), length; may be given again.", metavar="VESSEL,SHARE,MM"
    ),
    shear_band_dyn_cm2: str | None = opt("Wall shear that is wanted.", metavar="LOW,HIGH"),
    svzerod: Path | None = opt("Write the problem for svZeroDSolver, too."),
    svoned: Path | None = opt("Write the pulsatile problem for svOneDSolver, too."),
    fillet_ratio: float | None = opt("3D: fillet radius relative to the thinnest vessel's radius."),
    as_printed: bool = opt(
        "For a run: compare the design with the lumens found by registration.", False
    ),
    scanned: bool = opt("3D as printed in the scan's own surface.", False),
    others: options.OtherSolvers,
    results: Literal["csv", "npz"] | None = opt(
        "Tables as csv, or as arrays of one npz (NumPy, fast)."
    ),
) -> None:
    """Solve the flow in a network: lumped; as waves (--one-d); in the lumens' space (--three-d).

    Steady, and in pulses, too, where a wave is given. --as-printed takes a registered run.
    """
    # Loaded late: --help needs no network, mesh or figure.
    from printctl.cli.design.flow_network import run_network

    output = run_network(context, network, out, others)
    for text in output.warnings:
        cli.print_warning(text)
    _say(output.summary, output.files)


def _say(summary: dict[str, Any], files: list[Path]) -> None:
    cli.print_notes(summary.get("notes", ()))
    cli.print_result(summary, lambda: [*_lines("", summary), *map(str, files)])


def _lines(before: str, values: dict[str, object]) -> Iterator[str]:
    """A line a number, the names of groups before theirs; notes are said as messages."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _lines(f"{before}{key} ", value)
        elif key != "notes":
            shown = f"{value:.6g}" if isinstance(value, int | float) else value
            yield f"{before}{key}: {shown}"
