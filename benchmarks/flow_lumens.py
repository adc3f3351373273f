"""3D flow in networks, by ``printctl flow --three-d`` in a process of its own, meshing included.

Sections are taken from the VTU file by this benchmark's own reader and interpolation; what is
ideal in the cube is solved by its own Poiseuille network.
"""

from __future__ import annotations

import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.vtu_sections import VtuFlow
from benchmarks.command import Row
from benchmarks.embedded_cases import _tissue
from benchmarks.machine import ROOT, row
from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d import FlowOptions, solve_steady, straightened
from design.hemodynamics.three_d.mesh import lumen_mesh
from design.network import VesselNetwork
from design.network_csv import write_network_csv
from design.tissue import block
from design.vasculature import GrowthOptions, grow_printable, planar_four_vessel, tree_to_network

RADIUS, LENGTH, FLOW_ML_MIN, VISCOSITY = 0.2, 4.0, 0.25, 1e-3
_PA_PER_MMHG, _UL_S = 133.322387415, 1000.0 / 60.0


def lumen_rows(quick: bool) -> Iterator[Row]:
    """The pipe, the planar network, and without ``quick`` 51 lumens and the cube."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _pipe(Path(folder))
        yield from _planar(Path(folder))
        if not quick:
            yield from _fifty(Path(folder))
            yield from _cube(Path(folder))


def _solved(folder: Path, network: VesselNetwork, *options: str) -> dict[str, Any]:
    """What the command says of a network, its seconds and its peak of memory, MB."""
    write_network_csv(folder / "network.csv", network)
    command = ["flow", str(folder / "network.csv"), "--unit", "mm", "--three-d", "--json",
               "--out", str(folder / "out"), *options]  # fmt: skip
    return _measured(command)


def _measured(command: list[str]) -> dict[str, Any]:
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "printctl", *command], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    said = process.stdout.read()
    _, code, used = os.wait4(process.pid, 0)
    if code != 0:
        raise RuntimeError(f"printctl {' '.join(command)} ended with {code}")
    spent = time.perf_counter() - begun
    # Of a child of a small process: it begins with as little as that.
    return {**json.loads(said), "seconds": spent, "peak_mb": used.ru_maxrss / 1024.0}


def _pipe(folder: Path) -> Iterator[Row]:
    pipe = VesselNetwork.from_segments(
        np.array([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]]), np.array([[0, 1]]),
        np.array([RADIUS]), np.array([0]), np.array([0]),
    )  # fmt: skip
    found = _solved(folder, pipe, "--order", "3")
    flow = FLOW_ML_MIN * _UL_S
    drop = 8.0 * VISCOSITY * LENGTH * flow / (np.pi * RADIUS**4) / _PA_PER_MMHG
    off = abs(found["three_d"]["pressure_drop_mmhg"] / drop - 1.0)
    with (folder / "out" / "flow_3d.csv").open() as table:
        shear = float(next(csv.DictReader(table))["wall_shear_mean_dyn_cm2"]) / 10.0
    shear_off = abs(shear / (4.0 * VISCOSITY * flow / (np.pi * RADIUS**3)) - 1.0)
    name = f"pipe of 20 radii by the command, {found['three_d']['unknowns']:,} unknowns"
    yield row(f"{name}: pressure drop", off, "", "<= 1e-3", off <= 1e-3)
    yield row(f"{name}: mean wall shear", shear_off, "", "<= 3e-3", shear_off <= 3e-3)
    yield row(f"{name}: whole command", found["seconds"], "s")


def _planar(folder: Path) -> Iterator[Row]:
    found = _solved(folder, planar_four_vessel())
    name = f"planar network by the command, {found['three_d']['unknowns']:,} unknowns"
    spent = statistics.median(_mesh_and_solve(planar_four_vessel()) for _ in range(3))
    yield row(f"{name}: meshed and solved", spent, "s", "<= 10", spent <= 10.0)
    yield row(f"{name}: whole command, imports, files and picture, too", found["seconds"], "s")
    yield row(f"{name}: peak memory", found["peak_mb"], "MB", "<= 1024", found["peak_mb"] <= 1024)
    finer = _solved(folder, planar_four_vessel(), "--order", "3")
    drops = [x["three_d"]["pressure_drop_mmhg"] for x in (found, finer)]
    off = abs(drops[0] / drops[1] - 1.0)
    yield row(f"{name}: pressure against the next order's", off, "", "<= 5e-3", off <= 5e-3)


def _mesh_and_solve(network: VesselNetwork) -> float:
    begun = time.perf_counter()
    mesh, _ = straightened(lumen_mesh(network))
    driven = FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW_ML_MIN * _UL_S)
    solve_steady(mesh, driven, FlowOptions(order=2))
    return time.perf_counter() - begun


def fifty() -> VesselNetwork:
    """51 vessels in a block, 0.4 mm at least."""
    growth = GrowthOptions(terminals=26, seed=1, smallest_radius_mm=0.2, clearance_mm=0.2)
    done = grow_printable(_tissue(block((20.0, 20.0, 10.0))), growth, widest_radius_mm=1.0)
    return tree_to_network(done.tree)


def _fifty(folder: Path) -> Iterator[Row]:
    network = fifty()
    found = _solved(folder, network)
    name = f"{network.vessel_count} grown lumens, {found['three_d']['unknowns']:,} unknowns"
    yield row(f"{name}: whole command", found["seconds"], "s", "<= 600", found["seconds"] <= 600.0)
    yield row(f"{name}: peak memory", found["peak_mb"], "MB", "<= 8192", found["peak_mb"] <= 8192)
    off = interior_imbalance(network, VtuFlow(folder / "out" / "flow_3d.vtu"))
    yield row(f"{name}: flow amid vessels against the ends', of the inlet's", off, "", "<= 3e-3",
              off <= 3e-3)  # fmt: skip


def interior_imbalance(network: VesselNetwork, field: VtuFlow) -> float:
    """Largest difference of the flow amid a vessel from what leaves beyond it, of the inlet's."""
    start = network.points[network.offset[:-1]]
    end = network.points[network.offset[1:] - 1]
    radius = network.radius[network.offset[1:] - 1]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    count = network.vessel_count
    amid = np.array(
        [field.section(0.5 * (start[v] + end[v]), along[v], radius[v])[0] for v in range(count)]
    )
    leaf = ~np.isin(network.vessel_nodes[:, 1], network.vessel_nodes[:, 0])
    beyond = np.zeros(count)
    for v in range(count):
        if leaf[v]:
            beyond[v] = field.section(end[v] - 0.05 * radius[v] * along[v], along[v], radius[v])[0]
    for v in _upwards(network):
        beyond[v] += beyond[network.vessel_nodes[:, 0] == network.vessel_nodes[v, 1]].sum()
    # Short vessels are all junction: a section amid them cuts their neighbours, too.
    long = np.linalg.norm(end - start, axis=1) > 5.0 * radius
    return float(np.abs(amid - beyond)[long].max() / np.abs(amid).max())


