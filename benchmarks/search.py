"""Design searches by the command line: rate, overhead, reproducibility: ``make bench-search``.

The shipped search is run in one process and on two workers, each as a user would. When results
came is read from their files' times; fronts are held against a sort of this file's own.
``--quick`` takes eight candidates.
"""

from __future__ import annotations

import csv
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from benchmarks.command import Job, Row, run
from benchmarks.machine import ROOT, row
from design.vasculature import grow_tree
from printctl.pipeline.growing import growth_options
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe.growth import GrownNetwork
from printctl.search import load_search
from printctl.search.candidates import Candidate, draw_candidates

SHIPPED = ROOT / "examples" / "searches" / "planar.yaml"
QUICK = 8


def search_rows(quick: bool) -> Iterator[Row]:
    """Rates and overheads of one search."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        path = _search_file(folder, quick)
        candidates = draw_candidates(load_search(path), folder).candidates
        count = len(candidates)
        growth = statistics.mean(_grown(candidates))
        yield row(f"growth alone, mean of {count} candidates", growth, "CPU s")
        apart, cpu = {}, {}
        for workers in (0, 2):
            who = f"{workers} workers" if workers else "in process"
            begun = time.time()
            whole, cpu[workers] = _searched(path, folder / str(workers), workers)
            came = sorted(file.stat().st_mtime for file in _results(folder / str(workers)))
            apart[workers] = (came[-1] - came[0]) / (count - 1)
            yield row(f"{who}: candidates per second once begun", 1.0 / apart[workers], "1/s")
            yield row(f"{who}: to the first result", came[0] - begun, "s")
            yield row(f"{who}: the whole command", whole, "s", "<= 30", whole <= 30.0)
            yield row(f"{who}: the whole command", cpu[workers], "CPU s")
        yield row("2 workers over one process, once begun", apart[0] / apart[2], "times")
        again, idle = _searched(path, folder / "0", 0)
        yield row("the command again, all known", again, "s")
        over = (cpu[0] - idle) / count - growth
        yield row("measures, flow and files, per candidate", over, "CPU s")
        yield row("Dask and its two processes, in all", cpu[2] - cpu[0], "CPU s")
        yield from _checked(folder)


def _search_file(folder: Path, quick: bool) -> Path:
    """The shipped search, its recipe told by its whole path."""
    data = yaml.safe_load(SHIPPED.read_text(encoding="utf-8"))
    data["recipe"] = str((SHIPPED.parent / data["recipe"]).resolve())
    if quick:
        data["count"] = QUICK
    path = folder / "search.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def _grown(candidates: Sequence[Candidate]) -> Iterator[float]:
    """CPU seconds that each candidate's growth takes by itself, kernels loaded."""
    tissue = make_tissue(candidates[0].recipe.tissue, Path())
    for number, one in enumerate([candidates[0], *candidates]):
        part = one.recipe.vasculature
        assert isinstance(part, GrownNetwork)
        options = growth_options(part, one.recipe.seed)
        begun = time.process_time()
        grow_tree(tissue, options)
        if number:
            yield time.process_time() - begun


def _searched(path: Path, out: Path, workers: int) -> tuple[float, float]:
    """Seconds and CPU seconds that the command takes, its workers' among them."""
    command = [sys.executable, "-m", "printctl", "search", str(path), "--out", str(out)]
    before, begun = os.times(), time.perf_counter()
    subprocess.run([*command, "--workers", str(workers)], cwd=ROOT, check=True, capture_output=True)
    whole, after = time.perf_counter() - begun, os.times()
    used = after.children_user + after.children_system
    return whole, used - before.children_user - before.children_system


def _results(out: Path) -> list[Path]:
    return [file for file in (out / "candidates").iterdir() if not file.name.startswith(".")]


def _checked(folder: Path) -> Iterator[Row]:
    """Whether both ways leave the same, and fronts are what they are called."""
    names = ("ranked.csv", "pareto.png", "search.html", "best.yaml")
    other = sum(
        (folder / "0" / name).read_bytes() != (folder / "2" / name).read_bytes() for name in names
    )
    yield row("files that differ between 0 and 2 workers", other, "", "0", other == 0)
    with (folder / "0" / "ranked.csv").open(encoding="utf-8", newline="") as handle:
        table = [found for found in csv.DictReader(handle) if found["state"] == "good"]
    points = [(float(one["distance_p95_mm"]), float(one["volume_mm3"])) for one in table]
    wrong = sum(
        (one["front"] == "1") != (not any(_beats(other, point) for other in points))
        for one, point in zip(table, points, strict=True)
    )
    yield row(f"wrong among the fronts of {len(table)}", wrong, "", "0", wrong == 0)


def _beats(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[0] and one[1] <= other[1] and one != other


JOBS: dict[str, Job] = {"search": search_rows}


if __name__ == "__main__":
    run(JOBS, __doc__)
