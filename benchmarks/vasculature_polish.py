"""Grow and polish a tree in a separate process; benchmark rows on the saved volume."""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import box_triangles, read_network, total_volume, write_stl
from benchmarks.machine import row
from benchmarks.vasculature_checks import check
from benchmarks.vasculature_runs import Case, run_module
from design.errors import DesignError
from design.network_files.csv_format import write_network_csv
from design.tissue import load_tissue
from design.vasculature import GrowthOptions, grow_tree, tree_to_network
from design.vasculature.polish import PolishOptions, polish

Row = dict[str, Any]


def polish_case(case: Case, before: Path, after: Path) -> dict[str, Any]:
    """One run in a process of its own; what it prints.

    Raises
    ------
    GrowthFailedError
        When the process fails or the product refuses.
    """
    words = ["--stl", str(case.stl), "--terminals", str(case.terminals)]
    words += ["--root", *map(str, case.root)] if case.root else []
    words += ["--before", str(before), "--after", str(after)]
    return run_module(f"{case.name}, polish", "benchmarks.vasculature_polish", words)


def polish_rows(case: Case, folder: Path) -> Iterator[Row]:
    """Volume saved, and whether the polished file is as right as the grown one."""
    before, after = folder / "grown.csv", folder / "polished.csv"
    run = polish_case(case, before, after)
    volumes = [total_volume(read_network(path)) for path in (before, after)]
    found = check(after, case.stl, run["flow_ul_s"])
    share = volumes[1] / volumes[0]
    made = row(f"{case.name}: volume after polish over before", round(share, 4), "ratio")
    yield made | {"value_mm3": volumes[1], "polish_s": round(run["polish_s"], 2)}
    worst = found.colliding_pairs + found.segments_outside
    yield (
        row(f"{case.name}, polished: faults", worst, "pairs and segments", "0", worst == 0)
        | {"colliding_pairs": found.colliding_pairs, "segments_outside": found.segments_outside}
        | {"overlaps_percent": found.overlaps_percent, "flow_spread": found.flow_spread}
    )


def warm_up() -> None:
    """Grow and polish a small tree, so that no compilation falls into what is timed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.stl"
        write_stl(path, box_triangles(np.zeros(3), np.full(3, 10.0)))
        tissue = load_tissue(path, "mm")
        polish(tissue, grow_tree(tissue, GrowthOptions(terminals=200)), PolishOptions())


def timed(stl: Path, options: GrowthOptions, before: Path, after: Path) -> dict[str, Any]:
    """Grow, write, polish, write; seconds of the polish."""
    tissue = load_tissue(stl, "mm")
    tree = grow_tree(tissue, options)
    write_network_csv(before, tree_to_network(tree))
    begin = time.perf_counter()
    done = polish(tissue, tree, PolishOptions())
    found = {"polish_s": time.perf_counter() - begin, "rejected": done.rejected}
    write_network_csv(after, tree_to_network(done.tree))
    return found | {"flow_ul_s": options.flow_ul_s(tissue.volume_mm3)}


def main() -> None:
    """Read what is asked, do it, print it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--stl", type=Path, required=True)
    parser.add_argument("--terminals", type=int, required=True)
    parser.add_argument("--root", type=float, nargs=6, help="point and direction")
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--after", type=Path, required=True)
    asked = parser.parse_args()
    options = GrowthOptions(terminals=asked.terminals)
    if asked.root:
        x, y, z, dx, dy, dz = asked.root
        options = replace(options, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
    warm_up()
    try:
        found = timed(asked.stl, options, asked.before, asked.after)
    except DesignError as error:
        found = {"error": str(error)}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