def _upwards(network: VesselNetwork) -> list[int]:
    """Vessels, each after all that leave its end."""
    order: list[int] = []
    root = ~np.isin(network.vessel_nodes[:, 0], network.vessel_nodes[:, 1])
    front = np.flatnonzero(root).tolist()
    while front:
        order += front
        ends = network.vessel_nodes[front, 1]
        front = np.flatnonzero(np.isin(network.vessel_nodes[:, 0], ends)).tolist()
    return order[::-1]


def _cube(folder: Path) -> Iterator[Row]:
    out = folder / "cube"
    recipe = ROOT / "examples" / "cube_multifidelity.yaml"
    found = _measured(["design", str(recipe), "--out", str(out), "--json"])
    with (out / "flow_comparison.csv").open() as table:
        rows = list(csv.DictReader(table))
    ideal = {(r["vessel"], r["fraction"]): r for r in rows if r["fidelity"] == "ideal"}
    inlet = max(float(r["pressure_mmhg"]) for r in rows)
    for fidelity in ("3D", "1D"):
        here = [r for r in rows if r["fidelity"] == fidelity]
        flow = max(float(r["flow_off_ul_min"]) for r in here)
        pressure = max(float(r["pressure_off_mmhg"]) for r in here)
        mean = max(
            abs(float(r["flow_ml_min"]) - float(ideal[r["vessel"], r["fraction"]]["flow_ml_min"]))
            for r in here
        )
        name = f"cube, {fidelity} against the ideal over a cycle"
        goals = fidelity == "3D"
        share = flow / (1000.0 * FLOW_ML_MIN)
        yield row(f"{name}: flow", flow, "uL/min", peer={"name": "paper", "value": 0.02})
        yield row(f"{name}: flow, of the inlet's", share, "", "<= 5e-3" if goals else "",
                  share <= 5e-3 if goals else None)  # fmt: skip
        yield row(f"{name}: mean flow", 1000.0 * mean, "uL/min")
        share = pressure / inlet
        yield row(f"{name}: pressure", pressure, "mmHg", peer={"name": "paper", "value": 0.03})
        yield row(f"{name}: pressure, of the largest on the way", share, "",
                  "<= 3e-2" if goals else "", share <= 3e-2 if goals else None)  # fmt: skip
    yield row("cube: whole command (growth, 0D, 1D, 3D in pulses)", found["seconds"], "s")
