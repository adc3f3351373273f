"""The product as a stranger meets it: its command line, and the files that it leaves."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray

from tests.system.first_part.deposit import Deposit, deposit_of
from tests.system.first_part.truth import Vessel, read_network

ROOT = Path(__file__).resolve().parents[3]
SHIPPED = ROOT / "firmware_profiles" / "data"
TIME_LIMIT_S = 1800
LARGE_FILES = ("*.tif", "*.ply", "*.vtp", "*.npz", "*.nrrd", "predicted_*", "*.html", "*.png")


@dataclass(frozen=True)
class Outcome:
    """What a command said and left."""

    code: int
    text: str
    folder: Path

    @property
    def report(self) -> dict[str, Any]:
        """report.json, or nothing."""
        return _json(self.folder / "report.json")

    @property
    def registration(self) -> dict[str, Any]:
        """registration.json, or nothing."""
        return _json(self.folder / "registration.json")

    @property
    def verdict(self) -> str:
        """pass, fail or undecided by the report; refused where there is none; else error."""
        found = self.report.get("verdict")
        if found:
            return "pass" if found["passed"] else "undecided" if found["undecided"] else "fail"
        said = re.search(r"^(pass|fail|undecided)$", self.text, re.MULTILINE)
        if said:
            return said.group(1)
        if self.registration:  # of `register`, whose exit code alone says whether a print passes
            return "not passed" if self.code else "pass"
        return "refused" if self.code in (1, 2, 3) else "error"

    def words(self) -> str:
        """Everything that the user reads: the terminal, and the verdict's causes and reasons."""
        verdict = self.report.get("verdict") or {}
        more = [*verdict.get("causes", []), *verdict.get("reasons", [])]
        return "\n".join([self.text, *map(str, more)])


def _json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def call(*words: str | Path, cwd: Path, folder: Path) -> Outcome:
    """Run ``printctl`` with these words; the text of both streams is kept beside the folder."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    env.setdefault("PRINTCTL_DATA", str(cwd / "data"))
    done = subprocess.run(
        [sys.executable, "-m", "printctl", *map(str, words)],
        cwd=cwd, env=env, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False,
    )  # fmt: skip
    text = done.stderr + done.stdout
    with (cwd / "log.txt").open("a") as log:
        log.write(f"$ printctl {' '.join(map(str, words))}\n{text}exit {done.returncode}\n")
    return Outcome(done.returncode, text, folder)


def run(recipe: Path, *options: str) -> Outcome:
    """Run a recipe in its own folder."""
    name = str(yaml.safe_load(recipe.read_text())["name"])
    return call(
        "run", recipe.name, *options, cwd=recipe.parent, folder=recipe.parent / "runs" / name
    )


def shipped(kind: str, name: str) -> dict[str, Any]:
    """Return a shipped profile's numbers."""
    found: dict[str, Any] = yaml.safe_load((SHIPPED / kind / f"{name}.yaml").read_text())
    return found


def printed(folder: Path, recipe: dict[str, Any], gcode: Path | None = None) -> Deposit:
    """Return the ink of a run's G-code (or of another file's) in the part's frame."""
    place = place_mm(folder, recipe)
    printer = recipe["printer"]
    syringe = shipped("syringes", printer["syringe"])["inner_mm"]
    steps = shipped("printers", printer["profile"])["steps_per_mm"]
    layer = recipe["toolpath"].get("layer_um", 60) / 1000
    if recipe["toolpath"]["method"] == "embedded":
        layer = None
    return deposit_of(gcode or folder / "part.gcode", -place, syringe, layer, steps)


def place_mm(folder: Path, recipe: dict[str, Any]) -> NDArray[np.float64]:
    """Return where the part's origin stands: as reported, else centred at the bath's clearance."""
    frames = _json(folder / "report.json").get("frames") or {}
    if frames:
        return np.asarray(np.array(frames["part_to_printer"])[:3, 3])
    profile = shipped("printers", recipe["printer"]["profile"])
    low, high = trimesh.load_mesh(folder / "tissue.stl").bounds
    middle = [sum(profile[axis].values()) / 2 for axis in ("x_mm", "y_mm")]
    clearance = shipped("baths", recipe["printer"]["bath"])["floor_clearance_mm"]
    centre = (low + high) / 2
    return np.array([middle[0] - centre[0], middle[1] - centre[1], clearance - low[2]])


def designed(folder: Path) -> tuple[list[Vessel], trimesh.Trimesh]:
    """Return a run's vessels and the part's surface."""
    return read_network(folder / "network.csv"), trimesh.load_mesh(folder / "tissue.stl")


def clean(folder: Path) -> None:
    """Delete what is large."""
    for pattern in LARGE_FILES:
        for path in folder.rglob(pattern):
            path.unlink(missing_ok=True)
    for path in folder.rglob("print"):
        shutil.rmtree(path, ignore_errors=True)
