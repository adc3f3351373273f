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
import shapely
from manifold3d import CrossSection, Manifold, OpType
from numpy.typing import NDArray

from benchmarks.checkers.read_gcode import (
    Lines,
    Moves,
    read_moves,
    rounded_to_steps,
    trips,
    written_lines,
)
from benchmarks.checkers.round_lumens import crossings, openings, unfilled
from benchmarks.common import ROOT, Row, limited, printctl, row, timed

LAYER_MM, LINE_MM, STEPS_PER_MM = 0.06, 0.15, 80.0
#: Lumens at least so wide are held to the first goal, mm.
WIDE_MM = 0.3
SYRINGE_MM, FILAMENT_MM = 4.61, 1.75
PRUSA_INI = ROOT / "benchmarks" / "solids" / "prusa.ini"
BED_MM = np.array([100.0, 100.0])
PRUSA_BED_MM = np.array([30.0, 30.0])


_ADD = OpType.Add
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
        Of the block; of the field of tubes.
    wall_mm : float
        Of each tube; 0 for a block.
    """

    name: str
    centre: NDArray[np.float64]
    diameter: NDArray[np.float64]
    size: tuple[float, float, float]
    wall_mm: float = 0.0

    def section(self) -> CrossSection:
        """The section at every height."""
        if self.wall_mm:
            tubes = [self._disc(k, self.wall_mm) for k in range(len(self.diameter))]
            body = CrossSection.batch_boolean(tubes, _ADD)
        else:
            body = CrossSection.square(self.size[:2])
        return body - CrossSection.batch_boolean(
            [self._disc(k, 0.0) for k in range(len(self.diameter))], _ADD
        )

    def _disc(self, lumen: int, more_mm: float) -> CrossSection:
        disc = CrossSection.circle(self.diameter[lumen] / 2 + more_mm, SIDES)
        return disc.translate(self.centre[lumen].tolist())

    @property
    def inscribed(self) -> NDArray[np.float64]:
        """Widest circle in each lumen, (n,), mm: what the part itself leaves open."""
        return np.asarray(self.diameter * np.cos(np.pi / SIDES))

    def write_stl(self, path: Path) -> None:
        """Write the part as a binary STL, mm."""
        mesh = Manifold.extrude(self.section(), self.size[2]).to_mesh()
        corners = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)]
        rows = np.zeros(
            len(corners), dtype=[("normal", "<f4", 3), ("at", "<f4", (3, 3)), ("_", "<u2")]
        )
        rows["at"] = corners
        path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())


def _grid(columns: int, rows: int, size: tuple[float, float, float]) -> NDArray[np.float64]:
    x = (np.arange(columns) + 0.5) * size[0] / columns
    y = (np.arange(rows) + 0.5) * size[1] / rows
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def block() -> Part:
    """20 x 20 x 10 mm with 63 lumens of 0.42 to 1.2 mm."""
    size = (20.0, 20.0, 10.0)
    return Part("block", _grid(9, 7, size), np.linspace(0.42, 1.2, 63), size)


def tubes() -> Part:
    """The same lumens as tubes with walls of 0.25 mm."""
    size = (20.0, 20.0, 10.0)
    return Part("tubes", _grid(9, 7, size), np.linspace(0.42, 1.2, 63), size, 0.25)


def small() -> Part:
    """4 x 4 x 1.2 mm with six lumens of 0.15 to 0.3 mm."""
    size = (4.0, 4.0, 1.2)
    return Part("small lumens", _grid(3, 2, size), np.linspace(0.15, 0.3, 6), size)


def channel() -> Part:
    """2 x 2 x 0.8 mm with one lumen of 0.1 mm, for a finer needle."""
    return Part("0.1 mm channel", np.array([[1.0, 1.0]]), np.array([0.1]), (2.0, 2.0, 0.8))


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
    """Yield all rows of the slicing promises; quick leaves the tubes and the small lumens out."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _ours(small(), folder)  # kernels are loaded from their cache from now on
        for part in (block(),) if quick else (block(), tubes()):
            made = _ours(part, folder)
            peers = _peers(part, folder)
            yield from _wide_rows(part, made, peers)
        if quick:
            return
        yield from _small_rows(small(), _ours(small(), folder), _peers(small(), folder))
        fine = _ours(channel(), folder, layer_mm=0.04, line_mm=0.08)
        yield from _channel_rows(channel(), fine)


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
    closed = int((_open(part, made) <= 0).sum())
    yield row(f"{name}: layers in which a lumen is closed", closed, "", "0", closed == 0)
    bare = 100 * _bare(part, made)
    peer = {key: 100 * _bare(part, of) for key, of in peers.items()}
    what = "wall of 0.25 mm" if part.wall_mm else "solid at 100 %"
    yield row(f"{name}: unfilled part of the {what}", bare, "%", "<= 1", bare <= 1, peer)
    found = {key: _crossed(part, of) for key, of in (("", made), *peers.items())}
    peer = {key: value for key, value in found.items() if key}
    yield row(f"{name}: travels that cross a lumen", found[""], "%", "0", found[""] == 0, peer)
    least = min((of.cpu_s for of in peers.values()), default=float("nan"))
    peer = {key: round(of.cpu_s, 1) for key, of in peers.items()}
    goal = "<= 1.0 x PrusaSlicer's least"
    met = made.cpu_s <= least if peers else None
    yield row(f"{name}: CPU of the whole process", made.cpu_s, "s", goal, met, peer) | {
        "memory_mb": round(made.memory_mb),
        "peer_memory_mb": {key: round(of.memory_mb) for key, of in peers.items()},
    }


