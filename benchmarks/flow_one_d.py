"""Benchmark rows on 1D flow: convergence order, an arterial tree, cost per step.

The order is taken against the exact characteristics of a wave in one direction, computed here; the
tree's error against cells of an eighth. CPU time is this process' own, wall time a median.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from statistics import median

import numpy as np

from benchmarks.command import Row
from benchmarks.flow_arteries import arteries, heart_and_beds
from benchmarks.machine import row
from design.hemodynamics import (
    OneDOptions,
    OneDSolution,
    PressureOutlet,
    PulsatileConditions,
    ThinWall,
    WindkesselOutlet,
    solve_one_d,
)
from design.hemodynamics.one_d.march import advance, make_work
from design.hemodynamics.one_d.solve import set_up_problem
from design.hemodynamics.waveforms import Constant, Sine
from design.network import FloatArray, VesselNetwork

LENGTH, RADIUS, DENSITY = 1000.0, 5.0, 1.06e-3
WALL = ThinWall(4e5, 0.5)
SPEED = float(np.sqrt(4e5 * 0.5 / 0.75 / RADIUS / (2.0 * DENSITY)))
UNTIL = 0.04
REPEATS = 5


def one_d_rows(quick: bool) -> Iterator[Row]:
    """Order, speed against real time, and cost."""
    yield from order_rows()
    yield from network_order_rows()
    yield from tree_rows(quick)


def order_rows() -> Iterator[Row]:
    """Mean error in area of a smooth wave, on 50 to 800 cells; the slope of its logarithm."""
    counts = [50, 100, 200, 400, 800]
    errors = [float(np.abs(wave_error(n)).mean()) / (np.pi * RADIUS**2) for n in counts]
    slope = -float(np.polyfit(np.log(counts[1:]), np.log(errors[1:]), 1)[0])
    yield row("1D, smooth wave: order of convergence, 100 to 800 cells", slope, "",
              ">= 1.9", slope >= 1.9)  # fmt: skip
    yield row("1D, smooth wave: error in area on 800 cells, of the area", errors[-1], "")


def network_order_rows() -> Iterator[Row]:
    """A loop of tapered vessels with friction and a Windkessel, periodic; against a finer grid."""
    network = tapered_loop()
    conditions = PulsatileConditions(
        4e-3, Sine(2e4, 1.5e4, 0.5), outlet=WindkesselOutlet(0.03, 5.0, 0.2), wall=WALL,
        density=DENSITY, outlets=(5,),
    )  # fmt: skip
    sizes = [40.0, 20.0, 10.0]
    coarse = [solve_one_d(network, conditions, _cells(size)) for size in sizes]
    fine = solve_one_d(network, conditions, _cells(2.5))
    errors = [waves_apart(found, fine) for found in coarse]
    slope = float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
    yield row("1D, loop with tapers, friction and Windkessel: order, cells of 40 to 10 mm",
              slope, "", ">= 1.9", slope >= 1.9)  # fmt: skip
    yield row("1D, the same: greatest error of a wave on cells of 10 mm, of its swing",
              100.0 * errors[-1], "%")  # fmt: skip


def _cells(size_mm: float) -> OneDOptions:
    return OneDOptions(cell_mm=size_mm, least_cells=2, tolerance=1e-8, samples=40)


def tapered_loop() -> VesselNetwork:
    """Six vessels, two of which close a loop, all narrowing or widening."""
    nodes = [[0, 0, 0], [400, 0, 0], [600, 200, 0], [600, -150, 0], [900, 0, 0], [1200, 0, 0]]
    ends = np.array([(0, 1), (1, 2), (1, 3), (2, 4), (4, 3), (4, 5)])
    radius = [6.5, 6.0, 4.5, 4.0, 3.4, 3.2, 4.0, 3.6, 3.0, 3.2, 5.0, 4.6]
    kind = np.zeros(6, dtype=np.int64)
    at = np.array(nodes, dtype=np.float64)
    return VesselNetwork(at, ends, kind, kind, 2 * np.arange(7), at[ends.ravel()], np.array(radius))


def tree_rows(quick: bool) -> Iterator[Row]:
    """50 arteries under a heart's ejection, a Windkessel at each end."""
    network = arteries(50)
    conditions = heart_and_beds(network)
    found = solve_one_d(network, conditions)
    told = f"1D, {network.vessel_count} arteries, {found.cells} cells, {found.steps} steps a cycle"
    spent, cpu, whole = [], [], []
    for _ in range(REPEATS):
        wall, processor = time.perf_counter(), time.process_time()
        again = solve_one_d(network, conditions)
        whole.append(time.perf_counter() - wall)
        spent.append(whole[-1] / len(again.change))
        cpu.append((time.process_time() - processor) / len(again.change))
    goal = median(spent)
    yield row(f"{told}: one cycle of 1 s", goal, "s", "<= 2", goal <= 2.0)
    yield row(f"{told}: periodic state, {len(found.change)} cycles", median(whole), "s")
    each = median(cpu) / found.steps / found.cells
    yield row(f"{told}: CPU time of a cell's step, nodes and all", 1e9 * each, "ns")
    yield row("1D, one vessel of 4,000 cells: CPU time of a cell's step", 1e9 * cell_step_s(), "ns")
    if not quick:
        least = OneDOptions().least_cells
        fine = OneDOptions(cells_per_period=3200, least_cells=16 * least, tolerance=1e-5)
        error = waves_apart(found, solve_one_d(network, conditions, fine))
        yield row(f"{told}: greatest error of a pressure or flow wave, of its swing",
                  100.0 * error, "%", "<= 1", error <= 0.01)  # fmt: skip


