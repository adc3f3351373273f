"""`printctl flow`: flow in a network, a part, a solver's case; options, results and figures."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import typer
import yaml

from design.errors import FlowError
from design.hemodynamics.json_keys import entries, parse_json
from design.hemodynamics.zero_d.svzerod_run import run_svzerod
from design.units import PA_PER_MMHG
from firmware_profiles.yaml_file import read_yaml
from printctl.cli import flow_options as options
from printctl.cli.declare import command
from printctl.cli.flow_options import SECTIONS, FlowOutput
from printctl.cli.options import (
    JsonFlag,
    SourceArg,
    UnitOption,
    folder_to_write,
    messages,
    print_json,
    print_lines,
    print_note,
)
from printctl.cli.section_options import Sections
from printctl.errors import UsageError
from printctl.settings import opt

_TYPED: Final = Sections(SECTIONS, dict)


@command
def flow(
    *,
    context: typer.Context,
    network: SourceArg,
    unit: UnitOption = None,
    out: Path = opt(
        "Folder for the tables; made where it isn't.", Path("flow"), callback=folder_to_write
    ),
    typed: dict[str, Any] = _TYPED,
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
    match: options.Match,
    results: Literal["csv", "npz"] | None = opt(
        "Tables as csv, or as arrays of one npz (NumPy, fast)."
    ),
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


# `printctl flow` on an svZeroDSolver input file: run that solver, write CSV or NPZ.

SVZEROD_CASE: Final = "svzerod"
_FOR_CASES: Final = ("network", "out", "results", "as_json")
_MARKS: Final = {"simulation_parameters", "boundary_conditions", "vessels", "junctions"}
"""Keys of a case; a network has vessels, too, but `_OF_NETWORKS` besides."""
_OF_NETWORKS: Final = {"format", "nodes"}


def read_case(path: Path) -> dict[str, Any] | None:
    """Return the JSON of an input file of svZeroDSolver; None for a network's and other files.

    Raises
    ------
    FlowError
        As `parse_json`, and for JSON that is neither.
    OSError
        When it can't be read.
    """
    if path.suffix.lower() != ".json" or not path.is_file():
        return None
    try:
        data = parse_json(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as exc:
        raise FlowError(f"{path} isn't text in UTF-8: {exc}") from exc
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc
    keys = set(data) if isinstance(data, dict) else set()
    if keys & _OF_NETWORKS and "simulation_parameters" not in keys:
        return None
    if not keys & _MARKS:
        raise FlowError(
            f"{path} is neither a network, which has format, nodes and vessels, nor a case of "
            f"svZeroDSolver, which has {', '.join(sorted(_MARKS))}"
        )
    return data


def run_case(context: typer.Context, data: dict[str, Any], path: Path, out: Path) -> FlowOutput:
    """Run the file's cycles and write what it asks for.

    Raises
    ------
    UsageError
        For an option that is for networks.
    FlowError, OSError
        As `run_svzerod`.
    """
    refuse_idle(context, _FOR_CASES, "svZeroDSolver")
    file = out / f"{SVZEROD_CASE}.{context.params['results'] or 'csv'}"
    out.mkdir(parents=True, exist_ok=True)
    try:
        summary: dict[str, object] = {"vessels": len(entries(data, "vessels"))}
        run = run_svzerod(data, file)
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc
    found = {"cycles": run.cycles, "last_change": run.change, "periodic": run.periodic}
    summary |= {key: value for key, value in found.items() if value is not None}
    if run.unused:
        messages().print(
            f"initial values of no variable of the model, left out: {', '.join(run.unused)}",
            style="yellow",
        )
        summary["initial_values_unused"] = list(run.unused)
    if run.periodic is False:
        messages().print(
            f"the last cycle still changed a vessel's flow or pressure by {run.change:.2g} of its "
            "mean: the file's number_of_cardiac_cycles is too small for a periodic state",
            style="yellow",
        )  # fmt: skip
    return FlowOutput(summary, [file])


def refuse_idle(context: typer.Context, known: tuple[str, ...], solver: str) -> None:
    """Raise for an option typed that isn't among ``known``: the case says all else by itself.

    Raises
    ------
    UsageError
    """
    for name in context.params:
        source = context.get_parameter_source(name)
        if name not in known and source is not None and source.name == "COMMANDLINE":
            raise UsageError(
                f"--{name.replace('_', '-')} is for networks; a case of {solver} says all by itself"
            )


# `printctl flow` on an openBF input file: solve its waves, write them as CSV or NPZ.

OPENBF_CASE: Final = "openbf"
_FOR_OPENBF_CASES: Final = ("network", "out", "results", "as_json", "cell_mm")


def read_openbf(path: Path) -> dict[str, Any] | None:
    """Return the YAML of an input file of openBF; None for any other file.

    Raises
    ------
    FlowError
        For YAML that can't be read.
    UsageError
        For YAML that isn't openBF's.
    OSError
        When it can't be read.
    """
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return None
    from design.hemodynamics.one_d import openbf

    try:
        data = read_yaml(path.read_text(encoding="utf-8-sig"))
    except (UnicodeDecodeError, yaml.YAMLError) as exc:
        raise FlowError(f"{path} isn't readable as YAML: {exc}") from exc
    if not openbf.is_openbf(data):
        raise UsageError(
            f"{path} has no network, blood and solver, as openBF's files have; a recipe runs by "
            "`printctl design`"
        )
    return dict(data)


def run_openbf_case(
    context: typer.Context, data: dict[str, Any], path: Path, out: Path
) -> FlowOutput:
    """Solve the case and write what the file asks for.

    Raises
    ------
    UsageError
        For an option that is for networks, or an inlet's table that isn't there.
    FlowError, OSError
        As `openbf.case_of`, `openbf_waves.run_openbf` and the writers.
    """
    from design.hemodynamics import question_pressure
    from design.hemodynamics.one_d import openbf, openbf_waves

    refuse_idle(context, _FOR_OPENBF_CASES, "openBF")
    try:
        case = openbf.case_of(data, _inlet(path, openbf.inlet_file(data)))
        if context.params["cell_mm"] is not None:
            options = replace(case.options, cell_mm=context.params["cell_mm"])
            case = replace(case, options=options)
        with messages().status("1D flow") as status:

            def tell(cycle: int, change: float) -> None:
                status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

            solution, waves = openbf_waves.run_openbf(case, tell)
        question_pressure(float(solution.pressure_high.max()))
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc
    source = context.get_parameter_source("out")
    typed = source is not None and source.name == "COMMANDLINE"
    folder = out if typed or case.folder is None else Path(case.folder)
    kind = context.params["results"] or "csv"
    file = folder / f"{OPENBF_CASE}.{kind}"
    write = openbf_waves.write_openbf_npz if kind == "npz" else openbf_waves.write_openbf_csv
    write(file, waves)
    summary: dict[str, object] = {
        "project": case.project,
        "vessels": len(case.labels),
        "cells": solution.cells,
        "steps": solution.steps,
        "cycles": len(solution.change),
        "last_change": float(solution.change[-1]),
        "mass_imbalance": solution.mass_imbalance,
        "pressure_min_mmhg": float(solution.pressure_low.min()) / PA_PER_MMHG,
        "pressure_max_mmhg": float(solution.pressure_high.max()) / PA_PER_MMHG,
    }
    if case.notes:
        summary["notes"] = list(case.notes)
    return FlowOutput(summary, [file])


def _inlet(path: Path, name: str) -> np.ndarray:
    """The inlet's table, beside the file or as its path says."""
    places = (path.parent / name, Path(name))
    table = next((place for place in places if place.is_file()), None)
    if table is None:
        raise UsageError(
            f"{path}: inlet_file {name} isn't beside it; put the table of time (s) and flow (m³/s) "
            "there"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty file is refused by its shape
            return np.loadtxt(table, ndmin=2)
    except ValueError as exc:
        raise FlowError(f"{table} isn't two columns of numbers: {exc}") from exc
