"""Ten planted faults: how each gets into a print or its scan, and what counts as its cause."""

from __future__ import annotations

import copy
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import yaml
from numpy.typing import NDArray

from tests.system.first_part import program
from tests.system.first_part.edit import between, rewritten
from tests.system.first_part.parts import Part, draw
from tests.system.first_part.truth import Vessel

Recipe = dict[str, Any]

MAX_TRIES = 8
OF_LAYERS = ("leak", "shifted_layer")
"""Faults that are planted by editing layers."""


class UnplannedError(Exception):
    """The sound part can't be printed: nothing can be planted in it."""


@dataclass(frozen=True)
class Fault:
    """A planted fault, and the words that name its cause in what the user reads."""

    name: str
    plant: Callable[[Part, Path], program.Outcome]
    cause: str
    """Regular expression; any match in the message or the verdict names the cause."""

    def named(self, outcome: program.Outcome) -> bool:
        """Return whether the user is told the true cause."""
        return re.search(self.cause, outcome.words(), re.IGNORECASE) is not None


def _with(part: Part, folder: Path, **changes: dict[str, Any]) -> program.Outcome:
    """Run the recipe with some keys changed."""
    path = part.write(folder)
    recipe = copy.deepcopy(part.recipe)
    for section, keys in changes.items():
        recipe[section] = {**recipe[section], **keys}
    path.write_text(yaml.safe_dump(recipe, sort_keys=False))
    return program.run(path)


def _shrinkage(part: Part, folder: Path) -> program.Outcome:
    return _with(part, folder, scan={"shrink_percent": 4.0})


def _wrong_ink(part: Part, folder: Path) -> program.Outcome:
    """Write a structural ink as vessels, or a sacrificial one as the part."""
    ink = "gelatin_sacrificial" if part.style.method == "fresh" else "collagen_fresh"
    bath = {} if part.style.method == "fresh" else {"bath": "gelatin_support"}
    return _with(part, folder, printer={"ink": ink, **bath})


def _coarse_scan(part: Part, folder: Path) -> program.Outcome:
    """Scan with less than three voxels across the thinnest lumen."""
    voxel = round(500 * part.style.lumen_mm[0])
    oct_like = part.recipe["scan"]["simulated"] == "oct"
    size = [voxel, voxel, round(0.6 * voxel) if oct_like else voxel]
    return _with(part, folder, scan={"voxel_um": size})


def _clog(part: Part, folder: Path) -> program.Outcome:
    """Let a clog stop the ink for good near the middle of the print."""
    _, middle = _design(part, folder)
    faults = {"seed": 7, "ink": [{"fault": "clog", "line": middle, "passes": 0.0}]}
    (folder / "faults.yaml").write_text(yaml.safe_dump(faults))
    return _with(part, folder, printer={"faults": "faults.yaml"})


def _design(part: Part, folder: Path) -> tuple[Path, int]:
    """Plan the part without printing it; return its run folder and the job's middle command."""
    outcome = program.run(part.write(folder), "--until", "lumens")
    if outcome.code:
        raise UnplannedError(outcome.text)
    lines = (outcome.folder / "part.gcode").read_text().splitlines()
    commands = sum(1 for one in lines if one and not one.startswith(";"))
    return outcome.folder, commands // 2


def _edited(part: Part, folder: Path, edit: Callable[[str, Path], str]) -> program.Outcome:
    """Print an edited job of this design, scan it, and hold the scan against the design."""
    run, _ = _design(part, folder)
    job = folder / "edited.gcode"
    job.write_text(edit((run / "part.gcode").read_text(), run))
    return _printed(part, folder, job, run)


