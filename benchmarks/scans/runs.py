"""Generate scans, register them by the command line, judge them; reuse earlier results."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.common import ROOT
from benchmarks.scans.cases import TOLERANCE_PERCENT, Case
from benchmarks.scans.judge import judge

BESIDE = [p / "shared" / "scans" for p in ROOT.parents]
SHARED = Path(os.environ.get("SHARED_SCANS") or next((p for p in BESIDE if p.exists()), BESIDE[0]))
KEPT = ("registration.json",)


def present(generator: str) -> bool:
    """Whether a generator is there."""
    return generator == "spectral" or (SHARED / "make_scan.py").exists()


def name_of(case: Case) -> str:
    """Return a case's name: generator, design, seed, digest of options and generator."""
    source = SHARED if case.generator == "shared" else Path(__file__).parent
    files = (
        sorted(source.glob("*.py")) if case.generator == "shared" else [source / f for f in PHYSICS]
    )
    digest = hashlib.sha256(json.dumps(case.options).encode())
    for file in files:
        digest.update(meaning(file.read_text()).encode())
    return f"{case.generator}_{case.design}_{case.seed}_{digest.hexdigest()[:10]}"


PHYSICS = (
    "bodies.py",
    "defects.py",
    "designs.py",
    "geometry.py",
    "make.py",
    "options.py",
    "pose.py",
    "scatter.py",
    "spectrometer.py",
    "truth.py",
)


def meaning(source: str) -> str:
    """Return a module's code without comments, layout and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:]
    return ast.dump(tree)


def run(command: list[str], **more: Any) -> subprocess.CompletedProcess[str]:
    """Run a program, its output kept."""
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, **more)


def make(case: Case, keep: Path) -> tuple[Path, Path]:
    """Return a scan's prefix and its design's folder; make the scan unless it is kept already."""
    prefix = keep / name_of(case)
    shared = case.generator == "shared"
    design = keep / "shared_designs" / case.design if shared else Path(f"{prefix}_design")
    if not Path(f"{prefix}_truth.json").exists():
        if shared:
            program = [sys.executable, str(SHARED / "make_scan.py"), str(design)]
        else:
            program = [sys.executable, "-m", "benchmarks.scans.make", case.design]
        done = run([*program, str(prefix), "--seed", str(case.seed), *case.options])
        if done.returncode:
            raise RuntimeError(f"{' '.join(done.args)}: {done.stderr[-600:]}")
    return prefix, design


def shared_designs(keep: Path) -> None:
    """Write the designs of the shared generator unless they are there."""
    if not (keep / "shared_designs" / "symmetric" / "part.stl").exists():
        run(
            [
                sys.executable,
                str(SHARED / "make_scan.py"),
                "--designs",
                str(keep / "shared_designs"),
            ]
        )


def register(prefix: Path, design: Path, out: Path, more: tuple[str, ...]) -> dict[str, Any]:
    """Run `printctl register` on a scan; return exit code, times, peak memory, last words.

    The peak is never below this process' own at the start (Linux hands it on), some 0.3 GB.
    """
    command = [
        sys.executable,
        "-m",
        "printctl",
        "register",
        f"{prefix}.tif",
        "--model",
        str(design / "part.stl"),
        "--network",
        str(design / "network.csv"),
        "--out",
        str(out),
        "--diameter-tolerance-percent",
        str(TOLERANCE_PERCENT),
        "--json",
        *more,
    ]
    began = time.monotonic()
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        assert process.stderr is not None
        words = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return {
        "exit": process.returncode,
        "wall_s": time.monotonic() - began,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": usage.ru_maxrss * 1024 / 1e6,
        "stderr": words[-400:],
    }


def measure(case: Case, family: str, keep: Path, commit: str) -> dict[str, Any]:
    """Return a case's result line: how it was made and ran, the judgement (None: refused)."""
    prefix, design = make(case, keep)
    out = keep / "reports" / commit / prefix.name
    out.mkdir(parents=True, exist_ok=True)
    for old in KEPT:
        (out / old).unlink(missing_ok=True)
    ran = register(prefix, design, out, case.register)
    line = {
        "family": family,
        "name": prefix.name,
        "case": asdict(case),
        "commit": commit,
        "ran": ran,
        "judged": None,
    }
    if (out / "registration.json").exists():
        truth = json.loads(Path(f"{prefix}_truth.json").read_text())
        line["judged"] = judge(out, truth, TOLERANCE_PERCENT)
    for file in out.iterdir():
        if file.name not in KEPT:
            file.unlink()
    return line


def again(line: dict[str, Any], keep: Path) -> dict[str, Any]:
    """Return a result line judged anew (the judge may have changed), its faces as they were."""
    report = keep / "reports" / line["commit"] / line["name"]
    truth = keep / f"{line['name']}_truth.json"
    if not (report / "registration.json").exists() or not truth.exists():
        return line
    judged = judge(report, json.loads(truth.read_text()), TOLERANCE_PERCENT)
    return line | {"judged": judged | {"faces": (line["judged"] or judged)["faces"]}}
