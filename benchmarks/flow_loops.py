"""Check flow_3d.csv against plane cuts of flow_3d.vtu: ``python -m benchmarks.flow_loops``.

The cube of `examples/paper/cube_closed.yaml` with 3, 8, 31 and 60 loops (hours for the last), or
with ``--solved`` folders with network.csv, flow_3d.csv and flow_3d.vtu. Cuts are polygons of planes
through quadratic tetrahedra; those count whose area is that of the vessel's own radius.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmarks.checkers.read_network import Pieces, read_network
from benchmarks.checkers.vtu_sections import VtuFlow, quadratic_shapes
from benchmarks.machine import ROOT, print_rows, row

FloatArray = NDArray[np.float64]

LOOPS, VISCOSITY_PA_S, UL_S = (3, 8, 31, 60), 4e-3, 1000.0 / 60.0
FRACTIONS, AREA_OFF, LIMIT = np.linspace(0.04, 0.96, 24), 0.03, 0.02
MIN_SPAN_RADII = 3.0
PARTS = np.array([[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 9, 8],
                  [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]])  # fmt: skip
"""Straight tetrahedra of a quadratic one, by its nodes."""
CORNERS = np.vstack([np.zeros(3), np.eye(3)])
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
PLACES = np.vstack([CORNERS, [CORNERS[list(edge)].mean(axis=0) for edge in EDGES]])
TRIANGLES = (
    (1, ((0, 1), (0, 2), (0, 3))), (3, ((3, 0), (3, 1), (3, 2))),
    (2, ((0, 2), (0, 3), (1, 3))), (2, ((0, 2), (1, 3), (1, 2))),
)  # fmt: skip
"""Corners above the plane, and edges that it cuts, corners sorted from the highest."""


def cut(flow: VtuFlow, centre: FloatArray, along: FloatArray, radius: float) -> FloatArray:
    """Area (mm²), flow (µL/s) and mean pressure (Pa) of the cut that the centre lies in."""
    near = np.array(flow.tree.query_ball_point(centre, 6.0 * radius), dtype=np.int64)
    beyond = (flow.points[flow.cells[near]] - centre) @ along
    height, node = beyond[:, PARTS].reshape(-1, 4), np.tile(PARTS, (len(near), 1))
    order = np.argsort(-height, axis=1)
    height, node = (np.take_along_axis(a, order, axis=1) for a in (height, node))
    corners, owners = [], []
    for above, triangle in TRIANGLES:
        mine = np.flatnonzero((height > 0.0).sum(axis=1) == above)
        share = [height[mine, a] / (height[mine, a] - height[mine, b]) for a, b in triangle]
        ends = [(PLACES[node[mine, a]], PLACES[node[mine, b]]) for a, b in triangle]
        along_edges = [a + s[:, None] * (b - a) for s, (a, b) in zip(share, ends, strict=True)]
        corners.append(np.stack(along_edges, axis=1))
        owners.append(np.repeat(near, len(PARTS))[mine])
    at, cells = np.concatenate(corners), flow.cells[np.concatenate(owners)]
    corner = _values(flow.points[cells], at)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    part = _hanging_together(cells[:, :4])
    mine = part == part[np.linalg.norm(corner.mean(axis=1) - centre, axis=1).argmin()]
    area = np.where(mine, 0.5 * np.linalg.norm(normal, axis=1), 0.0)
    # Exact for quadratics: the middles of a triangle's edges.
    middle = 0.5 * (at + np.roll(at, -1, axis=1))
    speed = _values(flow.velocity[cells], middle).mean(axis=1) @ along
    pressure = _values(flow.pressure.reshape(-1, 1)[cells], middle).mean(axis=(1, 2))
    return np.array([area.sum(), area @ speed, area @ pressure / area.sum()])


def _values(nodal: FloatArray, at: FloatArray) -> FloatArray:
    """Values (m, q, k) at reference places (m, q, 3) of elements with nodal ones (m, 10, k)."""
    shape = quadratic_shapes(at.reshape(-1, 3))[0].reshape(*at.shape[:2], 10)
    return np.asarray(np.einsum("mqn,mnk->mqk", shape, nodal))


def _hanging_together(corner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Label of the part that each cell (m, 4) belongs to."""
    name = np.unique(corner, return_inverse=True)[1].reshape(corner.shape)
    pairs = np.concatenate([name[:, edge] for edge in combinations(range(4), 2)])
    size = int(name.max()) + 1
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1][name[:, 0]])


