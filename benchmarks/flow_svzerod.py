"""svZeroDSolver's own cases and a job of 10,000 terminals, by the command line.

``SVZEROD_CHECKOUT`` names a checkout of svZeroDSolver, with ``tests/cases`` and their results;
``SVZEROD_SOLVER`` its program, which is then run beside. What is compared and written is read by
this file's own code. Without either only our time is measured. A stored result that the program
itself misses by more than 1e-7 (another build's rounding decides when a valve closes) is held
against that distance.
"""

from __future__ import annotations

import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Row
from benchmarks.flow_networks import binary_tree
from benchmarks.house import ROOT
from benchmarks.machine import row

CLOSE = 1e-7
LOOSE = 3.0
"""Times the distance of their own program from a stored result that it misses."""
SHARE = 20.0
FLOOR = 1e-6
"""Rates of which the rest is rounding, as a share of the largest."""


def svzerod_rows(quick: bool) -> Iterator[Row]:
    """Cases within 1e-7 of the stored results, refused by key, failed; then the large job."""
    checkout = os.environ.get("SVZEROD_CHECKOUT")
    if checkout:
        yield from _cases(Path(checkout))
    for cycles in (1,) if quick else (1, 10):
        yield _large(1000 if quick else 10_000, cycles)


def _cases(checkout: Path) -> Iterator[Row]:
    cases = checkout / "tests" / "cases"
    close, refused, loose, failed, worst = [], [], [], [], 0.0
    for file in sorted(cases.glob("*.json")) + sorted(cases.glob("vmr/input/*.json")):
        verdict, away = _case(file, cases / "results" / f"result_{file.name}")
        if verdict == "failed" and np.isfinite(away):
            theirs = _their_distance(file, cases / "results" / f"result_{file.name}")
            if theirs > CLOSE and away <= LOOSE * theirs:
                loose.append({"name": file.stem, "away": away, "their_program": theirs})
                continue
        {"close": close, "refused": refused, "failed": failed}[verdict].append(file.stem)
        worst = max(worst, away if verdict == "close" else 0.0)
    what = "svZeroDSolver's cases: "
    yield row(what + "within 1e-7", len(close), "cases") | {"worst": worst}
    yield row(what + "refused by key", len(refused), "cases") | {"names": refused}
    if loose:
        yield row(what + "beyond it, as their own program", len(loose), "cases") | {"cases": loose}
    yield row(what + "failed", len(failed), "cases", "<= 0", not failed) | {"names": failed}


def _case(file: Path, stored: Path) -> tuple[str, float]:
    """Return what became of a case, and how far from the stored result it is at most."""
    with tempfile.TemporaryDirectory() as folder:
        done = _printctl("flow", str(file), "--out", folder)
        if done.returncode:
            keys = json.loads(file.read_text(encoding="utf-8"))
            named = _names_key(done.stderr, keys)
            return ("refused" if named and "Traceback" not in done.stderr else "failed"), 0.0
        if not stored.is_file():
            return "failed", np.inf
        away = _away(Path(folder) / "svzerod.csv", stored)
    return ("close" if away <= CLOSE else "failed"), away


def _their_distance(file: Path, stored: Path) -> float:
    """Return how far svZeroDSolver's program is from its own stored result; 0 without it."""
    solver = os.environ.get("SVZEROD_SOLVER")
    if not solver:
        return 0.0
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "peer.csv"
        subprocess.run([solver, str(file), str(out)], capture_output=True, check=True)
        return _away(out, stored)


def _names_key(message: str, data: dict[str, Any]) -> bool:
    keys = set(data) | set(data.get("simulation_parameters", {}))
    keys |= {block["bc_name"] for block in data.get("boundary_conditions", [])}
    keys |= {key for block in data.get("closed_loop_blocks", []) for key in block}
    return any(key in message for key in keys)


def _away(ours: Path, stored: Path) -> float:
    """Return the largest difference, each signal by its own largest value."""
    reference = json.loads(stored.read_text(encoding="utf-8"))
    with ours.open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    names = list(reference["name"].values())
    if names != [line["name"] for line in rows]:
        return np.inf
    worst = 0.0
    for column in set(reference) - {"name", "time"}:
        theirs = np.array(list(reference[column].values()), dtype=float)
        mine = np.array([float(line[column]) for line in rows])
        for name in dict.fromkeys(names):
            here = np.array([n == name for n in names])
            size = max(np.abs(theirs[here]).max(), FLOOR * np.abs(theirs).max())
            if size > 0.0:
                worst = max(worst, float(np.abs(mine - theirs)[here].max() / size))
    return worst


