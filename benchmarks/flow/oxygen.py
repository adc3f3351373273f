"""Oxygen solver: Krogh's cylinder, and thousands of vessels in a block.

Formulas and balances are this file's own. The block is solved in a process of its own, so that
its memory is seen alone, after a small one that compiles.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from benchmarks.common import Row, at_least, limited, peak_mb, row
from design.hemodynamics import FlowConditions, FlowSolution, solve_flow
from design.hemodynamics.oxygen import (
    OxygenConditions,
    OxygenSolution,
    TissueGrid,
    grid_of_box,
    solve_oxygen,
    solve_refined,
    spacing_for,
)
from design.network import VesselNetwork
from kernels.arrays import FloatArray

OUTER, LENGTH, FLOW = 0.3, 3.0, 0.05
ZEROTH = OxygenConditions(cells_per_ml=3e7, half_millimolar=1e-7)
BLOCK = np.array([[0.0, 0.0, 0.0], [10.0, 10.0, 10.0]])
LEVELS = 10


def rows(quick: bool) -> Iterator[Row]:
    """Krogh's cylinder with its decline along the vessel; a block with a tree of 2,047 vessels."""
    cases = ((0.05, 4), (0.05, 12), (0.01, 12), (0.1, 12), (0.05, 24))
    for radius, cells in cases[: 2 if quick else None]:
        worst, rms = krogh_error(radius, cells)
        ratio = radius * cells / OUTER
        name = f"Krogh's cylinder, {cells} cells in its radius, lumen of {ratio:.3g} in radius"
        limit = 0.03 if cells == 4 else 0.015
        yield limited(f"{name}: worst error", worst, "of the fall", limit)
        yield row(f"{name}: rms error", rms, "of the fall")
    spawn = multiprocessing.get_context("spawn")
    for cells in (200_000,) if quick else (1_000_000, 4_000_000):
        with ProcessPoolExecutor(1, spawn) as pool:
            yield from pool.submit(block_rows, cells).result()


def krogh_error(radius: float, cells: int) -> tuple[float, float]:
    """Greatest and root mean square error between ends and away from the wall."""
    grid = _cylinder(cells)
    network = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [0, 0, LENGTH]]), np.array([[0, 1]]), np.array([radius]),
        np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64),
    )  # fmt: skip
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=FLOW))
    found = solve_oxygen(network, flow, grid, ZEROTH)
    h = grid.spacing_mm
    x, y, z = (grid.origin_mm[k] + h * np.arange(grid.inside.shape[k]) for k in range(3))
    r = np.hypot(x[:, None], y)[:, :, None] + 0.0 * z
    uptake = 3e7 * 5e-17 * 1e6
    outer2 = float(found.tissue_share.sum()) * h**3 / (np.pi * LENGTH) + radius**2
    taken = uptake * np.pi * (outer2 - radius**2)
    wall = 0.2 - taken * z / FLOW - taken / (np.pi * 3e-3 * 48 / 11)
    near = np.maximum(r, radius)
    fall = 2 * outer2 * np.log(near / radius) - near**2 + radius**2
    exact = wall - uptake / (4 * 2e-3) * fall
    far = grid.inside & (r > radius + 2 * h) & (z > 0.8) & (z < LENGTH - 0.8)
    off = (found.concentration - exact)[far] / (0.2 - exact[far].min())
    return float(np.abs(off).max()), float(np.sqrt((off**2).mean()))


def _cylinder(cells: int) -> TissueGrid:
    h = OUTER / cells
    across = h * (np.arange(2 * cells + 2) - cells - 0.5)
    along = h * (np.arange(round(LENGTH / h) + 2) - 0.5)
    deep = OUTER - np.hypot(across[:, None], across)
    depth = np.minimum(deep[:, :, None], np.minimum(along, LENGTH - along)).astype(np.float32)
    return TissueGrid(np.array([across[0], across[0], along[0]]), h, depth > 0.0, depth)


def block_rows(cells: int) -> list[Row]:
    """Time, memory, balance and the grid's error, of a block of 1 mL fed by a tree."""
    network = halving_tree(LEVELS)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=10.0))
    given = OxygenConditions(cells_per_ml=1e7)
    solve_refined(network, flow, _grid, spacing_for(BLOCK, 8000), given)
    before = peak_mb()
    begun = time.perf_counter()
    fine, coarse = solve_refined(network, flow, _grid, spacing_for(BLOCK, cells), given)
    spent = time.perf_counter() - begun
    name = f"oxygen, {network.vessel_count:,} vessels, {int(fine.grid.inside.sum()):,} cells"
    off = balance(network, flow, fine)
    low = float(fine.concentration[fine.grid.inside].min())
    assert coarse is not None
    worse = 100 * abs(fine.share_below(0.01) - coarse.share_below(0.01))
    return [
        row(f"{name}: time", spent, "s"),
        row(f"{name}: memory at most, and before", peak_mb(), f"MB ({before:.0f} before)"),
        limited(f"{name}: in less out less consumed, over consumed", off, "", 1e-5),
        at_least(f"{name}: least concentration", low, "mM", -1e-9),
        row(f"{name}: hypoxic", 100 * fine.share_below(0.01), "%"),
        row(f"{name}: hypoxic less that at twice the spacing", worse, "points"),
        row(f"{name}: Newton steps; multigrid cycles", fine.newton, f"; {fine.cycles}"),
    ]


def _grid(spacing: float) -> TissueGrid:
    return grid_of_box(BLOCK, spacing)


def balance(network: VesselNetwork, flow: FlowSolution, found: OxygenSolution) -> float:
    """What comes in at the root less what leaves at the tips and what the field takes up."""
    leaves = network.degree()[network.vessel_nodes[:, 1]] == 1
    out = float((flow.flow * found.exit)[leaves].sum())
    field = found.concentration
    volume = found.tissue_share * found.grid.spacing_mm**3
    taken = float((volume * 1e7 * 5e-17 * 1e6 * field / (1e-3 + field)).sum())
    return abs(10.0 * 0.2 - out - taken) / taken


def halving_tree(levels: int) -> VesselNetwork:
    """A tree that halves the block again and again, from middle to middle, by Murray's law."""
    boxes = [(BLOCK[0].copy(), BLOCK[1].copy())]
    nodes: list[FloatArray] = [np.array([5.0, 5.0, 0.0]), np.array([5.0, 5.0, 5.0])]
    ends, radius, at = [(0, 1)], [0.2], [1]
    for level in range(levels):
        axis, wide = level % 3, 0.2 * 2.0 ** (-(level + 1) / 3)
        halves, places = [], []
        for (low, high), node in zip(boxes, at, strict=True):
            middle = (low[axis] + high[axis]) / 2
            for side in (0, 1):
                a, b = low.copy(), high.copy()
                (b if side == 0 else a)[axis] = middle
                ends.append((node, len(nodes)))
                radius.append(wide)
                places.append(len(nodes))
                nodes.append((a + b) / 2)
                halves.append((a, b))
        boxes, at = halves, places
    kind = np.zeros(len(ends), dtype=np.int64)
    return VesselNetwork.from_segments(
        np.array(nodes), np.array(ends), np.array(radius), kind, kind
    )
