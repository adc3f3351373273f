"""Rows of a benchmark, description of the machine, child processes timed."""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("PRINTCTL_SHARED_DATA", ROOT.parent / "shared" / "data"))
"""Meshes and networks of other projects, which aren't in this repository."""

Row = dict[str, Any]


class SkippedError(Exception):
    """A part can't be measured here; the message says what it needs."""


class ChildError(Exception):
    """A child process failed, or reported an error in its last line."""


def needed(path: Path, what: str = "") -> Path:
    """Return a file that not every machine has, or skip the part."""
    if not path.exists():
        raise SkippedError(f"needs {what or path.name} ({path})")
    return path


def row(
    measure: str,
    value: float,
    unit: str = "",
    goal: str = "",
    met: bool | None = None,
    peer: Mapping[str, Any] | None = None,
) -> Row:
    """Return one measured promise; ``met`` is None where nothing was promised."""
    found: Row = {"measure": measure, "value": value, "unit": unit}
    if goal:
        found |= {"goal": goal, "met": None if met is None else bool(met)}
    return found | ({"peer": dict(peer)} if peer else {})


def limited(measure: str, value: float, unit: str, most: float | None) -> Row:
    """Return a row whose value may be ``most`` at most; None promises nothing."""
    if most is None:
        return row(measure, value, unit)
    return row(measure, value, unit, f"<= {most:g}", value <= most)


def at_least(measure: str, value: float, unit: str, least: float) -> Row:
    """Return a row whose value must be ``least`` or more."""
    return row(measure, value, unit, f">= {least:g}", value >= least)


def all_of(measure: str, value: int, count: int) -> Row:
    """Return a row of cases, all of which must hold."""
    return row(measure, value, f"of {count}", "all", value == count)


@contextmanager
def scratch() -> Iterator[Path]:
    """Make a temporary folder, in which records of prints go, too."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.environ["PRINTCTL_DATA"] = folder
        yield Path(folder)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return a table's rows by column name."""
    with path.open() as table:
        return list(csv.DictReader(table))


def machine() -> dict[str, Any]:
    """Return processor, cores, memory, system and Python."""
    model, memory = platform.processor(), None
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((x.split(":")[1].strip() for x in lines if x.startswith("model name")), model)
        total = Path("/proc/meminfo").read_text().splitlines()[0]
        memory = round(int(total.split()[1]) / 1e6, 1)
    system, python = platform.platform(), platform.python_version()
    return {"processor": model, "cores": os.cpu_count(), "memory_gb": memory,
            "system": system, "python": python}  # fmt: skip


def commit() -> str:
    """Return the commit that was measured, marked when the tree has changes of its own."""

    def git(*args: str) -> str:
        done = subprocess.run(["git", *args], cwd=ROOT, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    return git("rev-parse", "--short", "HEAD") + ("+changes" if git("status", "--short") else "")


def peak_mb(process: int | None = None) -> float:
    """Return a process's greatest memory so far (this one's, or by its number), MB; Linux.

    Not ``ru_maxrss``: a child begins with its parent's there.
    """
    try:
        lines = Path(f"/proc/{process or 'self'}/status").read_text().splitlines()
    except OSError:  # it has ended meanwhile
        return 0.0
    high_water = [line for line in lines if line.startswith("VmHWM:")]
    return float(high_water[0].split()[1]) * 1024 / 1e6 if high_water else 0.0


def printctl(*words: object) -> list[str]:
    """Return the command line of `printctl` with these words."""
    return [sys.executable, "-m", "printctl", *map(str, words)]


def timed(command: Sequence[str], allowed: tuple[int, ...] = (0,)) -> tuple[float, float, str]:
    """Run a command; return its CPU time, s, greatest memory, MB, and its output.

    Raises
    ------
    ChildError
        Where it doesn't end with a status in ``allowed``.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(command, cwd=ROOT, stdout=out, stderr=err)
        ended, memory = 0, 0.0
        while not ended:
            memory = max(memory, peak_mb(process.pid))
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            time.sleep(0 if ended else 0.02)
        process.returncode = os.waitstatus_to_exitcode(status)
        for stream in (out, err):
            stream.seek(0)
        if process.returncode not in allowed:
            said = err.read().decode(errors="replace").strip().splitlines()[-3:]
            raise ChildError(f"{' '.join(command)} ended with {process.returncode}: {said}")
        return usage.ru_utime + usage.ru_stime, memory, out.read().decode()


def run_module(module: str, *words: object) -> Row:
    """Run a module in a process of its own; return the JSON object that it prints last."""
    _, _, out = timed([sys.executable, "-m", module, *map(str, words)])
    found: Row = json.loads(out.strip().splitlines()[-1])
    if "error" in found:
        raise ChildError(f"{module}: {found['error']}")
    return found
