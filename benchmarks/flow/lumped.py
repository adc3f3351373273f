"""Lumped steady flow in networks made without the product's growth.

"Structure known" is `solve_flow` called once with what `flow_structure` found of the same vessels
before. Mass at nodes is summed here.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from benchmarks.common import Row, limited
from design.hemodynamics import FlowConditions, flow_structure, solve_flow
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

REPEATS = 7
DRIVEN = FlowConditions(4e-3, inlet_flow_ul_s=1000.0)


def steady_rows(quick: bool) -> Iterator[Row]:
    """Yield a million vessels, from the network alone and with its structure known."""
    terminals = 20_000 if quick else 500_000
    for name, goal, network in (
        ("a tree", 0.03, binary_tree(terminals)),
        ("artery and vein joined at every terminal", 1.0, joined_trees(terminals * 2 // 5)),
    ):
        what = f"steady, {network.vessel_count:,} vessels, {name}"
        known = flow_structure(network, DRIVEN)
        cpu = median_cpu_s(partial(solve_flow, network, DRIVEN, known))
        yield limited(f"{what}, structure known", cpu, "CPU s", goal)
        cpu = median_cpu_s(partial(solve_flow, network, DRIVEN))
        yield limited(f"{what}, whole", cpu, "CPU s", goal)
        left = mass(network, solve_flow(network, DRIVEN, known).flow)
        yield limited(f"{what}: mass at a node", left, "", 1e-12)


def median_cpu_s(task: Callable[[], Any]) -> float:
    """Return the median CPU time of a few runs, s, once all is compiled and loaded."""
    task()
    cpu = []
    for _ in range(REPEATS):
        begun = time.process_time()
        task()
        cpu.append(time.process_time() - begun)
    return statistics.median(cpu)


def mass(network: VesselNetwork, flow: FloatArray) -> float:
    """Return the greatest net flow at an inner node over the flow through it."""
    net, through = np.zeros((2, len(network.nodes)))
    for column, sign in ((0, 1.0), (1, -1.0)):
        np.add.at(net, network.vessel_nodes[:, column], sign * flow)
        np.add.at(through, network.vessel_nodes[:, column], np.abs(flow))
    inner = network.degree() > 1
    return float((np.abs(net[inner]) / through[inner]).max())


def binary_tree(terminals: int, seed: int = 0) -> VesselNetwork:
    """An even binary tree by Murray's law, its nodes anywhere in a cube of 50 mm."""
    count = 2 * terminals - 1
    rng = np.random.default_rng(seed)
    number = np.arange(1, count)
    first = np.concatenate([[0], (number - 1) // 2 + 1])
    depth = np.floor(np.log2(np.arange(1, count + 1)))
    radius = 2.0 * 2.0 ** (-depth / 3.0) * np.exp(0.05 * rng.normal(size=count))
    ends = np.column_stack([first, np.arange(1, count + 1)])
    return _network(50.0 * rng.random((count + 1, 3)), ends, radius)


def joined_trees(terminals: int, seed: int = 0) -> VesselNetwork:
    """An artery and a vein that halve the same points along different axes, joined at each.

    As many loops as terminals less one, two to three times the vessels of a tree.
    """
    rng = np.random.default_rng(seed)
    points = rng.random((terminals, 3))
    artery, tips, nodes = _halving(points, 0)
    vein, others, more = _halving(points, 1)
    joints = np.column_stack([tips, others + nodes])
    ends = np.concatenate([artery, vein[:, ::-1] + nodes, joints])
    radius = np.exp(0.5 * rng.normal(size=len(ends)))
    return _network(50.0 * rng.random((nodes + more, 3)), ends, radius)


def _halving(points: FloatArray, axis: int) -> tuple[IntArray, IntArray, int]:
    """Vessels of a tree over points, each point's tip, and how many nodes; the root is 0."""
    order, tip = np.arange(len(points)), np.empty(len(points), dtype=np.int64)
    ends, stack, nodes = [(0, 1)], [(0, len(points), 1, axis)], 2
    while stack:
        low, high, node, along = stack.pop()
        if high - low == 1:
            tip[order[low]] = node
            continue
        middle = (low + high) // 2
        part = order[low:high]
        part[:] = part[np.argpartition(points[part, along], middle - low)]
        for begin, end in ((low, middle), (middle, high)):
            ends.append((node, nodes))
            stack.append((begin, end, nodes, (along + 1) % 3))
            nodes += 1
    return np.array(ends), tip, nodes


def _network(nodes: FloatArray, ends: IntArray, radius: FloatArray) -> VesselNetwork:
    kind = np.zeros(len(ends), dtype=np.int64)
    return VesselNetwork.from_segments(nodes, ends, radius, kind, kind)
