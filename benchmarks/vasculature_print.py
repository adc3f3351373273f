"""Benchmark of printable growth: violations of printer limits, counted by the checkers."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import (
    near_pairs,
    outlet_flows,
    pieces_outside,
    read_network,
    read_stl,
    spread,
    write_stl,
)
from benchmarks.machine import ROOT, row
from benchmarks.vasculature_grow import warm_up
from benchmarks.vasculature_runs import GrowthFailedError
from design.network import VesselKind
from design.network_files.csv_format import write_network_csv
from design.tissue import load_tissue
from design.vasculature import GrowthOptions, tree_to_network
from design.vasculature.growth.printable import grow_printable

LONGEST_MM = 60.0
LUMEN_MM, WALL_MM = 0.4, 0.3
ROUNDING_MM = 1e-9


def print_rows(data: Path, folder: Path, terminals: int = 500) -> Iterator[dict[str, Any]]:
    """The biventricle scaled to 60 mm, lumens and walls as the paper's printer leaves them."""
    stl, out = folder / "biventricle_60.stl", folder / "printable.csv"
    triangles = read_stl(data / "biventricle_svv.stl")
    extent = np.ptp(triangles.reshape(-1, 3), axis=0).max()
    write_stl(stl, triangles * (LONGEST_MM / extent))
    run = _grow(stl, terminals, out)
    net, triangles = read_network(out), read_stl(stl)
    near = near_pairs(net, clearance_mm=WALL_MM)
    # A lumen with its wall around it must be in the tissue.
    walled = replace(net, radius=net.radius + WALL_MM)
    thin = int((net.radius < LUMEN_MM / 2 - ROUNDING_MM).sum())
    outside = len(pieces_outside(walled, triangles).pieces)
    name = f"printable {terminals:,} in the biventricle at 60 mm"
    found = len(near.colliding) + thin + outside
    reached = len(net.outlets())
    yield row(f"{name}: violations", found, "vessels and pairs", "0", found == 0) | {
        "lumens_below_0.4_mm": thin,
        "walls_below_0.3_mm_between_vessels": len(near.colliding),
        "walls_below_0.3_mm_to_the_surface": outside,
        "near_within_joints": len(near.within_joints),
    }
    yield row(f"{name}: terminals reached", reached, "1", f"{terminals}", reached == terminals) | {
        "note": run["note"]
    }
    yield row(f"{name}: growth, audited", round(run["growth_s"], 2), "s") | {"clock": "wall"}
    flows = outlet_flows(net, run["drop_pa"], run["viscosity_pa_s"])
    yield row(f"{name}: terminal flow spread", spread(flows), "(max - min) / mean", "stated")


def _grow(stl: Path, terminals: int, out: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.vasculature_print", str(stl), str(terminals)]
    print(f"printable {terminals:,} ...", file=sys.stderr, flush=True)
    done = subprocess.run(
        [*command, str(out)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise GrowthFailedError(done.stderr.strip().splitlines()[-1])
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def main() -> None:
    """Grow in this process and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stl", type=Path)
    parser.add_argument("terminals", type=int)
    parser.add_argument("out", type=Path)
    asked = parser.parse_args()
    warm_up()
    tissue = load_tissue(asked.stl, "mm")
    options = GrowthOptions(
        terminals=asked.terminals, smallest_radius_mm=LUMEN_MM / 2, clearance_mm=WALL_MM
    )
    begin = time.perf_counter()
    done = grow_printable(tissue, options)
    growth_s = time.perf_counter() - begin
    write_network_csv(asked.out, tree_to_network(done.tree, VesselKind.ARTERY))
    found = {"growth_s": growth_s, "reached": done.reached, "note": done.note}
    found |= {"drop_pa": done.tree.pressure_drop_pa, "viscosity_pa_s": done.tree.viscosity_pa_s}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
