"""Tables of a network's flow by the command line: CSV files, or arrays of one NPZ."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.command import Row
from benchmarks.flow_networks import binary_tree
from benchmarks.flow_svzerod import command_line, cpu_of
from benchmarks.machine import row
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
