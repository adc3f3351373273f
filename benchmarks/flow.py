"""Lumped flow: steady, pulsatile, and its balances: ``make bench-flow``.

``--only NAME`` measures a part; ``--quick`` leaves the million vessels out. Balances are taken by
sums of this file's own. svZeroDSolver's time for the same case, 15.8 CPU s, was measured on this
kind of machine before (issue 8); it isn't on the package index, so it isn't run here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.command import Job, Row, run
from benchmarks.flow_networks import binary_tree, crossed_tree, joined_trees
from benchmarks.flow_ranks import ranks_rows
from benchmarks.machine import row
from design.hemodynamics import (
    FlowConditions,
    GelWall,
    PulsatileConditions,
    WindkesselOutlet,
    solve_flow,
    solve_pulsatile,
    vessel_resistance,
)
from design.hemodynamics.waveforms import Sine, shape
from design.hemodynamics.zero_d.nodal.conductance import structure_of
from design.hemodynamics.zero_d.pulsatile import MarchOptions, march
from design.hemodynamics.zero_d.svzerod import svzerod_input
from design.hemodynamics.zero_d.svzerod.read import case_of
from design.network import FloatArray, VesselNetwork

PEER_S = 15.8
REPEATS = 3
DRIVEN = FlowConditions(4e-3, inlet_flow_ul_s=1000.0)
WINDKESSEL = WindkesselOutlet(1e4, 1e-5, 1e5)


def best(task: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Least of a few times, s, once all is compiled and loaded."""
    task()
    spent = []
    for _ in range(REPEATS):
        begun = clock()
        task()
        spent.append(clock() - begun)
    return min(spent)


def steady_rows(quick: bool) -> Iterator[Row]:
    """A million vessels."""
    terminals = 50_000 if quick else 500_000
    tree = binary_tree(terminals)
    count = f"{tree.vessel_count:,} vessels"
    conductance = 1.0 / vessel_resistance(tree, 4e-3)
    fixed = tree.degree() == 1
    given = np.zeros(len(fixed))
    given[0] = 1000.0

    def linear() -> None:
        system = structure_of(tree.vessel_nodes, fixed).factorise(conductance)
        system.solve(np.zeros(len(fixed)), given)

    spent = best(linear)
    yield row(f"steady, tree of {count}: linear solve", spent, "s", "<= 0.03", spent <= 0.03)
    whole = best(lambda: solve_flow(tree, DRIVEN))
    yield row(f"steady, tree of {count}: solve_flow, whole", whole, "s")
    for name, network in (
        ("1,000 loops", crossed_tree(terminals, 1000)),
        ("artery and vein joined at every terminal", joined_trees(terminals * 2 // 5)),
    ):
        spent = best(lambda network=network: solve_flow(network, DRIVEN))
        measure = f"steady, {network.vessel_count:,} vessels, {name}: solve_flow, whole"
        yield row(measure, spent, "s", "<= 1", spent <= 1.0)


def pulsatile_rows(quick: bool) -> Iterator[Row]:
    """10,000 terminals, one cycle of 100 steps, the R-C-L of svZeroDSolver and its output."""
    network = binary_tree(1000 if quick else 10_000)
    conditions = PulsatileConditions(
        4e-3, Sine(1000.0, 400.0, 1.0), outlet=WINDKESSEL, wall=GelWall(10e3)
    )
    case = case_of(svzerod_input(network, conditions, steps=100, cycles=1))
    options = MarchOptions(100, 1, None)
    spent = best(lambda: march(case.circuit, options), time.process_time)
    peer = {"name": "svZeroDSolver (measured earlier)", "value": PEER_S}
    yield row("pulsatile, one cycle of 100 steps, R-C-L and RCR", spent, "CPU s",
              "<= 0.79", spent <= PEER_S / 20.0, peer)  # fmt: skip
    heart = PulsatileConditions(
        4e-3, shape("ejection", 1000.0, 1.0), outlet=WINDKESSEL, wall=GelWall(10e3)
    )
    for name, each in (("sine", conditions), ("ejection, 49 harmonics", heart)):
        spent = best(lambda each=each: solve_pulsatile(network, each), time.process_time)
        yield row(f"pulsatile, periodic state solved for, {name}", spent, "CPU s")


def balance_rows(quick: bool) -> Iterator[Row]:
    """Mass at every node and energy in whole, steady and pulsatile, on trees and loops."""
    for name, network in (
        ("tree", binary_tree(10_000)),
        ("loops", joined_trees(2000 if quick else 10_000)),
    ):
        found = solve_flow(network, DRIVEN)
        mass, energy = _steady_balance(network, found.pressure, found.flow)
        yield row(f"steady, {name}: mass at a node", mass, "", "<= 1e-12", mass <= 1e-12)
        yield row(f"steady, {name}: energy", energy, "", "<= 1e-9", energy <= 1e-9)
        conditions = PulsatileConditions(
            4e-3, Sine(1000.0, 400.0, 1.0), outlet=WINDKESSEL, wall=GelWall(1e6)
        )
        pulse = solve_pulsatile(network, conditions)
        mass = max(
            _mass(network, pulse.flow_in[k], pulse.flow_out[k]) for k in range(len(pulse.harmonic))
        )
        yield row(f"pulsatile, {name}: mass at a node", mass, "", "<= 1e-12", mass <= 1e-12)


def _mass(network: VesselNetwork, leaving: Any, entering: Any) -> float:
    net = np.zeros(len(network.nodes), dtype=np.complex128)
    through = np.zeros(len(network.nodes))
    for column, flow, sign in ((0, leaving, 1.0), (1, entering, -1.0)):
        np.add.at(net, network.vessel_nodes[:, column], sign * flow)
        np.add.at(through, network.vessel_nodes[:, column], np.abs(flow))
    inner = network.degree() > 1
    return float((np.abs(net[inner]) / through[inner]).max())


def _steady_balance(
    network: VesselNetwork, pressure: FloatArray, flow: FloatArray
) -> tuple[float, float]:
    first, last = network.vessel_nodes.T
    ends = network.degree() == 1
    into = np.where(ends[first], flow, 0.0), np.where(ends[last], -flow, 0.0)
    power = float(pressure[first] @ into[0] + pressure[last] @ into[1])
    lost = float(vessel_resistance(network, DRIVEN.viscosity_pa_s) @ flow**2)
    return _mass(network, flow, flow), abs(power - lost) / lost


JOBS: dict[str, Job] = {
    "steady": steady_rows,
    "pulsatile": pulsatile_rows,
    "balance": balance_rows,
    "ranks": ranks_rows,
}


if __name__ == "__main__":
    run(JOBS, __doc__)