def _large(terminals: int, cycles: int) -> Row:
    """Run the job with its results written, as NPZ and as CSV, and svZeroDSolver beside it."""
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        case = folder / "case.json"
        case.write_text(json.dumps(tree_case(terminals, cycles)), encoding="utf-8")
        spent = {}
        for kind in ("npz", "csv"):
            _printctl("flow", str(case), "--results", kind, "--out", str(folder))  # kernels
            spent[kind] = min(_spent(case, kind, folder) for _ in range(3))
        what = f"svZeroD file, {terminals:,} terminals, {cycles} cycle(s) of 100 steps, to NPZ"
        solver = os.environ.get("SVZEROD_SOLVER")
        more = {"csv": spent["csv"]}
        if not solver:
            return row(what, spent["npz"], "CPU s") | more
        theirs = cpu_of([solver, str(case), str(folder / "peer.csv")])
    peer = {"name": "svZeroDSolver, to CSV", "value": theirs}
    met = spent["npz"] <= theirs / SHARE
    return row(what, spent["npz"], "CPU s", f"<= {theirs / SHARE:.3g}", met, peer) | more


def tree_case(terminals: int, cycles: int) -> dict[str, Any]:
    """R-C-L vessels of an even tree, a sine of flow at its root, Windkessels at its tips."""
    tree = binary_tree(terminals)
    length = (
        np.linalg.norm(
            tree.nodes[tree.vessel_nodes[:, 1]] - tree.nodes[tree.vessel_nodes[:, 0]], axis=1
        )
        / 10.0
    )
    radius = tree.radius[::2] / 10.0
    values = zip(
        8 * 0.04 * length / (np.pi * radius**4), 3 * np.pi * radius**2 * length / 1e5,
        4 / 3 * 1.06 * length / (np.pi * radius**2), strict=True,
    )  # fmt: skip
    vessels, junctions, ends = [], [], []
    children: dict[int, list[int]] = {}
    for k, first in enumerate(tree.vessel_nodes[:, 0].tolist()):
        children.setdefault(first, []).append(k)
    for k, (r, c, i) in enumerate(values):
        vessel: dict[str, Any] = {
            "vessel_id": k, "vessel_name": f"branch{k}_seg0", "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": {"R_poiseuille": r, "C": c, "L": i},
            "boundary_conditions": {"inlet": "IN"} if k == 0 else {},
        }  # fmt: skip
        below = children.get(int(tree.vessel_nodes[k, 1]))
        if below:
            junctions.append(
                {
                    "junction_name": f"J{k}",
                    "junction_type": "NORMAL_JUNCTION",
                    "inlet_vessels": [k],
                    "outlet_vessels": below,
                }
            )
        else:
            vessel["boundary_conditions"]["outlet"] = f"OUT{k}"
            load = {"Rp": 1e4 * terminals / 10, "C": 1e-4 / terminals, "Rd": 1e5 * terminals / 10}
            ends.append({"bc_name": f"OUT{k}", "bc_type": "RCR", "bc_values": load | {"Pd": 0.0}})
        vessels.append(vessel)
    time = np.linspace(0.0, 1.0, 101)
    flow = 1.0 + 0.4 * np.sin(2 * np.pi * time)
    flow[-1] = flow[0]
    inlet = {"Q": flow.tolist(), "t": time.tolist()}
    return {
        "simulation_parameters": {
            "number_of_cardiac_cycles": cycles, "number_of_time_pts_per_cardiac_cycle": 101,
        },
        "boundary_conditions": [{"bc_name": "IN", "bc_type": "FLOW", "bc_values": inlet}, *ends],
        "vessels": vessels, "junctions": junctions,
    }  # fmt: skip


def _spent(case: Path, kind: str, folder: Path) -> float:
    return cpu_of(command_line("flow", str(case), "--results", kind, "--out", str(folder)))


def command_line(*words: str) -> list[str]:
    """Return `printctl`'s command with these words."""
    return [sys.executable, "-m", "printctl", *words]


def _printctl(*words: str) -> subprocess.CompletedProcess[str]:
    place = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command_line(*words), capture_output=True, text=True, env=place, check=False
    )


def cpu_of(command: list[str]) -> float:
    """Return the CPU time of a whole process, user and system, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    place = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(command, capture_output=True, env=place, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
