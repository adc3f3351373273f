"""Benchmark of mends: gaps covered, lumens entered, written ink crossed.

Random gaps in planned jobs, each held at a random mark; the product plans its insert, and
`checkers.mended_ink` judges job and insert from their text: it paints voxels and samples the
needle. Layers: gaps of the layer just ended. Embedded: seven of ten in the vessel just written, the
others anywhere, where later vessels may lie above.

Clock: none; CPU time of planning is told.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.mended_ink import Case, Judged, Stroke, judge, place_on, strokes_of
from benchmarks.checkers.networks import read_network
from benchmarks.checkers.read_gcode import Moves, read_moves
from benchmarks.common import ROOT, Row, at_least, limited, printctl, row, scratch, timed
from design.network_files.csv_format import read_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.machine.job.job import Job, load_job
from printctl.machine.job.marks import MarkKind
from printctl.observe.mending import (
    Gap,
    HeldPrint,
    Mend,
    Style,
    Voids,
    WrittenPath,
    plan_mend,
    written_paths,
)

COVERED = 0.95
"""Share of a gap's missing voxels from which it counts as mended."""
TOLERANCE_MM = 0.05


@dataclass(frozen=True)
class Planned:
    """An example with ``changes`` in its recipe, and what is mounted for it; mm.

    ``layer_mm`` is None for an embedded one; ``place_mm`` leads from the part's frame to the
    printer's; ``edge_mm`` of voxels.
    """

    name: str
    ink: str
    needle: str
    layer_mm: float | None
    place_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    edge_mm: float = 0.03
    example: str = ""
    changes: tuple[tuple[str, str], ...] = ()

    @property
    def mark(self) -> MarkKind:
        """Where it is held."""
        return MarkKind.VESSEL if self.layer_mm is None else MarkKind.LAYER


MORE_VESSELS = (("terminals: 30", "terminals: 50"), ("[16, 8, 3]", "[16, 12, 8]"))
GELATIN = "gelatin_sacrificial"
JOBS = (
    Planned("planar_fresh", "collagen_fresh", "fresh_150um", 0.06, (92.0, 96.0, 1.0), 0.015),
    Planned("planar_tree", GELATIN, "30g_50mm", None),
    Planned("ring_closed_loop", GELATIN, "30g", None),
    Planned(
        "tree_of_99_vessels", GELATIN, "30g_50mm", None, example="planar_tree", changes=MORE_VESSELS
    ),
)


def rows(quick: bool) -> Iterator[Row]:
    """Yield all jobs; quick has the layered one, and few gaps."""
    for planned in JOBS[: 1 if quick else None]:
        yield from mend_rows(planned, 2 if quick else 60)


def mend_rows(planned: Planned, count: int) -> Iterator[Row]:
    """Yield what became of so many gaps of one job."""
    with scratch() as place:
        folder = place / "run"
        _plan(planned, folder)
        rng = np.random.default_rng(26)
        results = [_one(planned, folder, rng) for _ in range(count)]
    name, judged = planned.name, [one for one, _, _ in results if one is not None]
    mended = sum(one.covered >= COVERED for one in judged)
    whole = [one.covered for one, mend, _ in results if one is not None and not mend.left]
    left = [one.reason for _, mend, _ in results for one in mend.left]
    reasons = Counter(reason.split(",")[0].split(":")[0] for reason in left)
    what = f"{name}: gaps mended (≥ {COVERED:.0%} of what is missing)"
    yield row(what, mended, f"of {count}") | {"left": dict(reasons)}
    worst = min(whole, default=1.0)
    yield at_least(f"{name}: least covered of gaps planned whole", worst, "", 0.95)
    entered = sum(one.in_lumen_mm > TOLERANCE_MM for one in judged)
    yield limited(f"{name}: lumens entered", entered, "", 0)
    crossed = sum(one.crossed for one in judged)
    yield limited(f"{name}: moves through written ink", crossed, "", 0)
    beside = max((one.beside_mm for one in judged), default=0.0)
    yield limited(f"{name}: ink beside its place", beside, "mm", TOLERANCE_MM)
    off = max((one.off_mm for one in judged), default=0.0)
    yield limited(f"{name}: end off begin", off, "mm", 1e-4)
    yield row(f"{name}: slowest plan", max(spent for _, _, spent in results), "CPU s")


