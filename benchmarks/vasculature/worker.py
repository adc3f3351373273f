"""Grow one tree, closed loops or a printable tree in a process of its own; write `network.csv`.

``python -m benchmarks.vasculature.worker WAY STL TERMINALS SEED OUT [x y z dx dy dz]``. A small
case is grown first, so that no compilation falls into what is timed. Prints one JSON line.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.meshes import box_triangles, write_stl
from benchmarks.common import peak_mb
from design.errors import DesignError
from design.hemodynamics import FlowConditions, balance
from design.network import VesselKind
from design.network_files.by_suffix import write_network
from design.tissue import Tissue, load_tissue
from design.vasculature import (
    GrowthOptions,
    RootSpec,
    close_loops,
    grow_forest,
    grow_printable,
    grow_tree,
    tree_to_network,
)

LUMEN_MM, WALL_MM = 0.4, 0.3


def tree(tissue: Tissue, options: GrowthOptions) -> tuple[Any, dict[str, Any]]:
    """Return an arterial tree as a network, and the flow that it was grown for."""
    made = grow_tree(tissue, options)
    return tree_to_network(made, VesselKind.ARTERY), {}


def loops(tissue: Tissue, options: GrowthOptions) -> tuple[Any, dict[str, Any]]:
    """Return artery and vein joined, and how many terminals were; balanced if some were pruned."""
    drain = replace(options, root_at_top=False)
    artery, vein = grow_forest(tissue, [RootSpec(options), RootSpec(drain, VesselKind.VEIN)])
    closed = close_loops(tissue, artery, vein)
    network = closed.network
    if closed.pruned:
        flow = options.flow_ul_s(tissue.volume_mm3)
        conditions = FlowConditions(options.viscosity_pa_s, inlet_flow_ul_s=flow)
        network = balance(network, conditions, widen=False)
    return network, {"connections": closed.connections, "pruned": closed.pruned}


def printable(tissue: Tissue, options: GrowthOptions) -> tuple[Any, dict[str, Any]]:
    """Return a tree whose lumens and walls a printer can make, and how many terminals it has."""
    made = grow_printable(tissue, options)
    known = {"reached": made.reached, "drop_pa": made.tree.pressure_drop_pa}
    known["viscosity_pa_s"] = made.tree.viscosity_pa_s
    return tree_to_network(made.tree, VesselKind.ARTERY), known


WAYS = {"tree": tree, "loops": loops, "printable": printable}


def options_for(way: str, terminals: int, seed: int, root: list[float]) -> GrowthOptions:
    """Return the way's options; without a root it is the fixed cases', the highest vertex."""
    more: dict[str, Any] = {"root_at_top": not root}
    if root:
        more |= {"root_point_mm": tuple(root[:3]), "root_direction": tuple(root[3:])}
    if way == "printable":
        more |= {"smallest_radius_mm": LUMEN_MM / 2, "clearance_mm": WALL_MM}
    return GrowthOptions(terminals=terminals, seed=seed, **more)


def warm_up(way: str) -> None:
    """Do the same in a small box, so that all kernels are loaded."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.stl"
        write_stl(path, box_triangles(np.zeros(3), np.full(3, 20.0)))
        WAYS[way](load_tissue(path, "mm"), options_for(way, 60, 1, []))


def main() -> None:
    """Grow what the command line names, and print what was found."""
    way, stl, terminals, seed, out, *root = sys.argv[1:]
    options = options_for(way, int(terminals), int(seed), [float(value) for value in root])
    found: dict[str, Any] = {}
    try:
        warm_up(way)
        wall, cpu = time.perf_counter(), time.process_time()
        tissue = load_tissue(Path(stl), "mm")
        loaded, loaded_cpu = time.perf_counter(), time.process_time()
        network, known = WAYS[way](tissue, options)
        found |= known | {"tissue_s": loaded - wall, "growth_s": time.perf_counter() - loaded}
        found["growth_cpu_s"] = time.process_time() - loaded_cpu
        found["cpu_s"] = time.process_time() - cpu
        found["flow_ul_s"] = options.flow_ul_s(tissue.volume_mm3)
        write_network(Path(out), network)
        found["peak_mb"] = peak_mb()
    except DesignError as error:
        found["error"] = str(error)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
