"""Growth at organ scale: speed, memory, correctness and volume: ``make bench-vasculature``.

``--large`` adds a million terminals, ``--huge`` ten million, ``--plot docs/growth.png`` the curve
of time against size. Every run has a process of its own in which a small tree was grown first;
what is checked is the exported `network.csv`, by the checkers of `benchmarks.checkers`. Goals are
held against the wall clock; ``cpu_s`` beside it tells what the neighbours on the machine took.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import box_triangles, write_stl
from benchmarks.machine import ROOT, commit, machine, row
from benchmarks.vasculature_anatomy import anatomy_jobs
from benchmarks.vasculature_checks import check, rows_of
from benchmarks.vasculature_loops import loop_rows, seed_rows
from benchmarks.vasculature_peer import NoPeerError, grow_svv, ratios_path
from benchmarks.vasculature_plot import growth_curve, plot_growth, slope_row
from benchmarks.vasculature_print import print_rows
from benchmarks.vasculature_runs import (
    Case,
    GrowthFailedError,
    grow,
    grow_often,
    memory,
    seconds,
    whole,
)

Row = dict[str, Any]
CUBE_MM = 10.0
CUBE_ROOT = (CUBE_MM / 2, CUBE_MM / 2, CUBE_MM, 0.0, 0.0, -1.0)
NOT_BUILT = {
    "volume against OpenCCO": "its sources (GitHub; needs DGtal) can't be fetched here",
}


def gyrus_rows(data: Path, folder: Path) -> Iterator[Row]:
    """8,000 terminals in the patch of cortex."""
    case = Case("gyrus 8,000", data / "gyrus_patch_fsaverage5.stl", 8000)
    out = folder / "gyrus.csv"
    run = grow_often(case, out)
    yield from whole(case.name, run, 5.0)
    yield seconds(case.name, run, 1.0)
    yield memory(case.name, run)
    yield from rows_of(case.name, case.terminals, check(out, case.stl, run["flow_ul_s"]))


def cube_rows(data: Path, folder: Path) -> Iterator[Row]:
    """8,000 terminals in a cube, side by side with svv: same cube, root, flow, pressures."""
    stl = folder / "cube.stl"
    write_stl(stl, box_triangles(np.zeros(3), np.full(3, CUBE_MM)))
    case = Case("cube 8,000", stl, 8000, CUBE_ROOT)
    ours, theirs = folder / "cube.csv", folder / "svv.csv"
    run = grow_often(case, ours)
    print("svv, 8,000 terminals ...", file=sys.stderr, flush=True)
    try:
        svv = grow_svv(case.terminals, CUBE_MM, run["flow_ul_s"], theirs)
    except NoPeerError as error:
        yield from rows_of(case.name, case.terminals, check(ours, stl, run["flow_ul_s"]))
        yield seconds(case.name, run) | {"peer_skipped": str(error)}
        return
    after = grow_often(case, ours)
    ratio = (run["growth_s"] + after["growth_s"]) / 2 / svv["growth_s"]
    yield seconds(case.name, run)
    yield (
        row(
            "cube 8,000: growth over svv's",
            round(ratio, 5),
            "ratio of wall clocks",
            "<= 1/30",
            ratio <= 1 / 30,
            {"name": "svv 0.0.57", "value": round(svv["growth_s"], 2), "unit": "s"},
        )
        | {"clock": "wall", "cpu_ratio": round(run["growth_cpu_s"] / svv["growth_cpu_s"], 5)}
        | {"peer_setting": "with svv-accelerated, one BLAS thread; ours before and after it"}
    )
    found, peer = (check(path, stl, run["flow_ul_s"]) for path in (ours, theirs))
    yield from rows_of(case.name, case.terminals, found, peer)
    fair = check(ratios_path(theirs), stl, run["flow_ul_s"])
    share = found.volume_mm3 / fair.volume_mm3
    yield (
        row(
            f"{case.name}: volume over svv's (radii from its own ratios)",
            round(share, 4),
            "ratio",
            peer={"name": "svv 0.0.57", "value": fair.volume_mm3, "unit": "mm³"},
        )
        | {"value_mm3": found.volume_mm3, "peer_flow_spread": fair.flow_spread}
        | {"samples": "drawn by each program itself; svv's tree differs from run to run"}
    )


def biventricle_rows(
    data: Path, folder: Path, terminals: int, goal_s: float, goal_gb: float | None
) -> Iterator[Row]:
    """A large tree in both ventricles."""
    case = Case(f"biventricle {terminals:,}", data / "biventricle_svv.stl", terminals)
    out = folder / "biventricle.csv"
    run = grow(case, out)
    yield from whole(case.name, run, goal_s)
    yield seconds(case.name, run)
    yield memory(case.name, run, goal_gb)
    print(f"{case.name}: checks ...", file=sys.stderr, flush=True)
    yield from rows_of(case.name, terminals, check(out, case.stl, run["flow_ul_s"]))
    out.unlink()


def same_rows(data: Path, folder: Path) -> Iterator[Row]:
    """100,000 terminals on one thread, two threads and two Dask workers: the same bytes."""
    case = Case("biventricle 100,000, again", data / "biventricle_svv.stl", 100_000)
    ways = {"1 thread": ("--threads", "1"), "2 threads": ("--threads", "2")}
    ways["2 Dask workers"] = ("--dask", "2")
    runs = {way: grow(case, None, *words) for way, words in ways.items()}
    found = len({run["digest"] for run in runs.values()})
    made = row("different trees by threads and workers", found, "trees", "1", found == 1)
    yield made | {way: round(run["growth_s"], 2) for way, run in runs.items()} | {"clock": "wall"}


def loop_rows_small(data: Path, folder: Path) -> Iterator[Row]:
    """Closed loops in the patch of cortex."""
    stl = data / "gyrus_patch_fsaverage5.stl"
    yield from loop_rows(Case("closed loops 2 x 500, gyrus", stl, 500), folder, 10.0)
    yield from seed_rows(stl, 500, "closed loops 2 x 500, gyrus", folder)


def loop_rows_large(data: Path, folder: Path) -> Iterator[Row]:
    """Closed loops in both ventricles."""
    stl = data / "biventricle_svv.stl"
    yield from loop_rows(Case("closed loops 2 x 10,000, biventricle", stl, 10_000), folder, 240.0)


def curve_rows(data: Path, plot: Path, most: int) -> Iterator[Row]:
    """The growth curve, drawn too."""
    curve = growth_curve(data / "biventricle_svv.stl", most)
    plot_growth(curve, plot)
    yield slope_row(curve)


def jobs(asked: argparse.Namespace, folder: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """What to measure, with the name that stands in ``not_measured`` when it fails."""
    data = asked.data
    yield "gyrus 8,000", lambda: gyrus_rows(data, folder)
    yield "cube 8,000", lambda: cube_rows(data, folder)
    yield (
        "biventricle 100,000",
        lambda: biventricle_rows(data, folder, 100_000, 15.0, None),
    )
    yield "100,000 by threads and workers", lambda: same_rows(data, folder)
    yield "closed loops 2 x 500", lambda: loop_rows_small(data, folder)
    yield "printable 500", lambda: print_rows(data, folder)
    yield from anatomy_jobs(data, folder)
    if asked.large:
        yield "closed loops 2 x 10,000", lambda: loop_rows_large(data, folder)
        yield "1,000,000", lambda: biventricle_rows(data, folder, 1_000_000, 45.0, None)
    if asked.huge:
        yield "10,000,000", lambda: biventricle_rows(data, folder, 10_000_000, 480.0, 5.0)
    if asked.plot:
        most = 1_024_000 if asked.large else 128_000
        yield "growth curve", lambda: curve_rows(data, asked.plot, most)


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", action="store_true", help="a million terminals too")
    parser.add_argument("--huge", action="store_true", help="ten million terminals too")
    parser.add_argument("--plot", type=Path, help="draw time against size into this PNG")
    parser.add_argument("--only", help="only jobs whose name contains this")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    asked = parser.parse_args()
    rows: list[Row] = []
    load, measured = os.getloadavg()[0], commit()
    left_out = dict(NOT_BUILT)
    for flag, name in ((asked.large, "1,000,000"), (asked.huge, "10,000,000")):
        if not flag:
            left_out[f"{name} terminals"] = "asked for by --large and --huge"
    if not asked.large:
        left_out["closed loops 2 x 10,000"] = "asked for by --large"
    with tempfile.TemporaryDirectory() as folder:
        for name, job in jobs(asked, Path(folder)):
            if asked.only and asked.only not in name:
                left_out[name] = f"--only {asked.only}"
                continue
            try:
                rows += job()
            except (GrowthFailedError, OSError, ValueError) as error:
                left_out[name] = str(error)
    found: Row = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    found |= {"commit": measured, "rows": rows, "not_measured": left_out}
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
