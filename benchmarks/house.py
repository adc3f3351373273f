"""Start-up time of commands, time from clone to first print, code size: ``-m benchmarks.house``.

``--only demo`` clones this commit and 63e9170 and runs ``make demo`` in both, one after the other,
each with an empty home: minutes, and worth something on a quiet machine only.
"""

from __future__ import annotations

import ast
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import trimesh

from benchmarks.command import Row, run
from benchmarks.machine import ROOT, row

ROOMS = ("printctl", "design", "sim", "registration", "kernels", "firmware_profiles")
BEFORE = "63e9170"
QUESTIONS = ("What", "Which", "Where", "How", "When", "Whether", "Who", "Why")
TEN_LINES = "M85 S600\nM302 P1\nG90\nM82\n" + "".join(
    f"G1 X{x} Y5 E{x / 10} F600\n" for x in range(1, 7)
)
STARTS = {
    "printctl --help": (("--help",), 0.6),
    "printctl profiles": (("profiles",), 0.6),
    "printctl history": (("history",), 0.6),
    "printctl doctor": (("doctor",), 0.0),
    "printctl simulate, ten lines": (("simulate", "ten.gcode"), 1.0),
    "printctl slice, a block of 4 x 4 x 1 mm": (
        ("slice", "block.stl", "--unit", "mm", "--out", "block.gcode"),
        1.0,
    ),
}


def starts(quick: bool) -> Iterator[Row]:
    """CPU seconds of commands that do little, and of importing the link."""
    tries = 3 if quick else 9
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "ten.gcode").write_text(TEN_LINES)
        trimesh.creation.box((4, 4, 1)).export(Path(folder) / "block.stl")
        for name, (words, bar) in STARTS.items():
            spent = _median([sys.executable, "-m", "printctl", *words], folder, tries)
            yield _below(name, spent, "CPU s", bar)
        spent = _median([sys.executable, "-c", "import printctl.machine.link"], folder, tries)
        yield _below("import printctl.machine.link", spent, "CPU s", 0.4)


def sizes(quick: bool) -> Iterator[Row]:
    """Lines, longest file and function, modules that begin with a question."""
    texts = {
        path: path.read_text() for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))
    }
    lines = {path: text.count("\n") for path, text in texts.items()}
    yield _below("lines of the product", sum(lines.values()), "lines", 162_000)
    yield _below("modules", len(texts), "files", 0)
    yield _below("files over 400 lines", sum(n > 400 for n in lines.values()), "files", 1)
    longest = {path: _longest_function(text) for path, text in texts.items()}
    yield _below("functions over 80 lines", sum(n > 80 for n in longest.values()), "files", 1)
    first = [(ast.get_docstring(ast.parse(text)) or " ").split() for text in texts.values()]
    asking = sum(bool(words) and words[0] in QUESTIONS for words in first)
    yield _below("modules that begin with a question word", asking, "files", 20)


def demo(quick: bool) -> Iterator[Row]:
    """From a clone to the end of ``make demo``, now and before."""
    wall = {name: _demo(name) for name in ("HEAD", BEFORE)}
    yield _below("clone to the end of make demo", wall["HEAD"], "s", 120)
    yield _below(f"the same against {BEFORE}", wall["HEAD"] / wall[BEFORE], "", 0.3)


def _below(measure: str, value: float, unit: str, bar: float) -> Row:
    goal = f"< {bar:g} {unit}" if bar else ""
    return row(measure, round(value, 2), unit, goal, value < bar)


def _median(command: list[str], folder: str, tries: int) -> float:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    spent = []
    for _ in range(tries + 1):  # the first one reads the disk
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return statistics.median(spent[1:])


def _longest_function(text: str) -> int:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
    return max(((node.end_lineno or 0) - node.lineno + 1 for node in found), default=0)


def _demo(commit: str) -> float:
    folder = Path(tempfile.mkdtemp(prefix="demo"))
    try:
        began = time.perf_counter()
        _git("clone", "--quiet", str(ROOT), str(folder / "clone"), where=folder)
        full = _git("rev-parse", commit, where=ROOT)
        _git("checkout", "--quiet", full, where=folder / "clone")
        clean = {
            k: v for k, v in os.environ.items() if not k.startswith(("PRINTCTL", "PYTHONPATH"))
        }
        home = clean | {"HOME": str(folder)}
        subprocess.run(
            ["make", "demo"], cwd=folder / "clone", env=home, check=True, stdout=subprocess.DEVNULL
        )
        return time.perf_counter() - began
    finally:
        shutil.rmtree(folder)


def _git(*words: str, where: Path) -> str:
    done = subprocess.run(["git", *words], cwd=where, capture_output=True, text=True, check=True)
    return done.stdout.strip()


if __name__ == "__main__":
    run({"starts": starts, "sizes": sizes, "demo": demo}, __doc__)
