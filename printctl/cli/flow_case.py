"""`printctl flow` on an svZeroDSolver input file: run that solver, write CSV or NPZ."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import typer

from design.errors import FlowError
from design.hemodynamics.json_keys import entries, parse_json
from design.hemodynamics.zero_d.svzerod_run import run_svzerod
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages
from printctl.errors import UsageError

CASE: Final = "svzerod"
_FOR_CASES: Final = ("network", "out", "results", "as_json")
_MARKS: Final = (
    {"boundary_conditions", "vessels"},
    {"boundary_conditions", "simulation_parameters"},
)


def read_case(path: Path) -> dict[str, Any] | None:
    """Return the JSON of an input file of svZeroDSolver; None for any other file.

    Raises
    ------
    FlowError
        As `parse_json`.
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
    if not isinstance(data, dict) or not any(marks <= set(data) for marks in _MARKS):
        return None
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
    file = out / f"{CASE}.{context.params['results'] or 'csv'}"
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
            f"the last cycle still changed by {run.change:.2g} of the largest value: the "
            "file's number_of_cardiac_cycles is too small for a periodic state", style="yellow"
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
