"""Tables of a network's flow by the command line: CSV files, or arrays of one NPZ."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.command import Row
from benchmarks.flow_networks import binary_tree
from benchmarks.machine import ROOT, row
from printctl.analysis.networks import write_network


def table_rows(quick: bool) -> Iterator[Row]:
    """A pulsatile job, steady flow beside it: CPU time of the whole process, the best of three."""
    terminals = 1000 if quick else 10_000
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        write_network(folder / "tree.npz", binary_tree(terminals))
        pulse = ("--inlet-flow-ml-min", "60", "--amplitude-ml-min", "20", "--period-s", "1")
        asked = ("flow", str(folder / "tree.npz"), *pulse, "--wall-young-kpa", "10")
        spent = {}
        for kind in ("npz", "csv"):
            command = command_line(*asked, "--results", kind, "--out", str(folder / kind))
            cpu_of(command)  # kernels
            spent[kind] = min(cpu_of(command) for _ in range(3))
        sizes = {kind: _megabytes(folder / kind) for kind in spent}
    what = f"pulsatile, {terminals:,} terminals, by the command line, tables as NPZ"
    yield row(what, spent["npz"], "CPU s") | {"csv": spent["csv"], "mb": sizes}


def _megabytes(folder: Path) -> float:
    return sum(file.stat().st_size for file in folder.iterdir()) / 1e6


def command_line(*words: str) -> list[str]:
    """Return `printctl`'s command with these words."""
    return [sys.executable, "-m", "printctl", *words]


def cpu_of(command: list[str]) -> float:
    """Return the CPU time of a whole process, user and system, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    place = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(command, capture_output=True, env=place, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
