"""Run an svZeroDSolver input file by the package `svzerod`, in a process of its own.

The solver is the extra ``svzerod`` (github.com/SimVascular/svZeroDSolver, 3.2). Some faulty cases
end its process by a signal: a block without an inlet or outlet, an empty list.
"""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.files import atomic_replacement
from design.hemodynamics.json_keys import check_keys, flag, whole
from kernels.arrays import FloatArray

PERIODIC: Final = 1e-6
"""Largest change over a cycle, relative to the largest value, of a periodic state."""
MAX_STEPS: Final = 10_000_000
"""Of a run; the solver counts steps in 32 bits and keeps them all in memory."""
_OPTIONS: Final = "simulation_parameters"
_CYCLES: Final = "number_of_cardiac_cycles"
_POINTS: Final = "number_of_time_pts_per_cardiac_cycle"
_UNTIL_REPEATED: Final = "use_cycle_to_cycle_error"
_EXTRA_CYCLES: Final = re.compile(r"Ran simulation for (\d+) more cycles")
_MAX_MESSAGE: Final = 300
"""Characters of a solver's message that are shown; it may repeat a whole number of the file."""
_ALL: Final = ("flow_all", "pressure_all")
"""Initial values that stand for many variables."""
_SCRIPT: Final = """
import json, sys
import svzerod
try:
    svzerod.run_simulation_cli()
    solver, unused = svzerod.Solver(sys.argv[1]), []
    with open(sys.argv[1], encoding="utf-8") as file:
        given = json.load(file).get("initial_condition", {})
    for name in given:
        try:
            solver.get_single_result(name)
        except RuntimeError:
            unused.append(name)
except Exception as exc:
    sys.exit(str(exc))
print()
print(json.dumps(unused))
"""


@dataclass(frozen=True)
class SvZeroDRun:
    """Summary of a run whose results are written.

    Attributes
    ----------
    cycles : int or None
        Gone through; None where the solver derives them from the Windkessels' decay.
    change : float or None
        Of flows and pressures from begin to end of the last cycle, relative to the largest value
        of its kind; None where the results don't hold both.
    unused : tuple of str
        Initial values that the file gives for no variable of its model.
    """

    cycles: int | None
    change: float | None
    unused: tuple[str, ...] = ()

    @property
    def periodic(self) -> bool | None:
        """Whether the last cycle ended as it began."""
        return None if self.change is None else self.change <= PERIODIC


@dataclass(frozen=True)
class _Table:
    """Results by name: ``time`` (t,), empty of a mean, and each column (t, m)."""

    names: tuple[str, ...]
    time: FloatArray
    columns: dict[str, FloatArray]


def run_svzerod(data: Mapping[str, Any], path: Path) -> SvZeroDRun:
    """Run a case and write its results in svZeroDSolver's columns.

    Parameters
    ----------
    data : mapping
        The input file's content.
    path : Path
        The solver's own CSV; or, ending in .npz, NumPy arrays: ``name`` (m,), ``time`` (t,) and
        each column (t, m). All in the file's own units.

    Raises
    ------
    FlowError
        Without the package; for options that the solver would take for others; with its message
        where it refuses the case or finds no solution, with the signal where one ended it.
    OSError
        When a file can't be written.
    """
    if find_spec("svzerod") is None:
        raise FlowError(
            "a case of svZeroDSolver needs the package svzerod, which isn't installed; "
            "pip install 'printctl[svzerod]'"
        )
    how = _checked_options(data)
    until_repeated = how.get(_UNTIL_REPEATED, False)
    cycles = None if until_repeated else int(how[_CYCLES])
    with TemporaryDirectory(prefix="svzerod_") as folder:
        table = Path(folder) / "results.csv"
        said = _solve(data, table)
        extra = _EXTRA_CYCLES.search(said)
        if until_repeated and extra:
            cycles = int(how[_CYCLES]) + int(extra[1])
            if int(extra[1]):
                # Its table of added cycles is incomplete, and their times begin anew.
                how = {**how, _CYCLES: cycles, _UNTIL_REPEATED: False}
                said = _solve({**data, _OPTIONS: how}, table)
        found = _read(table)
        if not all(np.isfinite(column).all() for column in found.columns.values()):
            raise FlowError("the solution isn't finite; check values for their size and sign")
        with atomic_replacement(path) as draft:
            if path.suffix == ".npz":
                np.savez(draft, name=np.array(found.names), time=found.time, **found.columns)  # type: ignore[arg-type]
            else:
                shutil.copyfile(table, draft)
    unused = (name for name in json.loads(said.splitlines()[-1]) if name not in _ALL)
    named = tuple(name for name in unused if not name.startswith("_"))
    return SvZeroDRun(cycles, _change(found, how), named)


