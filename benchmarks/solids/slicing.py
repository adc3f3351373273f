"""Slicing beside PrusaSlicer: open lumens, time, memory.

Both slice the same STL files in processes of their own; a reader and checkers of the benchmark's
measure what G-code they wrote.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold, OpType
from numpy.typing import NDArray

from benchmarks.checkers.lumens import openings
from benchmarks.checkers.meshes import write_stl
from benchmarks.checkers.read_gcode import Lines, Moves, own_lines, read_moves, rounded_to_steps
from benchmarks.checkers.read_gcode import written_lines as window_lines
from benchmarks.common import ROOT, Row, limited, printctl, row, scratch, timed

FloatArray = NDArray[np.float64]

LAYER_MM, LINE_MM, STEPS_PER_MM = 0.06, 0.15, 80.0
WIDE_MM = 0.3
"""Lumens at least so wide are held to the first goal."""
SYRINGE_MM, FILAMENT_MM, BED_MM, PRUSA_BED_MM = 4.61, 1.75, 100.0, 30.0
PRUSA_INI = ROOT / "benchmarks" / "solids" / "prusa.ini"
SIDES = 24
"""Of every circle, as in the figures that issue 5 quotes of other slicers: a lumen of 0.42 mm is a
polygon with room for a circle of 0.416."""
WALLS = {name: ["--perimeter-generator", name] for name in ("arachne", "classic")}


@dataclass(frozen=True)
class Written:
    """A slicer's moves, what a mm of E is, the part's origin in its frame (3,), CPU s, MB."""

    moves: Moves
    ul_per_e: float
    place: FloatArray
    cpu_s: float
    memory_mb: float

    def lines(self, *, steps: bool, own: bool = False) -> Lines:
        """Return lines as written or between whole motor steps, with their ``own`` doses or not."""
        moves = rounded_to_steps(self.moves, STEPS_PER_MM) if steps else self.moves
        made = own_lines if own else window_lines
        return made(moves, self.ul_per_e, LAYER_MM, planned=self.moves)


def slice_ours(model: Path, middle: FloatArray) -> Written:
    """Run `printctl slice` on a part with this middle in x and y, and lowest z, mm."""
    out = model.with_suffix(".ours.gcode")
    cpu, memory, _ = timed(printctl("slice", model, "--unit", "mm", "--out", out))
    place = np.append(np.round(BED_MM - middle[:2], 3), -middle[2])
    return Written(read_moves(out.read_text()), np.pi * SYRINGE_MM**2 / 4, place, cpu, memory)


def slice_peers(
    model: Path, middle: FloatArray, settings: dict[str, list[str]]
) -> dict[str, Written]:
    """Run PrusaSlicer with each of the settings; nothing where it isn't installed."""
    program = shutil.which("prusa-slicer") or shutil.which("PrusaSlicer")
    found = {}
    for name, options in settings.items() if program else ():
        out = model.with_suffix(f".{name}.gcode")
        command = [str(program), "--load", str(PRUSA_INI), *options]
        command += ["--center", "30,30", "--export-gcode", "-o", str(out), str(model)]
        cpu, memory, _ = timed(command)
        place = np.append(PRUSA_BED_MM - middle[:2], -middle[2])
        moves, per_e = read_moves(out.read_text()), np.pi * FILAMENT_MM**2 / 4
        found[name] = Written(moves, per_e, place, cpu, memory)
    return found


@dataclass(frozen=True)
class Part:
    """A block of ``size`` (3,) with upright round lumens: ``centre`` (n, 2), ``diameter``, mm."""

    name: str
    size: tuple[float, float, float]
    centre: FloatArray
    diameter: FloatArray

    @property
    def inscribed(self) -> FloatArray:
        """Widest circle in each lumen, (n,), mm: what the part itself leaves open."""
        return np.asarray(self.diameter * np.cos(np.pi / SIDES))

    def write_stl(self, path: Path) -> Path:
        """Write the part as a binary STL, mm."""
        discs = [
            CrossSection.circle(wide / 2, SIDES).translate(at)
            for at, wide in zip(self.centre.tolist(), self.diameter.tolist(), strict=True)
        ]
        section = CrossSection.square(self.size[:2]) - CrossSection.batch_boolean(discs, OpType.Add)
        mesh = Manifold.extrude(section, self.size[2]).to_mesh()
        write_stl(path, np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)])
        return path