def _small_rows(part: Part, made: Sliced, peers: dict[str, Sliced]) -> Iterator[Row]:
    found = np.median(_open(part, made), axis=0)
    closed = int((found < 0.5 * part.inscribed).sum())
    peer = {
        key: np.round(np.median(_open(part, of), axis=0), 3).tolist() for key, of in peers.items()
    }
    made_row = row(
        f"{part.name}: closed, of 6 (below half the width)", closed, "", "0", closed == 0, peer
    )
    yield made_row | {
        "open_mm": np.round(found, 3).tolist(),
        "of": part.inscribed.round(3).tolist(),
    }


def _channel_rows(part: Part, made: Sliced) -> Iterator[Row]:
    found = 1e3 * float(np.median(_open(part, made)))
    designed = 1e3 * float(part.inscribed[0])
    measure = f"{part.name}, lines of 80 um in layers of 40 um: open diameter"
    yield row(measure, found, "um", f"{designed:.1f} within 10", abs(found - designed) <= 10)


def _open(part: Part, made: Sliced, *, steps: bool = False) -> NDArray[np.float64]:
    """Open diameter of every lumen in every layer."""
    reach = float(part.diameter.max()) / 2 + 2 * LINE_MM
    return openings(made.lines(steps=steps), part.centre + made.centre, reach).diameter


def _errors_um(part: Part, made: Sliced, *, steps: bool) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.median(_open(part, made, steps=steps), axis=0) - part.inscribed
    return 1e3 * found[part.diameter >= WIDE_MM]


def _bare(part: Part, made: Sliced) -> float:
    """Unfilled part of two layers in the middle, one for each direction of the infill."""
    material = shapely.Polygon()
    for ring in part.section().to_polygons():
        material = shapely.symmetric_difference(material, shapely.Polygon(ring))
    moved = shapely.transform(material, lambda points: points + made.centre)
    lines = made.lines(steps=False)
    heights = np.unique(np.round(lines.z, 4))
    middle = len(heights) // 2
    return float(np.mean([unfilled(lines, z, moved) for z in heights[middle : middle + 2]]))


def _crossed(part: Part, made: Sliced) -> float:
    """Travels over an open lumen, % of all."""
    found = trips(made.moves)
    count = crossings(found, part.centre + made.centre, part.inscribed / 2, made.layer_mm)
    return 100 * count / max(len(found), 1)


def _stl(part: Part, folder: Path) -> Path:
    path = folder / f"{part.name.replace(' ', '_')}.stl"
    if not path.exists():
        part.write_stl(path)
    return path


def _middle(part: Part) -> NDArray[np.float64]:
    """Middle of the part's bounds, where slicers put the bed's middle."""
    if not part.wall_mm:
        return np.array(part.size[:2]) / 2
    reach = (part.diameter / 2 + part.wall_mm)[:, None]
    corners = np.vstack([part.centre - reach, part.centre + reach])
    return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)


def _ours(part: Part, folder: Path, layer_mm: float = LAYER_MM, line_mm: float = LINE_MM) -> Sliced:
    model, out = _stl(part, folder), folder / "ours.gcode"
    given = ["--unit", "mm", "--layer-um", 1e3 * layer_mm, "--line-um", 1e3 * line_mm]
    cpu, memory, _ = timed(printctl("slice", model, *given, "--out", out))
    middle = np.round(BED_MM - _middle(part), 3)
    per_e = np.pi * SYRINGE_MM**2 / 4
    return Sliced(read_moves(out.read_text()), per_e, True, middle, layer_mm, cpu, memory)


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