def _checked_options(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options, with counts that the solver wouldn't check."""
    how = data.get(_OPTIONS)
    if not isinstance(how, Mapping):
        check_keys(how, _OPTIONS, frozenset())
    how = dict(how or {})
    if flag(how, "coupled_simulation", _OPTIONS, default=False):
        raise FlowError(f"{_OPTIONS}: coupled_simulation needs the 3D solver that drives it")
    least = 2 if flag(how, _UNTIL_REPEATED, _OPTIONS, default=False) else 1
    how[_CYCLES] = whole(how, _CYCLES, _OPTIONS, least)
    how[_POINTS] = whole(how, _POINTS, _OPTIONS, 2)
    how["output_interval"] = whole(how, "output_interval", _OPTIONS, 1, 1)
    whole(how, "maximum_nonlinear_iterations", _OPTIONS, 2, 30)
    steps = how[_POINTS] - 1
    if how[_CYCLES] * steps > MAX_STEPS:
        raise FlowError(
            f"{_OPTIONS}: {how[_CYCLES]:,} {_CYCLES} of {steps:,} steps are "
            f"{how[_CYCLES] * steps:,} steps; the limit is {MAX_STEPS:,}; lower one of them"
        )
    return how


def _solve(data: Mapping[str, Any], table: Path) -> str:
    """Run the solver on a case; return what it printed."""
    case = table.with_suffix(".json")
    case.write_text(json.dumps(data), encoding="utf-8")
    command = [sys.executable, "-P", "-c", _SCRIPT, str(case), str(table)]
    done = subprocess.run(
        command, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if done.returncode == 0:
        return done.stdout
    if done.returncode > 0:
        raise FlowError(f"svZeroDSolver: {done.stderr.strip()[:_MAX_MESSAGE]}")
    by = signal.Signals(-done.returncode).name
    raise FlowError(
        f"svZeroDSolver crashed ({by}); it does so for a block without an inlet or outlet and for "
        "an empty list: check that boundary_conditions and junctions join each vessel at both ends"
    )


def _read(table: Path) -> _Table:
    with table.open(encoding="utf-8") as lines:
        keys = next(lines).strip().split(",")[2:]
        # From the right: a name may have commas.
        rows = [line.rsplit(",", len(keys) + 1)[:2] for line in lines]
    names = tuple(dict.fromkeys(name for name, _ in rows))
    if not names:
        return _Table((), np.zeros(0), {})
    count = len(rows) // len(names)
    time = np.array([float(text) for _, text in rows[:count] if text])
    places = range(-len(keys), 0)
    values = np.loadtxt(
        table, delimiter=",", skiprows=1, usecols=places, comments=None, encoding="utf-8", ndmin=2
    )
    values = values.reshape(len(names), count, len(keys))
    return _Table(names, time, {key: values[:, :, k].T for k, key in enumerate(keys)})


def _change(found: _Table, how: Mapping[str, Any]) -> float | None:
    """Return the change over the last cycle, if the results hold its begin and end."""
    parts, rest = divmod(how[_POINTS] - 1, how["output_interval"])
    if rest or len(found.time) <= parts:
        return None
    worst = 0.0
    for kind in ("flow", "pressure"):
        columns = [
            column[:, [name.startswith(kind) for name in found.names]] if key == "y" else column
            for key, column in found.columns.items()
            if key == "y" or key.startswith(kind)
        ]
        begin, end = (np.concatenate([c[row] for c in columns]) for row in (-1 - parts, -1))
        largest = float(np.abs(end).max(initial=0.0))
        if largest > 0.0:
            worst = max(worst, float(np.abs(end - begin).max()) / largest)
    return worst
