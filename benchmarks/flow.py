"""Flow solvers: 0D (steady, pulsatile, balances), 1D, oxygen, 3D: ``make bench-flow``.

``--only NAME`` measures a part; ``--quick`` leaves the million vessels out. Balances are taken by
sums of this file's own. "Structure known" is `solve_flow` called once with what `flow_structure`
found of the same vessels before.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.checkers.lumped_energy import (
    along,
    mass,
    pulsatile_energy,
    resistance,
    steady_energy,
)
from benchmarks.command import Job, Row, run
from benchmarks.flow_lumens import lumen_rows
from benchmarks.flow_networks import binary_tree, crossed_tree, joined_trees, tapered
from benchmarks.flow_one_d import one_d_rows
from benchmarks.flow_openbf import openbf_rows
from benchmarks.flow_oxygen import oxygen_rows
from benchmarks.flow_ranks import ranks_rows
from benchmarks.flow_tables import table_rows
from benchmarks.flow_three_d import pipe_rows, womersley_rows
from benchmarks.machine import row
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    GelWall,
    PulsatileConditions,
    WindkesselOutlet,
    flow_structure,
    solve_flow,
    solve_pulsatile,
)
from design.hemodynamics.waveforms import Sine, shape

REPEATS = 7
YOUNG_PA = 1e6
DRIVEN = FlowConditions(4e-3, inlet_flow_ul_s=1000.0)
WINDKESSEL = WindkesselOutlet(1e4, 1e-5, 1e5)


def median(task: Callable[[], Any]) -> tuple[float, float]:
    """Medians of wall and CPU time of a few runs, s, once all is compiled and loaded."""
    task()
    wall, cpu = [], []
    for _ in range(REPEATS):
        begun, busy = time.perf_counter(), time.process_time()
        task()
        wall.append(time.perf_counter() - begun)
        cpu.append(time.process_time() - busy)
    return statistics.median(wall), statistics.median(cpu)


def timed(measure: str, goal_s: float | None, task: Callable[[], Any]) -> Row:
    """A row of wall time, with the CPU time beside it: the machine may be shared."""
    wall, cpu = median(task)
    if goal_s is None:
        return row(measure, wall, "s") | {"cpu_s": cpu}
    return row(measure, wall, "s", f"<= {goal_s:g}", wall <= goal_s) | {"cpu_s": cpu}


def steady_rows(quick: bool) -> Iterator[Row]:
    """A million vessels: `solve_flow` from the network alone, and with its structure known."""
    terminals = 50_000 if quick else 500_000
    for name, goal, network in (
        ("a tree", 0.03, binary_tree(terminals)),
        ("1,000 loops", 1.0, crossed_tree(terminals, 1000)),
        ("artery and vein joined at every terminal", 1.0, joined_trees(terminals * 2 // 5)),
    ):
        what = f"steady, {network.vessel_count:,} vessels, {name}: solve_flow"
        known = flow_structure(network, DRIVEN)
        yield timed(
            f"{what}, structure known", goal,
            lambda network=network, known=known: solve_flow(network, DRIVEN, known),
        )  # fmt: skip
        yield timed(f"{what}, whole", goal, lambda network=network: solve_flow(network, DRIVEN))
        found = solve_flow(network, DRIVEN, known)
        left = mass(network, found.flow, found.flow)
        yield row(f"{what}: mass at a node", left, "", "<= 1e-12", left <= 1e-12)
    blood = replace(DRIVEN, fluid=Carreau())
    tree = binary_tree(terminals // 10)
    yield timed(
        f"steady, {tree.vessel_count:,} vessels, Carreau blood", None,
        lambda: solve_flow(tree, blood),
    )  # fmt: skip


def pulsatile_rows(quick: bool) -> Iterator[Row]:
    """10,000 terminals, the periodic state."""
    network = binary_tree(1000 if quick else 10_000)
    conditions = PulsatileConditions(
        4e-3, Sine(1000.0, 400.0, 1.0), outlet=WINDKESSEL, wall=GelWall(10e3)
    )
    heart = PulsatileConditions(
        4e-3, shape("ejection", 1000.0, 1.0), outlet=WINDKESSEL, wall=GelWall(10e3)
    )
    for name, each in (("sine", conditions), ("ejection, 199 harmonics", heart)):
        _, spent = median(lambda each=each: solve_pulsatile(network, each))
        yield row(f"pulsatile, periodic state solved for, {name}", spent, "CPU s")


def balance_rows(quick: bool) -> Iterator[Row]:
    """Mass at every node and energy in whole, steady and pulsatile, on trees and loops."""
    for name, network in (
        ("tree", tapered(binary_tree(10_000))),
        ("loops", tapered(joined_trees(2000 if quick else 10_000))),
    ):
        resists = resistance(network, DRIVEN.viscosity_pa_s)
        found = solve_flow(network, DRIVEN)
        left = mass(network, found.flow, found.flow)
        energy = steady_energy(network, resists, found.pressure, found.flow)
        yield row(f"steady, {name}: mass at a node", left, "", "<= 1e-12", left <= 1e-12)
        yield row(f"steady, {name}: energy", energy, "", "<= 1e-9", energy <= 1e-9)
        conditions = PulsatileConditions(
            4e-3, Sine(1000.0, 400.0, 1.0), outlet=WINDKESSEL, wall=GelWall(YOUNG_PA)
        )
        pulse = solve_pulsatile(network, conditions)
        left = max(
            mass(network, pulse.flow_in[k], pulse.flow_out[k]) for k in range(len(pulse.harmonic))
        )
        yield row(f"pulsatile, {name}: mass at a node", left, "", "<= 1e-12", left <= 1e-12)
        times = pulse.times(16)
        turning = 1j * pulse.omega[:, None] * pulse.pressure
        # Lamé's lumen in thick gel, ν = ½.
        compliance = 3.0 * np.pi / YOUNG_PA * along(network, 2)
        waves = tuple(pulse.at(x, times) for x in (pulse.pressure, pulse.flow_in, pulse.flow_out))
        energy = pulsatile_energy(network, resists, compliance, waves, pulse.at(turning, times))
        yield row(f"pulsatile, {name}: energy", energy, "", "<= 1e-9", energy <= 1e-9)


JOBS: dict[str, Job] = {
    "steady": steady_rows,
    "pulsatile": pulsatile_rows,
    "balance": balance_rows,
    "one_d": one_d_rows,
    "oxygen": oxygen_rows,
    "pipe": pipe_rows,
    "womersley": womersley_rows,
    "lumens": lumen_rows,
    "ranks": ranks_rows,
    "openbf": openbf_rows,
    "tables": table_rows,
}


if __name__ == "__main__":
    run(JOBS, __doc__)