def block(name: str, columns: int, rows: int, most: float, *size: float) -> Part:
    """Return a block with lumens of 0.42 to ``most`` mm in a grid."""
    x = (np.arange(columns) + 0.5) * size[0] / columns
    y = (np.arange(rows) + 0.5) * size[1] / rows
    centre = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return Part(name, (size[0], size[1], size[2]), centre, np.linspace(0.42, most, len(centre)))


def rows(quick: bool) -> Iterator[Row]:
    """Yield the lumens' errors and the CPU time, beside PrusaSlicer's."""
    part = block("block", 9, 7, 1.2, 20.0, 20.0, 10.0)
    if quick:
        part = block("small block", 3, 2, 0.8, 6.0, 6.0, 1.2)
    middle = np.array([part.size[0] / 2, part.size[1] / 2, 0.0])
    with scratch() as folder:
        model = part.write_stl(folder / "block.stl")
        made, peers = slice_ours(model, middle), slice_peers(model, middle, WALLS)
    name = part.name
    for steps, goal in ((False, 2.0), (True, 8.0)):
        error = _errors_um(part, made, steps)
        median, worst = float(np.median(error)), float(error[np.abs(error).argmax()])
        how = f"after {STEPS_PER_MM:g} steps/mm" if steps else "ideal lines"
        peer = {key: float(np.median(_errors_um(part, one, steps))) for key, one in peers.items()}
        measure = f"{name}: lumens' median diameter error, {how}"
        yield row(measure, median, "um", f"within {goal:g}", abs(median) <= goal, peer)
        if not steps:
            measure = f"{name}: the worst lumen's error, {how}"
            yield row(measure, worst, "um", "within 10", abs(worst) <= 10)
    least = min((one.cpu_s for one in peers.values()), default=float("nan"))
    most, met = "<= 1.0 x PrusaSlicer's least", made.cpu_s <= least if peers else None
    peer = {key: one.cpu_s for key, one in peers.items()}
    yield row(f"{name}: CPU of the whole process", made.cpu_s, "s", most, met, peer) | {
        "memory_mb": round(made.memory_mb),
        "peer_memory_mb": {key: round(one.memory_mb) for key, one in peers.items()},
    }


def _errors_um(part: Part, made: Written, steps: bool) -> FloatArray:
    """Return open diameter less the part's of each wide lumen, median over the layers."""
    reach = float(part.diameter.max()) / 2 + 2 * LINE_MM
    found = openings(made.lines(steps=steps), part.centre + made.place[:2], reach)
    error: FloatArray = np.median(found, axis=0) - part.inscribed
    return 1e3 * error[part.diameter >= WIDE_MM]


RECIPE = """schema: 1
name: large
seed: 1
tissue: {{shape: block, size_mm: [{0}, {0}, {0}]}}
vasculature: {{grow: tree, terminals: {1}, printable: true, smallest_diameter_mm: 0.3}}
toolpath: {{method: fresh}}
"""


def large_rows(quick: bool) -> Iterator[Row]:
    """Yield time and memory of slicing 999 vessels in 40 cm³ at 60 µm layers; quick has 49."""
    with scratch() as folder:
        recipe, made, out = folder / "large.yaml", folder / "design", folder / "large.gcode"
        recipe.write_text(RECIPE.format(*((12, 25) if quick else (34.2, 500))))
        timed(printctl("design", recipe, "--out", made))
        vessels = len({line.split(",")[0] for line in (made / "network.csv").open()}) - 1
        given = ["--unit", "mm", "--syringe", "hamilton_2_5ml", "--out", out]
        cpu, memory, _ = timed(printctl("slice", made / "solid.stl", *given))
        measure = f"{vessels} vessels, layers of 60 um"
        lines = {"lines_of_gcode": sum(1 for _ in out.open("rb"))}
        yield limited(f"{measure}: CPU", cpu, "s", None if quick else 60.0) | lines
        yield limited(f"{measure}: memory", memory / 1e3, "GB", 2.0)
