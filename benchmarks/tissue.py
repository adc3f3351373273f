"""Tissue preparation: accuracy, speed, success rate: ``make bench-tissue``.

Exact answers come from the checkers' own box tree, for which brute force in NumPy vouches. Times
are of one thread, after a first call; ``--only battery``, ``supply`` or NAME measures a part.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

from benchmarks.machine import ROOT, commit, machine
from benchmarks.supply_bench.run import supply_row
from benchmarks.tissue_battery import battery_row
from benchmarks.tissue_queries import query_rows
from design.tissue import (
    Tissue,
    annulus,
    biventricle,
    block,
    folded_cortex,
    load_tissue,
    tissue_from_surface,
)

Row = dict[str, Any]
MESHES = ("biventricle_svv", "gyrus_patch_fsaverage5", "cortex_pial_left_fsaverage5")


def _shape(make: Callable[[], Any]) -> Tissue:
    shape = make()
    return tissue_from_surface(shape.vertices, shape.faces)


def tissues(data: Path) -> Iterator[tuple[str, Callable[[], Tissue]]]:
    """Real meshes, and shipped shapes."""
    for name in MESHES:
        yield name, lambda name=name: load_tissue(data / f"{name}.stl", "mm")  # type: ignore[misc]
    yield "block 10 mm", lambda: _shape(lambda: block((10.0, 10.0, 10.0)))
    yield "annulus", lambda: _shape(lambda: annulus(30.0, 20.0, 6.0))
    yield "folded cortex", lambda: _shape(folded_cortex)
    yield "biventricle 60 mm", lambda: _shape(biventricle)


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", help="only jobs whose name contains this")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    asked = parser.parse_args()
    numba.set_num_threads(1)
    rows: list[Row] = []
    left_out: dict[str, str] = {}
    load, measured = os.getloadavg()[0], commit()
    _shape(lambda: block((6.0, 6.0, 6.0)))
    for name, make in tissues(asked.data):
        if asked.only and asked.only not in name:
            left_out[name] = f"--only {asked.only}"
            continue
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            begin = time.perf_counter()
            tissue = make()
            rows += query_rows(name, tissue, time.perf_counter() - begin)
        except (OSError, ValueError) as error:
            left_out[name] = str(error)
    if not asked.only or asked.only in "battery":
        print("battery ...", file=sys.stderr, flush=True)
        rows.append(battery_row(asked.data / "cortex_pial_left_fsaverage5.stl"))
    if not asked.only or asked.only in "supply":
        print("supply ...", file=sys.stderr, flush=True)
        rows.append(supply_row())
    found: Row = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    found |= {"commit": measured, "rows": rows, "not_measured": left_out}
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
