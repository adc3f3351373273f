"""One recipe for every shipped printer: path and volume of each file, read without product code.

The reader takes commands from the profile's YAML text and the dialects' manuals: G-code with E,
G-code with a valve, and Aerotech's, whose F counts per second (G76) and whose plunger is an axis.
Volume is the plunger's travel times the syringe's bore, or the valve's flow times the time that it
is open in motion, layer by layer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.checkers.aerotech import read_program
from benchmarks.common import Row, all_of, limited
from design.solids import Solid
from design.toolpath import MoveKind, Toolpath
from design.toolpath.fresh import FreshOptions, plan_fresh
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load, shipped, shipped_text

SYRINGE, FLOW_UL_S = "hamilton_1ml", 0.05
PATH_UM, VOLUME_PERCENT = 1.0, 0.1
NEGLIGIBLE_UL_MM = 1e-6
APART_MM = 103.0
"""Of the two heads of the rig whose axes are read by `benchmarks.checkers.aerotech`."""
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Written:
    """Moves that lay ink: ``start``, ``end`` (n, 3), mm, and ``volume_ul`` (n,)."""

    start: FloatArray
    end: FloatArray
    volume_ul: FloatArray


def profile_rows(quick: bool) -> Iterator[Row]:
    """Yield the worst deviations of each printer's file from the one plan."""
    plan = _plan()
    names, good = shipped(Printer), 0
    for name in names:
        path_um, percent = _deviations(plan, name)
        good += path_um <= PATH_UM and percent <= VOLUME_PERCENT
        yield limited(f"{name}: path from the plan, either way", round(path_um, 3), "µm", PATH_UM)
        yield limited(f"{name}: volume, worst layer", round(percent, 4), "%", VOLUME_PERCENT)
    yield all_of("printers whose file is the plan", good, len(names))


def _plan() -> Toolpath:
    """Return a block of 6 x 5 x 0.6 mm with a bore of eight sides, in layers of 60 µm."""
    bore = manifold3d.Manifold.cylinder(2, 0.8, circular_segments=8).translate([3, 2.5, -1])
    mesh = (manifold3d.Manifold.cube([6, 5, 0.6]) - bore).to_mesh()
    solid = Solid(
        np.asarray(mesh.vert_properties[:, :3], dtype=np.float64),
        np.asarray(mesh.tri_verts, dtype=np.int32),
    )
    return plan_fresh(solid, FreshOptions(write_speed_mm_s=5.0)).toolpath


def _deviations(plan: Toolpath, name: str) -> tuple[float, float]:
    """Return the largest distance between plan and file, µm, and the worst layer's volume, %."""
    facts = yaml.safe_load(shipped_text(Printer, name))
    middle = [(facts[f"{axis}_mm"]["low"] + facts[f"{axis}_mm"]["high"]) / 2 for axis in "xyz"]
    place = np.round(middle, 3) - [3.0, 2.5, 0.0]
    air = facts.get("dispenser", {}).get("kind") == "pneumatic"
    options = GcodeOptions(
        start_mm=(middle[0], middle[1], facts["z_mm"]["high"] - 5.0),
        flow_ul_s=FLOW_UL_S if air else None,
    )
    job = write_gcode(plan, load(Printer, name), load(Syringe, SYRINGE), place, options)
    text = job.data.decode("utf-8")
    found = _read_axes(text, name) if "z_axis" in str(facts.get("heads")) else read(text, facts)
    writes = (plan.kind == MoveKind.WRITE) & (np.linalg.norm(plan.end - plan.start, axis=1) > 0)
    meant = Written(plan.start[writes] + place, plan.end[writes] + place, plan.volume_ul[writes])
    path_um = 1e3 * max(_distance_mm(found, meant), _distance_mm(meant, found))
    return path_um, _volume_percent(found, meant)


def _read_axes(text: str, name: str) -> Written:
    """Read the file of a rig whose heads have vertical axes and valves of their own."""
    program = read_program(text, "//")
    moves, writes = program.moves(APART_MM, FLOW_UL_S), program.head >= 0
    if set(np.unique(program.head[writes])) - {0}:
        raise ValueError(f"{name}: another head writes than the plan's")
    writes &= moves.length > 0
    return Written(moves.start[writes], moves.end[writes], moves.pushed[writes])


def read(text: str, facts: dict[str, Any]) -> Written:
    """Read a job's moves that lay ink, by the profile's own text.

    Raises
    ------
    ValueError
        For a line that could move the needle and isn't understood.
    """
    head = facts.get("dispenser", {})
    bore_mm = yaml.safe_load(shipped_text(Syringe, SYRINGE))["inner_mm"]
    plunger = facts.get("file_controller", {}).get("plunger_axis", "E")
    per_s = 1.0 if facts["firmware"] == "aerotech" else 60.0
    at, feed, is_open = dict.fromkeys(("X", "Y", "Z", plunger), 0.0), math.nan, False
    rows: list[list[float]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        line = re.split(r";|//", raw)[0].strip()
        if line in (head.get("opens"), head.get("closes")):
            is_open = line == head["opens"]
        elif re.match(r"G0?[01]\b", line):
            words = {word[0]: float(word[1:]) for word in line.split()[1:]}
            feed = words.pop("F", feed * per_s) / per_s
            to = at | words
            start, end = ([place[axis] for axis in "XYZ"] for place in (at, to))
            length = math.dist(start, end)
            pushed = (to[plunger] - at[plunger]) * math.pi / 4 * bore_mm**2
            volume = FLOW_UL_S * length / feed if is_open else pushed
            if length > 0 and volume > NEGLIGIBLE_UL_MM * length:
                rows.append([*start, *end, volume])
            at = to
        elif line.startswith("G92"):
            at |= {word[0]: float(word[1:]) for word in line.split()[1:]}
        elif re.match(r"G(?!(4|21|71|76|90|92|108)\b)|M83|M8[12]0", line):
            raise ValueError(f"line {number}: {raw!r} isn't read by this checker")
    found = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return Written(found[:, :3], found[:, 3:6], found[:, 6])


def _distance_mm(one: Written, other: Written) -> float:
    """Return how far an end or a middle of ``one`` lies from the nearest line of ``other``, mm."""
    points = np.concatenate([one.start, one.end, (one.start + one.end) / 2])
    along = other.end - other.start
    worst = 0.0
    for some in np.array_split(points, max(1, len(points) // 200)):
        ahead = some[:, None] - other.start[None]
        share = np.clip((ahead * along).sum(-1) / (along * along).sum(-1), 0.0, 1.0)
        gap = np.linalg.norm(ahead - share[..., None] * along, axis=-1)
        worst = max(worst, float(gap.min(axis=1).max()))
    return worst


def _volume_percent(found: Written, meant: Written) -> float:
    """Return the worst layer's difference in volume, %; infinite where layers differ."""
    sums: list[dict[int, float]] = []
    for one in (found, meant):
        layers: dict[int, float] = {}
        for z, volume in zip(np.round(one.end[:, 2] / 0.01), one.volume_ul, strict=True):
            layers[int(z)] = layers.get(int(z), 0.0) + float(volume)
        sums.append(layers)
    if sums[0].keys() != sums[1].keys():
        return math.inf
    return max(100 * abs(sums[0][z] / sums[1][z] - 1) for z in sums[1])
