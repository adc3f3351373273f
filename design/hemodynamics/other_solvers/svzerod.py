"""Write networks as svZeroDSolver's JSON input, in cm, g, s; run such a file.

Not in SI: its default absolute tolerance, 1e-8, would take flows in m³/s for converged zeros.
"""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.files import atomic_replacement, write_text
from design.hemodynamics.conditions import (
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
)
from design.hemodynamics.other_solvers.json_keys import check_keys, entries, flag, whole
from design.hemodynamics.other_solvers.network_case import (
    closed_cycle,
    network_case,
    outlet_values,
)
from design.hemodynamics.vessel_coefficients import PARABOLIC, plug_inertance, vessel_resistance
from design.hemodynamics.waveforms import Waveform
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, DYN_S_CM5_PER_PA_S_UL
from kernels.arrays import FloatArray


def write_svzerod(
    path: Path,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    steps: int = 100,
    cycles: int = 10,
) -> None:
    """Write `svzerod_input` as JSON.

    Raises
    ------
    FlowError
        As `svzerod_input`.
    OSError
        When the file can't be written.
    """
    write_text(path, json.dumps(svzerod_input(network, conditions, steps, cycles), indent=1) + "\n")


def svzerod_input(
    network: VesselNetwork, conditions: PulsatileConditions, steps: int = 100, cycles: int = 10
) -> dict[str, Any]:
    """The input file's content.

    Its vessels are R, C, L in this order, ours a Π; they agree as vessels get short.

    Raises
    ------
    FlowError
        What the format can't say: an inlet or outlet where not exactly one vessel begins or
        ends, several inlets on one flow, Womersley's impedance.
    """
    if conditions.profile == "womersley":
        raise FlowError("svZeroDSolver has no Womersley impedance; choose the poiseuille profile")
    case = network_case(network, conditions, "svZeroDSolver")
    flow = conditions.inlet_is == "flow"
    if flow and len(case.inlets) > 1:
        raise FlowError(
            f"{len(case.inlets)} inlets share one flow, which svZeroDSolver can't say; give them a "
            "pressure, or join them by a vessel"
        )

    def wave(name: str, waveform: Waveform, kind: str, scale: float) -> dict[str, Any]:
        time, value = closed_cycle(waveform, case.period_s, steps, scale)
        values = {"Q" if kind == "FLOW" else "P": value.tolist(), "t": time.tolist()}
        return {"bc_name": name, "bc_type": kind, "bc_values": values}

    at = {node: f"INLET_{node}" for node in case.inlets}
    at |= {node: f"OUTLET_{node}" for node in case.outlets}
    kind = "FLOW" if flow else "PRESSURE"
    blocks = [wave(at[n], conditions.inlet, kind, case.inlet_scale) for n in case.inlets]
    for node, outlet in case.outlets.items():
        if isinstance(outlet, PressureOutlet):
            blocks.append(wave(at[node], outlet.waveform, "PRESSURE", DYN_CM2_PER_PA))
        else:
            kind = "RESISTANCE" if isinstance(outlet, ResistanceOutlet) else "RCR"
            blocks.append(
                {"bc_name": at[node], "bc_type": kind, "bc_values": outlet_values(outlet)}
            )
    return {
        "simulation_parameters": {
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": steps + 1,
            "output_all_cycles": False,
        },
        "boundary_conditions": blocks,
        "junctions": [
            {
                "junction_name": f"J{node}",
                "junction_type": "NORMAL_JUNCTION",
                "inlet_vessels": into,
                "outlet_vessels": out,
            }
            for node, (into, out) in case.joints.items()
        ],
        "vessels": _vessels(network, conditions, at),
    }


