"""`printctl flow`: blood flow in any network, by 0D, 1D or 3D solver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from printctl.cli import flow_options as options
from printctl.cli.flow_case import read_case, run_case
from printctl.cli.flow_openbf import read_openbf, run_openbf_case
from printctl.cli.flow_output import FlowOutput
from printctl.cli.flow_part import SECTIONS
from printctl.cli.network_options import SourceArg, UnitOption
from printctl.cli.option_group import with_options, with_options_of
from printctl.cli.options import JsonFlag, print_json, print_lines, print_note
from printctl.cli.section_options import parameters


@with_options(parameters(SECTIONS), "typed", dict)
@with_options_of(options.OtherSolvers, "others")
@with_options_of(options.Match, "match")
def flow(
    context: typer.Context,
    network: SourceArg,
    *,
    unit: UnitOption = None,
    out: options.OutOption = Path("flow"),
    typed: dict[str, Any],
    fluid: options.FluidOption = None,
    stenosis: options.StenosisOption = None,
    shear_band_dyn_cm2: options.ShearBandOption = None,
    svzerod: options.SvzerodOption = None,
    svoned: options.SvonedOption = None,
    fillet_ratio: options.FilletOption = None,
    as_printed: options.AsPrintedFlag = False,
    scanned: options.ScannedFlag = False,
    others: options.OtherSolvers,
    match: options.Match,
    results: options.ResultsOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Solve the flow in a network: lumped; as waves (--one-d); in the lumens' space (--three-d).

    Steady, and in pulses, too, where a wave is given. --as-printed takes a registered run. An
    input file of svZeroDSolver (.json) is run by its own package instead (the extra "svzerod"), one
    of openBF (.yaml) is solved as waves.
    """
    # What isn't handed on is read from the context, by the options' names.
    case = read_case(network)
    if case is not None:
        _say(run_case(context, case, network, out), as_json)
        return
    openbf = read_openbf(network)
    if openbf is not None:
        _say(run_openbf_case(context, openbf, network, out), as_json)
        return
    # Loaded late: a case of svZeroDSolver needs no network, mesh or figure.
    from printctl.cli.flow_network import run_network

    _say(run_network(context, network, out, others, match), as_json)


def _say(output: FlowOutput, as_json: bool) -> None:
    for note in output.summary.get("notes", ()):
        print_note(f"note: {note}")
    if as_json:
        print_json(output.summary)
        return
    print_lines(*_lines("", output.summary), *map(str, output.files))


def _lines(before: str, values: dict[str, object]) -> list[str]:
    """A line a number, the names of groups before theirs."""
    lines: list[str] = []
    for key, value in values.items():
        if key == "notes":
            continue  # said as messages
        if isinstance(value, dict):
            lines += _lines(f"{before}{key} ", value)
        elif isinstance(value, int | float):
            lines.append(f"{before}{key}: {value:.6g}")
        else:
            lines.append(f"{before}{key}: {value}")
    return lines
