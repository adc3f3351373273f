"""Description of the benchmark machine, and the JSON form of all benchmarks."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def machine() -> dict[str, Any]:
    """Processor, cores, memory, system and Python."""
    model, memory = platform.processor(), None
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((x.split(":")[1].strip() for x in lines if x.startswith("model name")), model)
        total = Path("/proc/meminfo").read_text().splitlines()[0]
        memory = round(int(total.split()[1]) / 1e6, 1)
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "memory_gb": memory,
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def peak_mb(process: int | None = None) -> float:
    """Most memory that a process has held since it began (this one, or by its number), MB; Linux.

    Not ``ru_maxrss``: a child begins with its parent's there.
    """
    status = Path(f"/proc/{process or 'self'}/status")
    try:
        lines = status.read_text().splitlines()
    except OSError:  # it has ended meanwhile
        return 0.0
    held = [line for line in lines if line.startswith("VmHWM:")]
    return float(held[0].split()[1]) * 1024 / 1e6 if held else 0.0


def commit() -> str:
    """The commit that was measured, marked when the tree has changes of its own."""

    def git(*args: str) -> str:
        done = subprocess.run(["git", *args], cwd=ROOT, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    return git("rev-parse", "--short", "HEAD") + ("+changes" if git("status", "--short") else "")


def row(
    measure: str,
    value: float,
    unit: str,
    goal: str = "",
    met: bool | None = None,
    peer: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """One measured promise; ``met`` is None where nothing was promised."""
    found: dict[str, Any] = {"measure": measure, "value": value, "unit": unit}
    if goal:
        found |= {"goal": goal, "met": met}
    return found | ({"peer": peer} if peer else {})


def print_rows(rows: list[dict[str, Any]]) -> None:
    """Print the benchmark's one JSON object."""
    print(json.dumps({"machine": machine(), "commit": commit(), "rows": rows}, indent=1))