def _vessels(
    network: VesselNetwork, conditions: PulsatileConditions, at: Mapping[int, str]
) -> list[dict[str, Any]]:
    """Blocks of vessels; ``at`` names the boundary conditions by node."""
    lengths = network.lengths() / 10.0
    resistance = vessel_resistance(network, conditions.viscosity_pa_s) * DYN_S_CM5_PER_PA_S_UL
    inertance = PARABOLIC * plug_inertance(network, conditions.density) * DYN_S_CM5_PER_PA_S_UL
    compliance = conditions.wall.compliance(network) / DYN_S_CM5_PER_PA_S_UL
    vessels = []
    for k, ends in enumerate(network.vessel_nodes.tolist()):
        vessel: dict[str, Any] = {
            "vessel_id": k,
            "vessel_name": f"branch{k}_seg0",
            "vessel_length": float(lengths[k]),
            "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": {
                "R_poiseuille": float(resistance[k]),
                "C": float(compliance[k]),
                "L": float(inertance[k]),
            },
        }
        sides = zip(("inlet", "outlet"), ends, strict=True)
        named = {side: at[node] for side, node in sides if node in at}
        vessels.append(vessel | ({"boundary_conditions": named} if named else {}))
    return vessels


# Run an svZeroDSolver input file by the package `svzerod`, in a process of its own.
#
# The solver is the extra ``svzerod`` (github.com/SimVascular/svZeroDSolver, 3.2). Some faulty cases
# end its process by a signal: a block without an inlet or outlet, an empty list. Case and results
# go through pipes, so that a full disk can't shorten them.


class RunLimits(NamedTuple):
    """Limits of a run."""

    periodic_change: float = 1e-6
    """Largest change over a cycle, relative to a column's mean magnitude, of a periodic state."""
    min_scale: float = 1e-3
    """Of the largest mean magnitude of its kind: smaller ones are noise of the solver."""
    max_steps: int = 10_000_000
    """The solver counts steps in 32 bits and, with output_all_cycles, keeps them all."""
    max_message: int = 300
    """Characters of a solver's message that are shown; it may repeat a whole number of the file."""


LIMITS: Final = RunLimits()
_OPTIONS: Final = "simulation_parameters"
_CALIBRATION: Final = "calibration_parameters"
_CYCLES: Final = "number_of_cardiac_cycles"
_POINTS: Final = "number_of_time_pts_per_cardiac_cycle"
_UNTIL_REPEATED: Final = "use_cycle_to_cycle_error"
_EXTRA_CYCLES: Final = re.compile(r"Ran simulation for (\d+) more cycles")
_ALL: Final = ("flow_all", "pressure_all")
"""Initial values that stand for many variables."""
_NAMES: Final = (
    ("vessels", "vessel_id"), ("vessels", "vessel_name"), ("boundary_conditions", "bc_name"),
    ("junctions", "junction_name"), ("valves", "name"), ("chambers", "name"),
)  # fmt: skip
"""Lists of a case, and what names their blocks."""
_ELEMENT: Final = re.compile(r"[RC]\w*")
"""Resistances and compliances; a calibration can make coefficients of a stenosis negative."""
_BODIES: Final = ("chambers", "valves", "closed_loop_blocks")
"""Lists that a case may have in place of vessels."""
_EXIT_CODES: Final = {"no package": 3, "no memory": 4}
"""Of the script below."""
_FAULTS: Final = ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV")
"""Signals by which a process ends by a fault of its own; others come from outside."""
_LESS_MEMORY: Final = (
    "it keeps all results in memory: set the case's output_all_cycles to false, raise its "
    f"output_interval, lower its {_POINTS}, or free memory"
)
_SCRIPT: Final = """
import json, os, signal, sys, types
solver = os.getpid()
if os.fork() == 0:
    # The solver holds the interpreter's lock: this process ends it when printctl is gone.
    os.closerange(0, 3)
    os.read(int(sys.argv[1]), 1)
    if os.getppid() == solver:
        os.kill(solver, signal.SIGKILL)
    os._exit(0)
answer = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="replace")
os.dup2(2, 1)
try:
    import svzerod
except Exception as exc:
    answer.write(f"{type(exc).__name__}: {exc}")
    sys.exit(3)
# The table is given to pandas, which rounds its numbers: the text is taken instead.
sys.modules["pandas"] = types.SimpleNamespace(read_csv=lambda table: table.getvalue())
try:
    case = json.load(sys.stdin, parse_int=lambda n: int(n) if len(n) < 19 else float(n))
    run, unused = svzerod.Solver(case), []
    run.run()
    table = run.get_full_result()
    for name in case.get("initial_condition", {}):
        try:
            run.get_single_result(name)
        except RuntimeError:
            unused.append(name)
except MemoryError:
    sys.exit(4)
except Exception as exc:
    answer.write(str(exc))
    sys.exit(1)
answer.write(json.dumps(unused) + "\\n" + table)
"""


