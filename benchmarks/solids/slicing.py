"""Slicing benchmark rows: open lumens, coverage, travel, time; compared with PrusaSlicer.

Both slice the same STL files in processes of their own; a reader and checkers of the benchmark's
measure what G-code they wrote.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold, OpType
from numpy.typing import NDArray

from benchmarks.checkers.lumens import openings
from benchmarks.checkers.meshes import write_stl
from benchmarks.checkers.read_gcode import Lines, Moves, read_moves, rounded_to_steps, written_lines
from benchmarks.common import ROOT, Row, limited, printctl, row, timed

LAYER_MM, LINE_MM, STEPS_PER_MM = 0.06, 0.15, 80.0
#: Lumens at least so wide are held to the first goal, mm.
WIDE_MM = 0.3
SYRINGE_MM, FILAMENT_MM = 4.61, 1.75
PRUSA_INI = ROOT / "benchmarks" / "solids" / "prusa.ini"
BED_MM = np.array([100.0, 100.0])
PRUSA_BED_MM = np.array([30.0, 30.0])


#: Sides of every circle, as in the figures that issue 5 quotes of other slicers: a lumen of
#: 0.42 mm is a polygon with room for a circle of 0.416.
SIDES = 24


@dataclass(frozen=True)
class Part:
    """A part with upright round lumens from its bottom to its top.

    Attributes
    ----------
    name : str
    centre : (n, 2) float64, mm
    diameter : (n,) float64, mm
    size : (3,) float64, mm
    """

    name: str
    centre: NDArray[np.float64]
    diameter: NDArray[np.float64]
    size: tuple[float, float, float]

    def section(self) -> CrossSection:
        """The section at every height."""
        discs = [self._disc(k) for k in range(len(self.diameter))]
        body = CrossSection.square(self.size[:2])
        return body - CrossSection.batch_boolean(discs, OpType.Add)

    def _disc(self, lumen: int) -> CrossSection:
        disc = CrossSection.circle(self.diameter[lumen] / 2, SIDES)
        return disc.translate(self.centre[lumen].tolist())

    @property
    def inscribed(self) -> NDArray[np.float64]:
        """Widest circle in each lumen, (n,), mm: what the part itself leaves open."""
        return np.asarray(self.diameter * np.cos(np.pi / SIDES))

    def write_stl(self, path: Path) -> None:
        """Write the part as a binary STL, mm."""
        mesh = Manifold.extrude(self.section(), self.size[2]).to_mesh()
        write_stl(path, np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)])


def _grid(columns: int, rows: int, size: tuple[float, float, float]) -> NDArray[np.float64]:
    x = (np.arange(columns) + 0.5) * size[0] / columns
    y = (np.arange(rows) + 0.5) * size[1] / rows
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def block() -> Part:
    """20 x 20 x 10 mm with 63 lumens of 0.42 to 1.2 mm."""
    size = (20.0, 20.0, 10.0)
    return Part("block", _grid(9, 7, size), np.linspace(0.42, 1.2, 63), size)


def small() -> Part:
    """6 x 6 x 1.2 mm with six lumens of 0.42 to 0.8 mm."""
    size = (6.0, 6.0, 1.2)
    return Part("small block", _grid(3, 2, size), np.linspace(0.42, 0.8, 6), size)


@dataclass(frozen=True)
class Sliced:
    """What a slicer made of a part."""

    moves: Moves
    ul_per_e: float
    rounded: bool
    centre: NDArray[np.float64]
    layer_mm: float
    cpu_s: float
    memory_mb: float

    def lines(self, *, steps: bool) -> Lines:
        """The lines it wrote, ideally or as motors of whole steps make them."""
        moves = rounded_to_steps(self.moves, STEPS_PER_MM) if steps else self.moves
        return written_lines(
            moves, self.ul_per_e, self.layer_mm, rounded=self.rounded, planned=self.moves
        )


def rows(quick: bool) -> Iterator[Row]:
    """Yield the lumens' errors and the CPU time, beside PrusaSlicer's."""
    with tempfile.TemporaryDirectory() as scratch:
        part = small() if quick else block()
        made = _ours(part, Path(scratch))
        yield from _wide_rows(part, made, _peers(part, Path(scratch)))


def _wide_rows(part: Part, made: Sliced, peers: dict[str, Sliced]) -> Iterator[Row]:
    name = part.name
    for steps, goal in ((False, 2.0), (True, 8.0)):
        error = _errors_um(part, made, steps=steps)
        median, worst = float(np.median(error)), float(error[np.abs(error).argmax()])
        how = f"after {STEPS_PER_MM:g} steps/mm" if steps else "ideal lines"
        peer = {
            key: float(np.median(_errors_um(part, of, steps=steps))) for key, of in peers.items()
        }
        measure = f"{name}: lumens' median diameter error, {how}"
        yield row(measure, median, "um", f"within {goal:g}", abs(median) <= goal, peer)
        if not steps:
            measure = f"{name}: the worst lumen's error, {how}"
            yield row(measure, worst, "um", "within 10", abs(worst) <= 10)
    least = min((of.cpu_s for of in peers.values()), default=float("nan"))
    peer = {key: round(of.cpu_s, 1) for key, of in peers.items()}
    most, met = "<= 1.0 x PrusaSlicer's least", made.cpu_s <= least if peers else None
    yield row(f"{name}: CPU of the whole process", made.cpu_s, "s", most, met, peer) | {
        "memory_mb": round(made.memory_mb),
        "peer_memory_mb": {key: round(of.memory_mb) for key, of in peers.items()},
    }


def _open(part: Part, made: Sliced, *, steps: bool = False) -> NDArray[np.float64]:
    """Open diameter of every lumen in every layer."""
    reach = float(part.diameter.max()) / 2 + 2 * LINE_MM
    return openings(made.lines(steps=steps), part.centre + made.centre, reach)


def _errors_um(part: Part, made: Sliced, *, steps: bool) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.median(_open(part, made, steps=steps), axis=0) - part.inscribed
    return 1e3 * found[part.diameter >= WIDE_MM]


def _stl(part: Part, folder: Path) -> Path:
    path = folder / f"{part.name.replace(' ', '_')}.stl"
    if not path.exists():
        part.write_stl(path)
    return path


def _middle(part: Part) -> NDArray[np.float64]:
    """Middle of the part's bounds, where slicers put the bed's middle."""
    return np.array(part.size[:2]) / 2


def _ours(part: Part, folder: Path) -> Sliced:
    model, out = _stl(part, folder), folder / "ours.gcode"
    cpu, memory, _ = timed(printctl("slice", model, "--unit", "mm", "--out", out))
    middle = np.round(BED_MM - _middle(part), 3)
    per_e = np.pi * SYRINGE_MM**2 / 4
    return Sliced(read_moves(out.read_text()), per_e, True, middle, LAYER_MM, cpu, memory)


def _peers(part: Part, folder: Path) -> dict[str, Sliced]:
    """PrusaSlicer with its default walls and its classic ones; none where it isn't installed."""
    program = shutil.which("prusa-slicer") or shutil.which("PrusaSlicer")
    if program is None:
        return {}
    found = {}
    for walls in ("arachne", "classic"):
        out = folder / "prusa.gcode"
        command = [program, "--load", str(PRUSA_INI), "--perimeter-generator", walls]
        command += ["--center", "30,30", "--export-gcode", "-o", str(out), str(_stl(part, folder))]
        cpu, memory, _ = timed(command)
        centre = PRUSA_BED_MM - _middle(part)
        moves, per_e = read_moves(out.read_text()), np.pi * FILAMENT_MM**2 / 4
        found[f"PrusaSlicer, {walls}"] = Sliced(moves, per_e, True, centre, LAYER_MM, cpu, memory)
    return found


RECIPE = """schema: 1
name: large
seed: 1
tissue: {{shape: block, size_mm: [{0}, {0}, {0}]}}
vasculature: {{grow: tree, terminals: {1}, printable: true, smallest_diameter_mm: 0.3}}
toolpath: {{method: fresh}}
"""


def large_rows(quick: bool) -> Iterator[Row]:
    """Yield time and memory of slicing 999 vessels in 40 cm³ at 60 µm layers; quick has 49."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
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
