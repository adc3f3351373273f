"""Check flow_3d.csv against plane cuts of flow_3d.vtu: ``python -m benchmarks.flow_loops``.

The cube of `examples/paper/cube_closed.yaml` with 3, 8, 31 and 60 loops, or with ``--solved`` the
folders of runs (network.csv, flow_3d.csv, flow_3d.vtu). Cuts are made here: plane polygons through
quadratic tetrahedra, several a vessel, those whose area is that of the vessel's own radius. Prints
JSON.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
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

LOOPS = (3, 8, 31, 60)
VISCOSITY_PA_S = 4e-3
FRACTIONS = np.linspace(0.04, 0.96, 24)
AREA_OFF, LIMIT = 0.03, 0.02
UL_S = 1000.0 / 60.0
MIN_SPAN_RADII = 3.0

PARTS = np.array([[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 9, 8],
                  [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]])  # fmt: skip
"""Straight tetrahedra of a quadratic one, by its nodes."""

_CORNERS = np.vstack([np.zeros(3), np.eye(3)])
PLACES = np.vstack(
    [
        _CORNERS,
        [_CORNERS[[i, j]].mean(0) for i, j in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))],
    ]
)


def cut(flow: VtuFlow, centre: FloatArray, along: FloatArray, radius: float) -> FloatArray:
    """Area (mm²), flow (µL/s) and mean pressure (Pa) of the cut that the centre lies in."""
    near = np.array(flow.tree.query_ball_point(centre, 6.0 * radius), dtype=np.int64)
    if not len(near):
        return np.full(3, np.nan)
    beyond = (flow.points[flow.cells[near]] - centre) @ along
    met = (beyond.min(axis=1) < 0.0) & (beyond.max(axis=1) > 0.0)
    near, beyond = near[met], beyond[met]
    height = beyond[:, PARTS].reshape(-1, 4)
    node, cell = np.tile(PARTS, (len(near), 1)), np.repeat(near, len(PARTS))
    order = np.argsort(-height, axis=1)
    height, node = (np.take_along_axis(a, order, axis=1) for a in (height, node))
    count = (height > 0.0).sum(axis=1)
    edges = {1: [(0, 1), (0, 2), (0, 3)], 3: [(3, 0), (3, 1), (3, 2)]}
    square = [(0, 2), (0, 3), (1, 3), (1, 2)]
    corners, owner = [], []
    for positive, triangle in ((1, edges[1]), (3, edges[3]),
                               (2, [square[k] for k in (0, 1, 2)]),
                               (2, [square[k] for k in (0, 2, 3)])):  # fmt: skip
        mine = np.flatnonzero(count == positive)
        share = [height[mine, a] / (height[mine, a] - height[mine, b]) for a, b in triangle]
        corners.append(np.stack(
            [PLACES[node[mine, a]] * (1 - s[:, None]) + PLACES[node[mine, b]] * s[:, None]
             for s, (a, b) in zip(share, triangle, strict=True)], axis=1))  # fmt: skip
        owner.append(cell[mine])
    at, cells = np.concatenate(corners), np.concatenate(owner)
    if not len(at):
        return np.full(3, np.nan)
    middle = 0.5 * (at + np.roll(at, -1, axis=1))
    nodes = flow.points[flow.cells[cells]]

    def inside(values: FloatArray, where: FloatArray) -> FloatArray:
        shape = quadratic_shapes(where.reshape(-1, 3))[0].reshape(*where.shape[:2], 10)
        return np.einsum("tqn,tnk->tqk", shape, values)

    corner = inside(nodes, at)
    area = 0.5 * np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    part = _hanging_together(flow.cells[cells, :4])
    mine = part == part[np.linalg.norm(corner.mean(axis=1) - centre, axis=1).argmin()]
    speed = inside(flow.velocity[flow.cells[cells]], middle).mean(axis=1) @ along
    pressure = inside(flow.pressure.reshape(-1, 1)[flow.cells[cells]], middle).mean(axis=(1, 2))
    area = np.where(mine, area, 0.0)
    return np.array([area.sum(), area @ speed, area @ pressure / area.sum()])


def _hanging_together(corner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Label of the part that each cell (m, 4) belongs to."""
    _, name = np.unique(corner, return_inverse=True)
    first = np.repeat(np.arange(len(corner)), 4)
    size = len(corner) + int(name.max()) + 1
    graph = coo_array(
        (np.ones(len(first)), (first, len(corner) + name.ravel())), shape=(size, size)
    )
    return np.asarray(connected_components(graph, directed=False)[1][: len(corner)])