@dataclass(frozen=True)
class SvZeroDRun:
    """Summary of a run whose results are written.

    Attributes
    ----------
    cycles : int or None
        Gone through; None where the solver derives them from the Windkessels' decay.
    change : float or None
        Largest of flows and pressures from begin to end of the last cycle, each over its own mean
        magnitude in it, or over `RunLimits.min_scale` of the
        largest of these; None where the results don't hold both.
    unused : tuple of str
        Initial values that the file gives for no variable of its model.
    """

    cycles: int | None
    change: float | None
    unused: tuple[str, ...] = ()

    @property
    def periodic(self) -> bool | None:
        """Whether the last cycle ended as it began."""
        return None if self.change is None else self.change <= LIMITS.periodic_change


class _Table(NamedTuple):
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
        A CSV with the solver's own digits; or, ending in .npz, NumPy arrays: ``name`` (m,),
        ``time`` (t,) and each column (t, m). All in the file's own units.

    Raises
    ------
    FlowError
        Without the package; for options that the solver would take for others, and what would end
        its process or break its table; with its message where it refuses the case or finds no
        solution, with the signal where one ended it.
    OSError
        When a file can't be written.
    """
    _check_blocks(data)
    how = _checked_options(data)
    until_repeated = how.get(_UNTIL_REPEATED, False)
    cycles = None if until_repeated else int(how[_CYCLES])
    unused, lines, log = _solve(data)
    extra = _EXTRA_CYCLES.search(log)
    if until_repeated and extra:
        cycles = int(how[_CYCLES]) + int(extra[1])
        if int(extra[1]):
            # Its table of added cycles is incomplete, and their times begin anew.
            how = {**how, _CYCLES: cycles, _UNTIL_REPEATED: False}
            unused, lines, _ = _solve({**data, _OPTIONS: how})
    found = _read(lines)
    if not all(np.isfinite(column).all() for column in found.columns.values()):
        raise FlowError("the solution isn't finite; check values for their size and sign")
    with atomic_replacement(path) as draft:
        if path.suffix == ".npz":
            np.savez(draft, name=np.array(found.names), time=found.time, **found.columns)  # type: ignore[arg-type]
        else:
            with draft.open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(_cells(lines))
    named = tuple(name for name in unused if name not in _ALL and not name.startswith("_"))
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
    if how[_CYCLES] * steps > LIMITS.max_steps:
        raise FlowError(
            f"{_OPTIONS}: {how[_CYCLES]:,} {_CYCLES} of {steps:,} steps are "
            f"{how[_CYCLES] * steps:,} steps; the limit is {LIMITS.max_steps:,}; lower one of them"
        )
    return how


def _check_blocks(data: Mapping[str, Any]) -> None:
    """Raise `FlowError` for lists that end the solver's process, names that break its table."""
    if _CALIBRATION in data and _OPTIONS not in data:
        raise FlowError(
            f"this is an input of svZeroDCalibrator (it has {_CALIBRATION} and no {_OPTIONS}), not "
            f"a case; run that program first: its result with {_OPTIONS} added is a case"
        )
    for key, others in ((_OPTIONS, ()), ("vessels", _BODIES), ("boundary_conditions", ())):
        if not any(one in data for one in (key, *others)):
            raise FlowError(f"{key} is missing, which a case of svZeroDSolver needs; add it")
    names: dict[str | int, str] = {}
    for key, field in _NAMES:
        for block in entries(data, key):
            name = block.get(field) if isinstance(block, Mapping) else None
            if not isinstance(name, str | int):
                continue  # the solver says so
            if isinstance(name, str) and not (name and name.isprintable()):
                raise FlowError(f"{key}: {field} is {name!r}; write a name in one line")
            if name in names:
                where = key if names[name] == key else f"{names[name]} and {key}"
                raise FlowError(f"{where}: {field} {name!r} is given twice; each needs its own")
            names[name] = key
    for key, field in (("vessels", "zero_d_element_values"), ("boundary_conditions", "bc_values")):
        for block in entries(data, key):
            values = block.get(field) if isinstance(block, Mapping) else None
            if isinstance(values, Mapping):
                what = f"{key} {block.get('vessel_name', block.get('bc_name'))!r}"
                _check_values(values, what)


