"""Dye videos: arrival errors, closed vessels, false alarms.

Films are made by `checkers.dye_film` without the product's code, and handed to the command line as
a user would: film, marks, network.csv.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.dye_film import Pinhole, Spoilt, Tubes, dyed, write_film
from benchmarks.common import Row, limited, row
from benchmarks.registration.phantom import Design, branched, planar

FPS, START_S, INFLOW_UL_S, TOLERANCE = 8.0, 1.5, 0.25 / 0.06, 40.0
CLOSED = ("blocked", "not reached")
READ_PX = 0.5
"""Deviation of the marks' pixels."""


@dataclass(frozen=True)
class Case:
    """A design and how it is filmed.

    Attributes
    ----------
    design : Design
    marked : tuple of int
        Nodes that the user marks.
    seconds : float, s
    tilt_deg : float
    shut : tuple of int
        Vessels closed one at a time.
    """

    design: Design
    marked: tuple[int, ...]
    seconds: float
    tilt_deg: float
    shut: tuple[int, ...]

    def camera(self, seed: int) -> Pinhole:
        """Some 22 px/mm, tilted another way for each seed."""
        size = self.design.size
        centre = np.array([size[0] / 2, size[1] / 2, float(np.median(self.design.node[:, 2]))])
        return Pinhole(
            320, 192, 22.0, centre, 150.0 if self.tilt_deg else 2000.0, self.tilt_deg, 77.0 * seed
        )


def _cases() -> dict[str, Case]:
    flat, tree = planar(), branched()
    corners = (1, 5, 6, 10, 0, 11)
    return {
        "planar": Case(flat, corners, 24.0, 0.0, (5, 6, 7, 8)),
        "planar, camera tilted 20°": Case(flat, corners, 24.0, 20.0, ()),
        "tree": Case(tree, (0, 8, 11, 15), 16.0, 0.0, tuple(range(3, 15))),
    }


def rows(quick: bool) -> Iterator[Row]:
    """Yield errors of arrivals and false alarms in clean films, then closed vessels found."""
    cases = list(_cases().items())
    alarms = clean = 0
    for name, case in cases[:1] if quick else cases:
        errors = []
        for seed in range(1 if quick else 5):
            tubes, data, places = _measured(case, seed)
            errors.append(_errors(tubes, places, case.seconds))
            clean += 1
            alarms += _alarms(data, ())
        off, frame = np.abs(np.concatenate(errors)), 1.0 / FPS
        p95 = {"p95_s": float(np.percentile(off, 95))}
        yield limited(f"{name}: arrival's error, median", float(np.median(off)), "s", frame) | p95
    yield limited(f"{clean} clean films: vessels called closed, late or early", alarms, "", 0)
    made = found = wrong = 0
    for _, case in cases[:1] if quick else cases:
        for vessel in case.shut[: 1 if quick else None]:
            tubes, data, _ = _measured(case, 100 + vessel, (vessel,))
            rest = set(np.flatnonzero(tubes.flow == 0.0).tolist())
            shut = [v for v in data["vessels"] if v["patency"] == "blocked"]
            closed = {v["vessel"] for v in data["vessels"] if v["patency"] in CLOSED}
            made += 1
            found += any(vessel == v["vessel"] or vessel in v["or_in"] for v in shut)
            wrong += len(closed - rest) + _alarms(data, closed)
    yield row(
        "closed vessels found, by number or in its series", found, "", str(made), found == made
    )
    yield limited("open ones called closed, late or early beside them", wrong, "", 0)


def _measured(
    case: Case, seed: int, closed: Collection[int] = ()
) -> tuple[Tubes, Row, list[dict[str, str]]]:
    """What is in the tubes, and what the product says of their film: numbers, places."""
    design, camera = case.design, case.camera(seed)
    tubes = dyed(
        design.node, design.vessel, design.radius, INFLOW_UL_S, START_S, case.seconds, closed
    )
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_film(folder / "film.avi", tubes, camera, FPS, Spoilt(), seed)
        (folder / "network.csv").write_text(design.csv())
        read = camera.pixels(design.node[list(case.marked)])
        read += READ_PX * np.random.default_rng(seed).standard_normal(read.shape)
        pixels = zip(case.marked, read.tolist(), strict=True)
        marks = [{"node": n, "pixel": p} for n, p in pixels]
        # JSON is YAML.
        (folder / "marks.yaml").write_text(json.dumps({"marks": marks}))
        said = ["dye", "film.avi", "--model", ".", "--marks", "marks.yaml", "--out", "out"]
        said += ["--tolerance-percent", f"{TOLERANCE:g}"]
        # As a user does in that folder; 3 says that the film fails.
        command = [sys.executable, "-m", "printctl", *said]
        subprocess.run(command, cwd=folder, capture_output=True, check=False)
        data = json.loads((folder / "out" / "dye.json").read_text())
        with (folder / "out" / "dye.csv").open() as handle:
            return tubes, data, list(csv.DictReader(handle))


def _errors(tubes: Tubes, places: list[dict[str, str]], seconds: float) -> np.ndarray[Any, Any]:
    """Measured less true arrival of the places where one was measured, s."""
    return np.array([
        float(p["arrival_s"]) - tubes.arrival(int(p["vessel"]), float(p["share"]), seconds)
        for p in places
        if p["arrival_s"]
    ])  # fmt: skip


def _alarms(data: Row, known: Collection[int]) -> int:
    """Vessels called closed that aren't known to be, and those that dye leaves out of time."""
    closed = [v for v in data["vessels"] if v["patency"] in CLOSED and v["vessel"] not in known]
    late = [r for r in data["verdict"]["reasons"] if "too late" in r or "too early" in r]
    return len(closed) + len(late)