def vessel_flow(flow: VtuFlow, net: Pieces, vessel: int) -> tuple[float, float]:
    """Flow of the vessel's clean cuts (median), and by π r⁴/8μ dp/dx between them, µL/s."""
    mine = np.flatnonzero(net.vessel == vessel)
    way = np.concatenate([[0.0], np.cumsum(net.length[mine])])
    found = []
    for fraction in FRACTIONS:
        s = fraction * way[-1]
        k = min(int(np.searchsorted(way, s, side="right")) - 1, len(mine) - 1)
        part = (s - way[k]) / net.length[mine[k]]
        start, end = net.start[mine[k]], net.end[mine[k]]
        along = (end - start) / np.linalg.norm(end - start)
        radius = float(net.radius[mine[k]] @ [1.0 - part, part])
        area, through, pressure = cut(flow, start + part * (end - start), along, radius)
        if abs(area / (np.pi * radius**2) - 1.0) <= AREA_OFF:
            found.append((s, through, pressure))
    if not found:
        return np.nan, np.nan
    s, through, pressure = np.array(found).T
    sloped = np.nan
    if len(s) > 2 and np.ptp(s) > MIN_SPAN_RADII * net.radius[mine].mean() and _straight(net, mine):
        slope = np.polyfit(s, pressure, 1)[0]
        sloped = -slope * np.pi * net.radius[mine].mean() ** 4 / (8.0 * VISCOSITY_PA_S)
    return float(np.median(through)), sloped


def _straight(net: Pieces, mine: NDArray[np.int64]) -> bool:
    """Whether Poiseuille's slope holds along a vessel: one radius, one direction."""
    return len(mine) == 1 and bool(np.ptp(net.radius[mine]) < 1e-9)


def compare(folder: Path, name: str) -> list[dict[str, Any]]:
    """Rows of one solved network."""
    net = read_network(folder / "network.csv")
    field = VtuFlow(next(folder.rglob("flow_3d.vtu")))
    with next(folder.rglob("flow_3d.csv")).open() as table:
        ours = np.array([float(r["flow_ml_min"] or "nan") for r in csv.DictReader(table)]) * UL_S
    theirs = np.array([vessel_flow(field, net, vessel) for vessel in range(len(ours))])
    off = np.abs(ours / theirs[:, 0] - 1.0)
    sloped = np.abs(ours / theirs[:, 1] - 1.0)
    clear = np.isfinite(theirs[:, 0])
    known = np.isfinite(ours)
    worst = float(np.nanmax(off))
    return [
        row(f"{name}: vessels", len(ours), ""),
        row(f"{name}: vessels without a figure", int((~known).sum()), ""),
        row(f"{name}: of them with a clean cut", int((~known & clear).sum()), ""),
        row(f"{name}: vessels without a clean cut", int((~clear).sum()), ""),
        row(f"{name}: vessels off by more than 2 %", int((off > LIMIT).sum()), "", "0",
            not (off > LIMIT).any()),
        row(f"{name}: worst against plane cuts", worst, "", f"<= {LIMIT}", worst <= LIMIT)
        | {"vessel": int(np.nanargmax(off))},
        row(f"{name}: worst against dp/dx", float(np.nanmax(sloped)), "")
        | {"vessels": int(np.isfinite(sloped).sum()), "off": int((sloped > LIMIT).sum())},
    ]  # fmt: skip


def solve(loops: int, folder: Path) -> Path:
    """Grow the cube with so many loops, and solve it in 3D, by the command."""
    text = (ROOT / "examples" / "paper" / "cube_closed.yaml").read_text()
    recipe = folder / f"cube_{loops}.yaml"
    recipe.write_text(text.replace("terminals: 31", f"terminals: {loops}"))
    out = folder / str(loops)
    given = {"--flow-ml-min": 0.25, "--viscosity-mpa-s": 1e3 * VISCOSITY_PA_S}
    options = [word for name, value in given.items() for word in (name, f"{value:g}")]
    for command in (
        ["design", str(recipe), "--until", "vasculature", "--out", str(out)],
        ["flow", str(out / "network.csv"), "--unit", "mm", "--three-d", *options,
         "--out", str(out / "flow")],
    ):  # fmt: skip
        subprocess.run([sys.executable, "-m", "printctl", *command],
                       check=True, cwd=ROOT, stdout=subprocess.DEVNULL)  # fmt: skip
    return out


def main() -> None:
    """Measure, and print rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, nargs="*", default=LOOPS)
    parser.add_argument("--solved", type=Path, nargs="*")
    asked = parser.parse_args()
    rows = [r for each in asked.solved or () for r in compare(each, each.name)]
    with tempfile.TemporaryDirectory() as folder:
        for loops in () if asked.solved else asked.loops:
            rows += compare(solve(loops, Path(folder)), f"{loops} loops")
    print_rows(rows)


if __name__ == "__main__":
    main()