def vessel_flow(flow: VtuFlow, net: Pieces, vessel: int) -> tuple[float, float]:
    """Flow of the vessel's clean cuts (median), and by π r⁴/8μ dp/dx where straight, µL/s."""
    mine = np.flatnonzero(net.vessel == vessel)
    way = np.concatenate([[0.0], np.cumsum(net.length[mine])])
    found = []
    for s in FRACTIONS * way[-1]:
        k = min(int(np.searchsorted(way, s, side="right")) - 1, len(mine) - 1)
        part = (s - way[k]) / net.length[mine[k]]
        along = (net.end[mine[k]] - net.start[mine[k]]) / net.length[mine[k]]
        radius = float(net.radius[mine[k]] @ [1.0 - part, part])
        area, through, pressure = cut(
            flow, net.start[mine[k]] + (s - way[k]) * along, along, radius
        )
        if abs(area / (np.pi * radius**2) - 1.0) <= AREA_OFF:
            found.append((s, through, pressure))
    if not found:
        return np.nan, np.nan
    places, through, pressure = np.array(found).T
    radius = float(net.radius[mine].mean())
    straight = len(mine) == 1 and np.ptp(net.radius[mine]) < 1e-9
    if not straight or np.ptp(places) < MIN_SPAN_RADII * radius:
        return float(np.median(through)), np.nan
    slope = float(np.polyfit(places, pressure, 1)[0])
    return float(np.median(through)), -slope * np.pi * radius**4 / (8.0 * VISCOSITY_PA_S)


def compare(folder: Path, name: str) -> list[dict[str, Any]]:
    """Rows of one solved network."""
    net, field = read_network(folder / "network.csv"), VtuFlow(next(folder.rglob("flow_3d.vtu")))
    with next(folder.rglob("flow_3d.csv")).open() as table:
        ours = UL_S * np.array([float(r["flow_ml_min"]) for r in csv.DictReader(table)])
    theirs = np.array([vessel_flow(field, net, vessel) for vessel in range(len(ours))])
    rows = [
        row(f"{name}: vessels", len(ours), ""),
        row(f"{name}: vessels without a figure", int(np.isnan(ours).sum()), ""),
    ]
    for what, against in zip(("plane cuts", "dp/dx"), theirs.T, strict=True):
        off = np.abs(ours / against - 1.0)
        worst, count = float(np.nanmax(off)), int((off > LIMIT).sum())
        rows += [
            row(f"{name}: vessels compared with {what}", int(np.isfinite(off).sum()), ""),
            row(f"{name}: off by more than 2 %", count, "", "0", count == 0),
            row(f"{name}: worst", worst, "", f"<= {LIMIT}", worst <= LIMIT),
        ]
    return rows


def solve(loops: int, folder: Path) -> Path:
    """Grow the cube with so many loops, and solve it in 3D, by the command."""
    text = (ROOT / "examples" / "paper" / "cube_closed.yaml").read_text()
    recipe, out = folder / f"cube_{loops}.yaml", folder / str(loops)
    recipe.write_text(text.replace("terminals: 31", f"terminals: {loops}"))
    for command in (
        ["design", str(recipe), "--until", "vasculature", "--out", str(out)],
        ["flow", str(out / "network.csv"), "--unit", "mm", "--three-d", "--flow-ml-min", "0.25",
         "--viscosity-mpa-s", f"{1e3 * VISCOSITY_PA_S:g}", "--out", str(out / "flow")],
    ):  # fmt: skip
        subprocess.run([sys.executable, "-m", "printctl", *command], check=True, cwd=ROOT,
                       stdout=subprocess.DEVNULL)  # fmt: skip
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, nargs="*", default=LOOPS)
    parser.add_argument("--solved", type=Path, nargs="*", default=())
    asked = parser.parse_args()
    rows = [r for each in asked.solved for r in compare(each, each.name)]
    with tempfile.TemporaryDirectory() as temporary:
        for loops in () if asked.solved else asked.loops:
            rows += compare(solve(loops, Path(temporary)), f"{loops} loops")
    print_rows(rows)