def _printed(
    part: Part, folder: Path, job: Path, run: Path, syringe: str | None = None
) -> program.Outcome:
    printer, scan = part.recipe["printer"], part.recipe["scan"]
    if part.style.method == "embedded":  # what says that it isn't layers
        shutil.copy(run / "part.map.npz", job.with_suffix(".map.npz"))
    done = program.call(
        "print", job, "--printer", printer["profile"], "--port", "simulated",
        "--syringe", printer["syringe"], "--ink", printer["ink"], "--bath", printer["bath"],
        "--needle", part.recipe["toolpath"]["needle"], "--folder", folder / "job", "--json",
        cwd=folder, folder=folder / "report",
    )  # fmt: skip
    if done.code:
        return done
    more = ["--syringe", syringe] if syringe else []
    scanned = program.call(
        "scan", folder / "job", "--out", folder / "scan.tif", "--device", scan["simulated"],
        *more, cwd=folder, folder=folder / "report",
    )  # fmt: skip
    if scanned.code:
        return scanned
    return register(folder / "scan.tif", run, folder)


def register(scan: Path, run: Path, folder: Path) -> program.Outcome:
    """Hold a scan against a run's design."""
    return program.call(
        "register", scan, "--model", run, "--out", folder / "report", cwd=folder,
        folder=folder / "report",
    )  # fmt: skip


def _wrong_syringe(part: Part, folder: Path) -> program.Outcome:
    """Mount a syringe of 2.5 mL where the job was planned for 1 mL: 2.5 times the ink."""
    run, _ = _design(part, folder)
    shutil.copy(run / "part.gcode", folder / "part.gcode")
    return _printed(part, folder, folder / "part.gcode", run, syringe="hamilton_2_5ml")


def _vessel(part: Part, run: Path) -> tuple[Vessel, NDArray[np.float64]]:
    """Return the longest vessel, and where the part's origin stands in the printer's frame."""
    vessels, _ = program.designed(run)
    place = program.place_mm(run, part.recipe)
    return max(vessels, key=lambda one: float(one.along[-1])), place


def _leak(part: Part, folder: Path) -> program.Outcome:
    """Leave a way of 0.7 mm free from the middle of a vessel to beyond the part's surface.

    Ink evens out along a line: gaps of 0.4 mm close in part.
    """

    def edit(text: str, run: Path) -> str:
        vessel, place = _vessel(part, run)
        _, tissue = program.designed(run)
        middle, axis, _ = vessel.at(float(vessel.along[-1]) / 2)
        aside = np.cross(axis, [0, 0, 1])
        aside /= np.linalg.norm(aside)
        far = middle + 2 * float(tissue.extents.max()) * aside
        return rewritten(text, between(middle + place, far + place, 0.35), 0.0)

    return _edited(part, folder, edit)


def _narrow(part: Part, folder: Path) -> program.Outcome:
    """Write twice the ink around a vessel's middle third; embedded, a network half as wide."""
    if part.style.method == "embedded":
        run, _ = _design(part, folder)
        rows = (run / "network.csv").read_text().splitlines()
        columns = rows[0].split(",")
        thin = [rows[0]]
        for row in rows[1:]:
            words = dict(zip(columns, row.split(","), strict=True))
            words |= {key: str(0.7 * float(words[key])) for key in ("radius0_mm", "radius1_mm")}
            thin.append(",".join(words.values()))
        recipe = copy.deepcopy(part.recipe)
        recipe["vasculature"] = {"network": "thin.csv"}
        recipe["name"] = "thin"
        (folder / "thin.csv").write_text("\n".join(thin) + "\n")
        (folder / "thin.yaml").write_text(yaml.safe_dump(recipe, sort_keys=False))
        made = program.run(folder / "thin.yaml")
        if not (made.folder / "scan.tif").is_file():
            raise UnplannedError(made.text)
        return register(made.folder / "scan.tif", run, folder)

    def edit(text: str, run: Path) -> str:
        vessel, place = _vessel(part, run)
        length = float(vessel.along[-1])
        (low, _, radius), (high, _, _) = vessel.at(length / 3), vessel.at(2 * length / 3)
        return rewritten(text, between(low + place, high + place, radius + 0.2), 2.0)

    return _edited(part, folder, edit)


