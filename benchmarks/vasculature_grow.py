"""Grow one tree in a separate process, time it and write `network.csv`.

The product is called through its public door alone. A small tree in a box is grown first, so that
no compilation falls into what is timed. Prints one JSON line.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.read_stl import box_triangles, write_stl
from benchmarks.machine import peak_mb
from design.errors import DesignError
from design.network import VesselKind
from design.network_files.csv_format import write_network_csv
from design.tissue import load_tissue
from design.vasculature import GrowthOptions, grow_tree, tree_to_network


def warm_up() -> float:
    """Seconds for a first small tree, compilation included."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.stl"
        write_stl(path, box_triangles(np.zeros(3), np.full(3, 10.0)))
        grow_tree(load_tissue(path, "mm"), GrowthOptions(terminals=300))
    return time.perf_counter() - begin


def timed(stl: Path, options: GrowthOptions, out: Path | None) -> dict[str, Any]:
    """Grow, and write where ``out`` is given; seconds of each step."""
    found: dict[str, Any] = {}
    begin, before = time.perf_counter(), time.process_time()
    tissue = load_tissue(stl, "mm")
    loaded, between = time.perf_counter(), time.process_time()
    tree = grow_tree(tissue, options)
    grown, after = time.perf_counter(), time.process_time()
    found |= {"tissue_cpu_s": between - before, "growth_cpu_s": after - between}
    found |= {"tissue_s": loaded - begin, "growth_s": grown - loaded, "peak_mb": peak_mb()}
    network = tree_to_network(tree, VesselKind.ARTERY)
    found |= {"volume_mm3": tissue.volume_mm3, "segments": network.vessel_count}
    found["flow_ul_s"] = options.flow_ul_s(tissue.volume_mm3)
    found["drop_pa"] = options.pressure_drop_pa
    if out is not None:
        begin = time.perf_counter()
        write_network_csv(out, network)
        found |= {"export_s": time.perf_counter() - begin, "peak_export_mb": peak_mb()}
    return found


def main() -> None:
    """Read what is asked, do it, print it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--stl", type=Path, required=True)
    parser.add_argument("--terminals", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--root", type=float, nargs=6, help="point and direction")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    options = GrowthOptions(terminals=asked.terminals, seed=asked.seed)
    if asked.root:
        x, y, z, dx, dy, dz = asked.root
        options = replace(options, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
    found: dict[str, Any] = {"warm_up_s": warm_up()}
    try:
        found |= timed(asked.stl, options, asked.out)
    except DesignError as error:
        found["error"] = str(error)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
