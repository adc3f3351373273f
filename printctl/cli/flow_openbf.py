"""`printctl flow` on an openBF input file: solve its waves, write them as CSV or NPZ."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import typer
import yaml

from design.errors import FlowError
from design.units import PA_PER_MMHG
from firmware_profiles.yaml_file import read_yaml
from printctl.cli.flow_case import refuse_idle
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages
from printctl.errors import UsageError

CASE: Final = "openbf"
_FOR_CASES: Final = ("network", "out", "results", "as_json", "cell_mm")


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

    refuse_idle(context, _FOR_CASES, "openBF")
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
    file = folder / f"{CASE}.{kind}"
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
