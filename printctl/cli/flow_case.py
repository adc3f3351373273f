"""`printctl flow` on an svZeroDSolver input file: run its cycles, write the last one as CSV."""

from __future__ import annotations

import json
from pathlib import Path

from design.hemodynamics.zero_d.svzerod import read_svzerod, run_svzerod, write_svzerod_csv
from printctl.cli.flow_solve import FlowOutput
from printctl.cli.options import messages

CASE = "svzerod.csv"


def is_svzerod(path: Path) -> bool:
    """Whether a file is an input of svZeroDSolver."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(data, dict) and {"boundary_conditions", "vessels"} <= set(data)


def run_case(path: Path, out: Path) -> FlowOutput:
    """Step through the file's cycles and write the last one.

    Raises
    ------
    FlowError, OSError
        As `read_svzerod` and `run_svzerod`.
    """
    case = read_svzerod(path)
    stepped = run_svzerod(case)
    out.mkdir(parents=True, exist_ok=True)
    write_svzerod_csv(out / CASE, case, stepped)
    told = {
        "vessels": len(case.names),
        "cycles": len(stepped.change),
        "last_change": float(stepped.change[-1]),
        "periodic": stepped.periodic,
    }
    if not stepped.periodic:
        messages().print(
            f"the last cycle still changed by {stepped.change[-1]:.2g} of the largest value: the "
            "file's number_of_cardiac_cycles is too small for a periodic state", style="yellow"
        )  # fmt: skip
    return FlowOutput(told, [out / CASE])
