"""Run input files of other solvers: svZeroDSolver's JSON, openBF's YAML."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from design.errors import FlowError
from design.hemodynamics.other_solvers.json_keys import entries, parse_json
from design.hemodynamics.other_solvers.svzerod import run_svzerod
from design.units import PA_PER_MMHG
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import UsageError

SVZEROD: Final = "svzerod"
OPENBF: Final = "openbf"
Summary = dict[str, object]
_MARKS: Final = {"simulation_parameters", "boundary_conditions", "vessels", "junctions"}
"""Keys of a case; a network has vessels, too, but `_OF_NETWORKS` besides."""
_OF_NETWORKS: Final = {"format", "nodes"}


def read_svzerod(path: Path) -> dict[str, Any] | None:
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


def run_svzerod_case(data: dict[str, Any], path: Path, file: Path) -> tuple[Summary, list[str]]:
    """Run the cycles of a case read from ``path`` and write ``file``; return figures and warnings.

    Raises
    ------
    FlowError, OSError
        As `run_svzerod`.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        summary: Summary = {"vessels": len(entries(data, "vessels"))}
        run = run_svzerod(data, file)
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc
    found = {"cycles": run.cycles, "last_change": run.change, "periodic": run.periodic}
    summary |= {key: value for key, value in found.items() if value is not None}
    doubts = []
    if run.unused:
        doubts.append(
            f"initial values of no variable of the model, left out: {', '.join(run.unused)}"
        )
        summary["initial_values_unused"] = list(run.unused)
    if run.periodic is False:
        doubts.append(
            f"the last cycle still changed a vessel's flow or pressure by {run.change:.2g} of its "
            "mean: the file's number_of_cardiac_cycles is too small for a periodic state"
        )
    return summary, doubts


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
    from design.hemodynamics.other_solvers import openbf

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
    data: dict[str, Any],
    path: Path,
    where: Callable[[str | None], Path],
    cell_mm: float | None,
    tell: Callable[[int, float], None],
) -> tuple[Summary, Path]:
    """Solve a case read from ``path``; return its figures and the file written.

    Parameters
    ----------
    where : callable
        Name of the file to write, .npz or .csv, by the folder that the case names.
    cell_mm : float or None, mm
        In place of the case's own.
    tell : callable
        Gets the number of each cycle and its change.

    Raises
    ------
    UsageError
        For an inlet's table that isn't there.
    FlowError, OSError
        As `openbf.case_of`, `openbf.run_openbf` and the writers.
    """
    from design.hemodynamics import question_pressure
    from design.hemodynamics.other_solvers import openbf

    try:
        case = openbf.case_of(data, _inlet(path, openbf.inlet_file(data)))
        if cell_mm is not None:
            case = replace(case, options=replace(case.options, cell_mm=cell_mm))
        solution, waves = openbf.run_openbf(case, tell)
        question_pressure(float(solution.pressure_high.max()))
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc
    file = where(case.folder)
    npz = file.suffix == ".npz"
    write = openbf.write_openbf_npz if npz else openbf.write_openbf_csv
    write(file, waves)
    summary: Summary = {
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
    return summary, file


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