def _plan(planned: Planned, folder: Path) -> None:
    text = (ROOT / "examples" / f"{planned.example or planned.name}.yaml").read_text()
    for old, new in planned.changes:
        text = text.replace(old, new)
    recipe = folder.with_suffix(".yaml")
    recipe.write_text(text)
    timed(printctl("run", recipe, "--until", "toolpath", "--out", folder))


def _one(
    planned: Planned, folder: Path, rng: np.random.Generator
) -> tuple[Judged | None, Mend, float]:
    """Hold at a mark, mend a random gap, judge; None where nothing was mended."""
    printer, syringe = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
    ink, needle = load(Ink, planned.ink), load(Needle, planned.needle)
    job = load_job(folder / "part.gcode", printer)
    style: Style = "embedded" if planned.layer_mm is None else "layered"
    held = HeldPrint(job.lines, _mark(planned, job, rng), printer, syringe, ink, needle, style)
    lines = [line.decode() for line in job.lines[: held.done]]
    moves = read_moves("\n".join(lines), held.start_mm)
    stroke, low, high = _gap(planned, moves, rng)
    began = time.process_time()
    places = [place_on(stroke, moves, at) for at in np.linspace(low, high, 5)]
    gap = _gap_at(written_paths(held), np.array(places))
    mend = plan_mend(held, [gap], _voids(planned, folder))
    spent = time.process_time() - began
    if not mend.lines:
        return None, mend, spent
    insert, ul_per_e = [line.decode() for line in mend.lines], syringe.area_mm2 * ink.flow_factor
    sizes = (planned.layer_mm, needle.outer_mm, planned.edge_mm)
    case = Case(lines, insert, held.start_mm, ul_per_e, *sizes)
    return judge(case, stroke, (low, high), _lumens(planned, folder)), mend, spent


def _gap_at(paths: Sequence[WrittenPath], places: np.ndarray) -> Gap:
    """Gap that begins, passes and ends at places (k, 3), mm, of the nearest path."""
    off = [max(one.nearest_mm(place)[1] for place in places) for one in reversed(paths)]
    path = paths[len(paths) - 1 - int(np.argmin(off))]
    low, middle, high = (path.nearest_mm(places[k])[0] for k in (0, len(places) // 2, -1))
    # A closed path begins where it ends.
    return Gap(path.number, low if low < middle else 0.0, high if high > middle else path.length_mm)


def _mark(planned: Planned, job: Job, rng: np.random.Generator) -> int:
    marks = job.marks.of(planned.mark)
    return marks[int(rng.integers(2 if planned.layer_mm else 0, len(marks)))].index


def _gap(planned: Planned, moves: Moves, rng: np.random.Generator) -> tuple[Stroke, float, float]:
    """A stroke of those that may be broken, and a stretch of it."""
    strokes = strokes_of(moves)
    if planned.layer_mm is not None:
        high = moves.end[strokes[-1].moves[-1], 2]
        strokes = [s for s in strokes if abs(moves.end[s.moves[0], 2] - high) < 1e-3]
        strokes = [s for s in strokes if s.length > 0.3]
    elif rng.random() < 0.7:
        strokes = strokes[-1:]
    return _stretch(strokes, rng)


def _stretch(strokes: Sequence[Stroke], rng: np.random.Generator) -> tuple[Stroke, float, float]:
    """One of the strokes, and a stretch of it: 0.2 to 3 mm, or in one of ten the whole stroke."""
    chosen = strokes[int(rng.integers(len(strokes)))]
    if rng.random() < 0.1 and chosen.length < 10:
        return chosen, 0.0, chosen.length
    length = min(chosen.length, float(np.exp(rng.uniform(np.log(0.2), np.log(3.0)))))
    low = float(rng.uniform(0, chosen.length - length))
    return chosen, low, low + length


def _voids(planned: Planned, folder: Path) -> Voids:
    if planned.layer_mm is None:
        return Voids.none()  # the filaments are the lumens
    return Voids.from_network(read_network_csv(folder / "network.csv", "mm"), planned.place_mm)


def _lumens(planned: Planned, folder: Path) -> Any:
    if planned.layer_mm is None:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2))
    pieces, place = read_network(folder / "network.csv"), np.array(planned.place_mm)
    return pieces.start + place, pieces.end + place, pieces.radius
