"""3D flow in networks by ``printctl flow --three-d``, meshing included.

Sections are taken from the VTU file by this benchmark's own reader and interpolation. In the cube
the means of a cycle are held against a Poiseuille network solved here; deviations over the cycle
are those that the product tells (its ideal's means are held against this network, too).
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.checkers.networks import graph_flows, read_network, resistances
from benchmarks.common import ROOT, Row, limited, printctl, read_csv, row, scratch, timed
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.tissue import block, tissue_from_surface
from design.vasculature import GrowthOptions, grow_printable, tree_to_network

RADIUS, LENGTH, FLOW_ML_MIN, VISCOSITY = 0.2, 4.0, 0.25, 1e-3
_PA_PER_MMHG, _UL_S = 133.322, 1000.0 / 60.0  # mmHg as physics.md has it


def rows(quick: bool) -> Iterator[Row]:
    """Yield the pipe, and unless quick 51 lumens and the cube."""
    with scratch() as folder:
        yield from _pipe(folder)
        if not quick:
            yield from _fifty(folder)
            yield from _cube(folder)


def _solved(folder: Path, network: VesselNetwork, *options: str) -> Row:
    """Return what the command reports of a network, its CPU seconds and peak memory, MB."""
    write_network_csv(folder / "network.csv", network)
    given = ["--unit", "mm", "--three-d", "--json", "--out", folder / "out", *options]
    return _measured("flow", folder / "network.csv", *given)


def _measured(*words: object) -> Row:
    begun = time.perf_counter()
    cpu, memory, out = timed(printctl(*words))
    spent = {"seconds": time.perf_counter() - begun, "cpu_s": cpu, "peak_mb": memory}
    return {**json.loads(out), **spent}


def _pipe(folder: Path) -> Iterator[Row]:
    pipe = VesselNetwork.from_segments(
        np.array([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]]), np.array([[0, 1]]),
        np.array([RADIUS]), np.array([0]), np.array([0]),
    )  # fmt: skip
    found = _solved(folder, pipe, "--order", "3", "--viscosity-mpa-s", f"{1e3 * VISCOSITY:g}")
    flow = FLOW_ML_MIN * _UL_S
    drop = 8.0 * VISCOSITY * LENGTH * flow / (np.pi * RADIUS**4) / _PA_PER_MMHG
    off = abs(found["three_d"]["pressure_drop_mmhg"] / drop - 1.0)
    shear = float(read_csv(folder / "out" / "flow_3d.csv")[0]["wall_shear_mean_dyn_cm2"]) / 10.0
    shear_off = abs(shear / (4.0 * VISCOSITY * flow / (np.pi * RADIUS**3)) - 1.0)
    name = f"pipe of 20 radii by the command, {found['three_d']['unknowns']:,} unknowns"
    yield limited(f"{name}: pressure drop", off, "", 1e-3)
    yield limited(f"{name}: mean wall shear", shear_off, "", 3e-3)
    yield row(f"{name}: whole command", found["seconds"], "s")


def _fifty(folder: Path) -> Iterator[Row]:
    """Yield 51 vessels in a block, 0.4 mm at least."""
    growth = GrowthOptions(terminals=26, seed=1, smallest_radius_mm=0.2, clearance_mm=0.2)
    shape = block((20.0, 20.0, 10.0))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    network = tree_to_network(grow_printable(tissue, growth, widest_radius_mm=1.0).tree)
    found = _solved(folder, network)
    name = f"{network.vessel_count} grown lumens, {found['three_d']['unknowns']:,} unknowns"
    yield limited(f"{name}: whole command", found["seconds"], "s", 600.0)
    yield limited(f"{name}: peak memory", found["peak_mb"], "MB", 8192.0)


def _cube(folder: Path) -> Iterator[Row]:
    out = folder / "cube"
    recipe = ROOT / "examples" / "cube_multifidelity.yaml"
    found = _measured("design", recipe, "--out", out, "--json")
    rows = read_csv(out / "flow_comparison.csv")
    inlet = max(float(r["pressure_mmhg"]) for r in rows)
    for fidelity, goals in (("3D", (5e-3, 3e-2)), ("1D", (None, None))):
        here = [r for r in rows if r["fidelity"] == fidelity]
        share = max(float(r["flow_off_ul_min"]) for r in here) / (1000.0 * FLOW_ML_MIN)
        name = f"cube, {fidelity} against the ideal over a cycle"
        yield limited(f"{name}: flow, of the inlet's", share, "", goals[0])
        share = max(float(r["pressure_off_mmhg"]) for r in here) / inlet
        yield limited(f"{name}: pressure, of the largest on the way", share, "", goals[1])
    flow, pressure = own_ideal(out / "network.csv")
    for fidelity, goals in (("3D", (5e-3, 3e-2)), ("ideal", (1e-6, 1e-6))):
        # Rows amid every vessel come first.
        here = [r for r in rows if r["fidelity"] == fidelity][: len(flow)]
        name = f"cube, {fidelity}: mean against a Poiseuille network of the benchmark's"
        off = max(abs(float(r["flow_ml_min"]) - flow[int(r["vessel"])]) for r in here)
        yield limited(f"{name}: flow, of the inlet's", off / FLOW_ML_MIN, "", goals[0])
        off = max(abs(float(r["pressure_mmhg"]) - pressure[int(r["vessel"])]) for r in here)
        share = off / max(pressure.values())
        yield limited(f"{name}: pressure, of the largest", share, "", goals[1])
    yield row("cube: whole command (growth, 0D, 1D, 3D in pulses)", found["seconds"], "s")


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