def waves_apart(one: OneDSolution, other: OneDSolution) -> float:
    """Greatest difference at vessels' ends and middles over the swing there."""
    worst = 0.0
    for name in ("pressure_in", "pressure", "pressure_out", "flow_in", "flow", "flow_out"):
        here, there = getattr(one, name), getattr(other, name)
        apart = np.abs(here - there).max(axis=1) / np.ptp(there, axis=1)
        worst = max(worst, float(apart.max()))
    return worst


def tube(cells: int) -> tuple[VesselNetwork, PulsatileConditions, OneDOptions]:
    """A straight vessel without friction whose outlet swallows waves."""
    kind = np.zeros(1, dtype=np.int64)
    network = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [LENGTH, 0, 0]]), np.array([[0, 1]]), np.array([RADIUS]), kind, kind
    )
    conditions = PulsatileConditions(
        1e-12, Constant(0.0), wall=WALL, density=DENSITY, outlet=PressureOutlet(Constant(0.0))
    )
    return network, conditions, OneDOptions(cell_mm=LENGTH / cells, alpha=1.0, reflection={1: 0.0})


def wave_error(cells: int) -> FloatArray:
    """Area's error of a wave to the right, its left-going invariant u - 4c at rest everywhere."""
    problem = set_up_problem(*tube(cells))
    grid, state, size = problem.grid, problem.state, LENGTH / cells
    points, weights = np.polynomial.legendre.leggauss(4)
    x = (np.arange(cells) + 0.5)[:, None] * size + points * size / 2.0

    def speed_at(place: FloatArray) -> FloatArray:
        return np.asarray(SPEED * (1.0 + 0.02 * np.exp(-(((place - 350.0) / 70.0) ** 2))))

    def area(c: FloatArray) -> FloatArray:
        return np.asarray(np.pi * RADIUS**2 * (c / SPEED) ** 4)

    c = speed_at(x)
    state.area[:] = area(c) @ weights / 2.0
    state.flow[:] = (area(c) * 4.0 * (c - SPEED)) @ weights / 2.0
    grid = grid._replace(small_pressure=np.full(1, 1e6), small_flow=np.full(1, 1e7))
    steps = int(np.ceil(1.3 * UNTIL * SPEED / size))
    nothing = np.zeros((2 * steps + 1, len(problem.waves)))
    advance(grid, problem.nodes, state, nothing, UNTIL / steps, make_work(grid, problem.nodes))
    # Each c runs at u + c = 5c - 4c₀ from where it began.
    began = x - SPEED * UNTIL
    for _ in range(60):
        gap = began + (5.0 * speed_at(began) - 4.0 * SPEED) * UNTIL - x
        slope = 1.0 + 5.0 * UNTIL * (speed_at(began + 1e-3) - speed_at(began)) / 1e-3
        began -= gap / slope
    return np.asarray(state.area - area(speed_at(began)) @ weights / 2.0)


def cell_step_s(cells: int = 4000, steps: int = 500) -> float:
    """CPU time of a step over its cells, s; the median of a few."""
    problem = set_up_problem(*tube(cells))
    work = make_work(problem.grid, problem.nodes)
    nothing = np.zeros((2 * steps + 1, len(problem.waves)))
    spent = []
    for _ in range(REPEATS):
        begun = time.process_time()
        advance(problem.grid, problem.nodes, problem.state, nothing, 1e-5, work)
        spent.append(time.process_time() - begun)
    return median(spent) / steps / cells