def _check_values(values: Mapping[str, Any], what: str) -> None:
    """Raise `FlowError` for values of a block that the solver takes and that mean nothing."""
    for key, value in values.items():
        if _ELEMENT.fullmatch(key) and isinstance(value, int | float) and value < 0:
            raise FlowError(f"{what}: {key} is {value:g}; the least is 0")
    times = values.get("t")
    if not isinstance(times, list):
        return
    for key, value in values.items():
        if isinstance(value, list) and (len(value) != len(times) or not value):
            raise FlowError(
                f"{what}: {key} has {len(value)} values, t has {len(times)}; give a value for each "
                "time"
            )
    numbers = [time for time in times if isinstance(time, int | float)]
    fall = next((pair for pair in pairwise(numbers) if pair[1] <= pair[0]), None)
    if fall:
        raise FlowError(f"{what}: t goes from {fall[0]:g} to {fall[1]:g}; times must rise")


def _solve(data: Mapping[str, Any]) -> tuple[list[str], list[str], str]:
    """Run the solver; return unused initial values, lines of its table, and what it printed."""
    watched, kept = os.pipe()  # whose end tells the solver that this process is gone
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _SCRIPT, str(watched)], input=json.dumps(data),
            capture_output=True, encoding="utf-8", errors="replace", check=False,
            pass_fds=(watched,),
        )  # fmt: skip
    finally:
        os.close(kept)
        os.close(watched)
    message = done.stdout.strip()[: LIMITS.max_message]
    if done.returncode == _EXIT_CODES["no package"]:
        raise FlowError(
            "a case of svZeroDSolver needs the package svzerod, which can't be imported "
            f"({message}); pip install 'printctl[svzerod]'"
        )
    if done.returncode == _EXIT_CODES["no memory"]:
        raise FlowError(f"svZeroDSolver ran out of memory; {_LESS_MEMORY}")
    if done.returncode > 0:
        raise FlowError(f"svZeroDSolver: {message}")
    if done.returncode < 0:
        end = signal.Signals(-done.returncode).name
        if end == "SIGKILL":
            raise FlowError(
                f"svZeroDSolver was killed ({end}), most likely by the system, as memory ran out; "
                f"{_LESS_MEMORY}"
            )
        if end not in _FAULTS:
            raise FlowError(f"svZeroDSolver was ended from outside ({end}); run the case again")
        raise FlowError(
            f"svZeroDSolver crashed ({end}); it does so for a block without an inlet or outlet, a "
            "boundary condition that no vessel names and an empty list: check that "
            "boundary_conditions and junctions join each vessel at both ends"
        )
    unused, *lines = done.stdout.rstrip("\n").split("\n")
    return json.loads(unused), lines, done.stderr


def _read(lines: list[str]) -> _Table:
    rows, keys = lines[1:], lines[0].split(",")[2:]
    names = tuple(dict.fromkeys(row[0] for row in _cells(lines, 1)))
    if not rows:
        return _Table((), np.zeros(0), {})
    count = len(rows) // len(names)
    time = np.array([float(row[1]) for row in islice(_cells(lines, 1), count) if row[1]])
    places = range(-len(keys), 0)
    values = np.loadtxt(rows, delimiter=",", usecols=places, comments=None, ndmin=2)
    values = values.reshape(len(names), count, len(keys))
    return _Table(names, time, {key: values[:, :, k].T for k, key in enumerate(keys)})


def _cells(lines: list[str], first: int = 0) -> Iterator[list[str]]:
    """Cells of each line from the first; a name may have commas, numbers have none."""
    count = lines[0].count(",")
    return (line.rsplit(",", count) for line in islice(lines, first, None))


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
        cycle = np.concatenate([column[-1 - parts :] for column in columns], axis=1)
        scale = np.abs(cycle).mean(axis=0)
        scale = np.maximum(scale, LIMITS.min_scale * scale.max(initial=0.0))
        moved = np.abs(cycle[-1] - cycle[0])[scale > 0.0]
        worst = max(worst, float((moved / scale[scale > 0.0]).max(initial=0.0)))
    return worst
