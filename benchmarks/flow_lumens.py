"""3D flow in networks by ``printctl flow --three-d``, meshing included.

Sections are taken from the VTU file by this benchmark's own reader and interpolation. In the cube
the means of a cycle are held against a Poiseuille network solved here; deviations over the cycle
are those that the product tells (its ideal's means are held against this network, too).
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

from benchmarks.checkers.poiseuille import graph_flows, resistances
from benchmarks.checkers.read_network import read_network
from benchmarks.checkers.vtu_sections import VtuFlow
from benchmarks.command import Row
from benchmarks.embedded_cases import _tissue
from benchmarks.machine import ROOT, row
from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d import FlowOptions, solve_steady, straighten_edges
from design.hemodynamics.three_d.mesh import lumen_mesh
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.tissue import block
from design.vasculature import GrowthOptions, grow_printable, planar_four_vessel, tree_to_network

RADIUS, LENGTH, FLOW_ML_MIN, VISCOSITY = 0.2, 4.0, 0.25, 1e-3
_PA_PER_MMHG, _UL_S = 133.322, 1000.0 / 60.0  # mmHg as physics.md has it


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
    mesh, _ = straighten_edges(lumen_mesh(network))
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
        [field.section(0.5 * (start[v] + end[v]), along[v], radius[v]).flow for v in range(count)]
    )
    leaf = ~np.isin(network.vessel_nodes[:, 1], network.vessel_nodes[:, 0])
    beyond = np.zeros(count)
    for v in range(count):
        if leaf[v]:
            near = end[v] - 0.05 * radius[v] * along[v]
            beyond[v] = field.section(near, along[v], radius[v]).flow
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
    yield from _cube_means(rows, *own_ideal(out / "network.csv"))
    yield row("cube: whole command (growth, 0D, 1D, 3D in pulses)", found["seconds"], "s")


def _cube_means(
    rows: list[dict[str, str]], flow: dict[int, float], pressure: dict[int, float]
) -> Iterator[Row]:
    """Means amid vessels against this benchmark's own network."""
    highest = max(pressure.values())
    for fidelity in ("3D", "ideal"):
        # Rows amid every vessel come first.
        here = [r for r in rows if r["fidelity"] == fidelity][: len(flow)]
        off = max(abs(float(r["flow_ml_min"]) - flow[int(r["vessel"])]) for r in here)
        off /= FLOW_ML_MIN
        bound = 5e-3 if fidelity == "3D" else 1e-6
        name = f"cube, {fidelity}: mean"
        yield row(f"{name} flow against a Poiseuille network of the benchmark's, of the inlet's",
                  off, "", f"<= {bound:g}", off <= bound)  # fmt: skip
        off = max(abs(float(r["pressure_mmhg"]) - pressure[int(r["vessel"])]) for r in here)
        off /= highest
        bound = 3e-2 if fidelity == "3D" else 1e-6
        yield row(f"{name} pressure against it, of the largest", off, "", f"<= {bound:g}",
                  off <= bound)  # fmt: skip


def own_ideal(path: Path) -> tuple[dict[int, float], dict[int, float]]:
    """Flow (mL/min) and pressure (mmHg) amid each vessel; one inlet, outlets at 0."""
    net = read_network(path)
    resistance = resistances(net, VISCOSITY)
    flow = graph_flows(net, resistance, 1.0)
    flow *= FLOW_ML_MIN * _UL_S / flow[np.isin(net.node[:, 0], net.inlets())].sum()
    at = {int(node): 0.0 for node in net.outlets()}
    while len(at) < net.node_count:
        for piece, (first, last) in enumerate(net.node.tolist()):
            fall = flow[piece] * resistance[piece]
            if last in at:
                at.setdefault(first, at[last] + fall)
            elif first in at:
                at[last] = at[first] - fall
    through, amid = {}, {}
    for vessel in np.unique(net.vessel).tolist():
        mine = np.flatnonzero(net.vessel == vessel)
        way = np.concatenate([[0.0], np.cumsum(net.length[mine])])
        which = int(np.searchsorted(way, 0.5 * way[-1])) - 1
        piece, part = mine[which], 0.5 * way[-1] - way[which]
        r0, r1 = net.radius[piece]
        here = r0 + (r1 - r0) * part / net.length[piece]
        shape = (r0 * r0 + r0 * here + here * here) / (3.0 * (r0 * here) ** 3)
        fall = 8.0 * VISCOSITY / np.pi * part * shape * flow[piece]
        through[vessel] = float(flow[mine[0]]) / _UL_S
        amid[vessel] = float(at[int(net.node[piece, 0])] - fall) / _PA_PER_MMHG
    return through, amid