def _shifted(part: Part, folder: Path) -> program.Outcome:
    """Lose motor steps halfway: all later moves stand 0.4 mm aside along x."""

    def edit(text: str, _: Path) -> str:
        lines = text.splitlines()
        begin = len(lines) // 2
        for n in range(begin, len(lines)):
            lines[n] = re.sub(
                r"^(G[01]\b.*? X)([-\d.]+)", lambda m: f"{m[1]}{float(m[2]) + 0.4:.3f}", lines[n]
            )
        return "\n".join(lines) + "\n"

    return _edited(part, folder, edit)


def _swapped(part: Part, folder: Path) -> program.Outcome:
    """Judge another part's scan against this design."""
    run, _ = _design(part, folder)
    for attempt in range(MAX_TRIES):
        other = draw(part.recipe["seed"] + 7, attempt, small=True)
        if other.style.method != part.style.method:
            continue
        made = program.run(other.write(folder / f"other{attempt}"))
        if (made.folder / "scan.tif").is_file():
            return register(made.folder / "scan.tif", run, folder)
    raise RuntimeError("no other part was printed")


def _wrong_voxel(part: Part, folder: Path) -> program.Outcome:
    """Write voxels 1.25 times as large as they are into the scan's file."""
    made = program.run(part.write(folder))
    scan = made.folder / "scan.tif"
    if not scan.is_file():
        raise UnplannedError(made.text)
    with tifffile.TiffFile(scan) as file:
        volume, facts = file.asarray(), json.loads(file.pages[0].description)
    facts["voxel_mm"] = [1.25 * one for one in facts["voxel_mm"]]
    wrong = folder / "wrong.tif"
    tifffile.imwrite(
        wrong, volume, description=json.dumps(facts), metadata=None, photometric="minisblack"
    )
    return register(wrong, made.folder, folder)


FAULTS = (
    Fault(
        "shrinkage",
        _shrinkage,
        r"shr[iu]nk|smaller than (?:the design|designed)|scale.{0,40}0\.9[5-7]",
    ),
    Fault("wrong_ink", _wrong_ink, r"(?<!gelatin_)sacrificial|structural|\brole\b|solid cords?"),
    Fault(
        "wrong_syringe",
        _wrong_syringe,
        r"syringe|flow factor|extru|(?:too much|more|excess|times the) ink"
        r"|(?:all|every|most)[^\n]{0,40}(?:lumens?|vessels?)[^\n]{0,60}(?:narrow|wide|closed)",
    ),
    Fault(
        "clog", _clog, r"clog|missing|no ink|not written|not printed|(?<!nor )closed|ink stopped"
    ),
    Fault("leak", _leak, r"(?<!no )\bleak|leads? out"),
    Fault("narrow", _narrow, r"narrow(?:er|ed|ing)|stenosis|diameter (?:measured )?−[1-9]\d"),
    Fault(
        "shifted_layer",
        _shifted,
        r"layers?[^\n]{0,80}(?:shift|aside|displaced)|shifted|lost steps?|steps? (?:were )?lost"
        r"|(?:lies?|lie|axis)[^\n]{0,30}aside|off (?:its|their|the)(?: designed)? axis",
    ),
    Fault(
        "swapped_part",
        _swapped,
        r"doesn't match|another part|not that part|different part|wrong (?:part|design)",
    ),
    Fault(
        "wrong_voxel",
        _wrong_voxel,
        r"voxel size|wrong voxels?|scale[^\n]{0,60}(?:voxel|0\.[78]\d|1\.[23]\d)",
    ),
    Fault(
        "coarse_scan",
        _coarse_scan,
        r"voxels? of at most|too coarse|(?:finer|smaller) voxels"
        r"|voxels?[^\n]{0,40}too (?:large|big)",
    ),
)


def drawn_for(fault: Fault, seed: int, index: int) -> Part:
    """Return a small part into which this fault can be planted."""
    for offset in range(50):
        part = draw(seed, index + 1000 * offset, small=True)
        if fault.name not in OF_LAYERS or part.style.method == "fresh":
            return part
    raise RuntimeError(f"no part for {fault.name}")
