"""`printctl flow`: flow in a network, a part, a solver's case; options, results and figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import typer

from printctl.analysis.flow import solver_cases
from printctl.cli import flow_options as options
from printctl.cli import options as cli
from printctl.cli.declare import json_command
from printctl.cli.flow_options import SECTIONS
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
    fillet_ratio: float | None = opt("Of 3D: fillet over the thinnest vessel's radius."),
    as_printed: bool = opt(
        "Of a run: as designed against the lumens that registration found.", False
    ),
    scanned: bool = opt("3D as printed in the scan's own surface.", False),
    others: options.OtherSolvers,
    results: Literal["csv", "npz"] | None = opt(
        "Tables as csv, or as arrays of one npz (NumPy, fast)."
    ),
) -> None:
    """Solve the flow in a network: lumped; as waves (--one-d); in the lumens' space (--three-d).

    Steady, and in pulses, too, where a wave is given. --as-printed takes a registered run. An
    input file of svZeroDSolver (.json) is run by its own package instead (the extra "svzerod"), one
    of openBF (.yaml) is solved as waves.
    """
    # What isn't handed on is read from the context, by the options' names.
    kind = results or "csv"
    if (case := solver_cases.read_svzerod(network)) is not None:
        _refuse_idle(context, ("network", "out", "results", "as_json"), "svZeroDSolver")
        file = out / f"{solver_cases.SVZEROD}.{kind}"
        summary, doubts = solver_cases.run_svzerod_case(case, network, file)
        for text in doubts:
            cli.print_warning(text)
        _say(summary, [file])
        return
    if (case := solver_cases.read_openbf(network)) is not None:
        known = ("network", "out", "results", "as_json", "cell_mm")
        _refuse_idle(context, known, "openBF")

        def where(own: str | None) -> Path:
            folder = out if cli.is_typed(context, "out") or own is None else Path(own)
            return folder / f"{solver_cases.OPENBF}.{kind}"

        with cli.messages().status("1D flow") as status:

            def tell(cycle: int, change: float) -> None:
                status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

            cell_mm = context.params["cell_mm"]
            summary, file = solver_cases.run_openbf_case(case, network, where, cell_mm, tell)
        _say(summary, [file])
        return
    # Loaded late: a case of svZeroDSolver needs no network, mesh or figure.
    from printctl.cli.flow_network import run_network

    output = run_network(context, network, out, others)
    for text in output.warnings:
        cli.print_warning(text)
    _say(output.summary, output.files)


def _refuse_idle(context: typer.Context, known: tuple[str, ...], solver: str) -> None:
    """Refuse an option typed that isn't among ``known``: the case says all else by itself."""
    others = (name for name in context.params if name not in known)
    cli.refuse_typed(context, others, f"is for networks; a case of {solver} says all by itself")


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
