"""Grow one tree in a separate process, time it and write `network.csv`.

The product is called through its public door alone. A small tree in a box is grown first, so that
no compilation falls into what is timed. Prints one JSON line.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numba
import numpy as np

from benchmarks.checkers.read_stl import box_triangles, write_stl
from benchmarks.machine import peak_mb
from design.errors import DesignError
from design.network import VesselKind
from design.network_files.by_suffix import write_network
from design.tissue import load_tissue
from design.vasculature import (
    ClusterPool,
    GrowthOptions,
    VesselTree,
    grow_tree,
    tree_to_network,
)


def warm_up() -> float:
    """Seconds for a first small tree, compilation included."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.stl"
        write_stl(path, box_triangles(np.zeros(3), np.full(3, 10.0)))
        grow_tree(load_tissue(path, "mm"), GrowthOptions(terminals=300))
    return time.perf_counter() - begin


def digest(tree: VesselTree) -> str:
    """SHA-256 of all arrays and numbers of a tree, 16 digits."""
    found = hashlib.sha256()
    for one in fields(tree):
        value = getattr(tree, one.name)
        is_array = isinstance(value, np.ndarray)
        found.update(np.ascontiguousarray(value).data if is_array else repr(value).encode())
    return found.hexdigest()[:16]


@contextmanager
def workers(count: int) -> Iterator[ClusterPool | None]:
    """A Dask cluster of processes of one thread each; none for 0."""
    if count == 0:
        yield None
        return
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield ClusterPool(client)


def timed(
    stl: Path, options: GrowthOptions, out: Path | None, pool: ClusterPool | None
) -> dict[str, Any]:
    """Grow, and write where ``out`` is given; seconds of each step."""
    found: dict[str, Any] = {}
    begin, before = time.perf_counter(), time.process_time()
    tissue = load_tissue(stl, "mm")
    loaded, between = time.perf_counter(), time.process_time()
    tree = grow_tree(tissue, options, pool=pool)
    grown, after = time.perf_counter(), time.process_time()
    found |= {"tissue_cpu_s": between - before, "growth_cpu_s": after - between}
    found |= {"tissue_s": loaded - begin, "growth_s": grown - loaded, "peak_mb": peak_mb()}
    found["digest"] = digest(tree)
    network = tree_to_network(tree, VesselKind.ARTERY)
    found |= {"volume_mm3": tissue.volume_mm3, "segments": network.vessel_count}
    found["flow_ul_s"] = options.flow_ul_s(tissue.volume_mm3)
    found["drop_pa"] = options.pressure_drop_pa
    if out is not None:
        begin = time.perf_counter()
        write_network(out, network)
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
    parser.add_argument("--threads", type=int, help="of a large tree; all cores by default")
    parser.add_argument("--dask", type=int, default=0, help="workers in place of threads")
    asked = parser.parse_args()
    options = GrowthOptions(terminals=asked.terminals, seed=asked.seed)
    if asked.root:
        x, y, z, dx, dy, dz = asked.root
        options = replace(options, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
    found: dict[str, Any] = {"warm_up_s": warm_up()}
    if asked.threads:
        numba.set_num_threads(asked.threads)
    try:
        with workers(asked.dask) as pool:
            found |= timed(asked.stl, options, asked.out, pool)
    except DesignError as error:
        found["error"] = str(error)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
