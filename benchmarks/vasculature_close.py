"""Grow artery and vein and join them to loops in a separate process; write `network.csv`.

The product is called through its public door alone. Small trees in a box are closed first, so
that no compilation falls into what is timed. Prints one JSON line.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.read_stl import box_triangles, write_stl
from benchmarks.vasculature_grow import peak_mb
from design.errors import DesignError
from design.hemodynamics import FlowConditions, balance
from design.network import VesselKind
from design.network_files.csv_format import write_network_csv
from design.tissue import Tissue, load_tissue
from design.vasculature import (
    ClosedLoops,
    GrowthOptions,
    LoopOptions,
    RootSpec,
    VesselTree,
    close_loops,
    grow_forest,
)


def forest(tissue: Tissue, options: GrowthOptions) -> tuple[VesselTree, ...]:
    """An artery and a vein."""
    return grow_forest(tissue, [RootSpec(options), RootSpec(options, VesselKind.VEIN)])


def warm_up() -> float:
    """Seconds for first small loops, compilation included; crowded, so that some go round."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.stl"
        write_stl(path, box_triangles(np.zeros(3), np.array([30.0, 4.0, 4.0])))
        tissue = load_tissue(path, "mm")
        trees = forest(tissue, GrowthOptions(terminals=60))
        for bend in (2.0, 100.0):
            try:
                closed = close_loops(tissue, *trees, LoopOptions(bend_to_radius=bend))
            except DesignError:
                continue
            balance(closed.network, FlowConditions(4e-3, inlet_flow_ul_s=1.0), widen=False)
    return time.perf_counter() - begin


def timed(stl: Path, options: GrowthOptions, out: Path) -> dict[str, Any]:
    """Grow, close, balance where pairs were pruned, write; seconds of each step."""
    found: dict[str, Any] = {}
    begin, before = time.perf_counter(), time.process_time()
    tissue = load_tissue(stl, "mm")
    loaded = time.perf_counter()
    trees = forest(tissue, options)
    grown = time.perf_counter()
    closed = balanced(close_loops(tissue, *trees), options, tissue)
    done, after = time.perf_counter(), time.process_time()
    found |= {"tissue_s": loaded - begin, "forest_s": grown - loaded, "close_s": done - grown}
    found |= {"cpu_s": after - before, "peak_mb": peak_mb(), "terminals": options.terminals}
    for name in ("connections", "routed", "shortened", "pruned"):
        found[name] = getattr(closed, name)
    write_network_csv(out, closed.network)
    return found


def balanced(closed: ClosedLoops, options: GrowthOptions, tissue: Tissue) -> ClosedLoops:
    """The loops as they are, or balanced where some were pruned."""
    if not closed.pruned:
        return closed
    flow = options.flow_ul_s(tissue.volume_mm3)
    conditions = FlowConditions(options.viscosity_pa_s, inlet_flow_ul_s=flow)
    network = balance(closed.network, conditions, widen=False)
    counts = (closed.connections, closed.routed, closed.shortened, closed.pruned)
    return ClosedLoops(network, *counts)


def main() -> None:
    """Read what is asked, do it, print it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--stl", type=Path, required=True)
    parser.add_argument("--terminals", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    options = GrowthOptions(terminals=asked.terminals, seed=asked.seed)
    found: dict[str, Any] = {"warm_up_s": warm_up()}
    try:
        found |= timed(asked.stl, options, asked.out)
    except DesignError as error:
        found["error"] = str(error)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
