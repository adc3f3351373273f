"""Dye videos: arrival errors, closed vessels, false alarms.

Films are made by `checkers.dye_film` without the product's code, and handed to the command line as
a user would: film, marks, network.csv.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.checkers.dye_film import Pinhole, Spoilt, Tubes, dyed, write_film
from benchmarks.common import Row, all_of, limited, printctl, read_csv, scratch
from benchmarks.registration.scans import Part, branched, planar
from design.network_files.csv_format import write_network_csv

FPS, START_S, INFLOW_UL_S, TOLERANCE = 8.0, 1.5, 0.25 / 0.06, 40.0
CLOSED = ("blocked", "not reached")
READ_PX = 0.5
"""Deviation of the marks' pixels."""


@dataclass(frozen=True)
class Case:
    """A part, nodes that the user marks, how it is filmed, and vessels closed one at a time."""

    part: Part
    marked: tuple[int, ...]
    seconds: float
    tilt_deg: float
    shut: tuple[int, ...]

    def camera(self, seed: int) -> Pinhole:
        """Return a camera over the part, tilted another way for each seed."""
        size, depth = self.part.size_mm, float(np.median(self.part.network.nodes[:, 2]))
        centre, away = np.array([*size[:2] / 2, depth]), 150.0 if self.tilt_deg else 2000.0
        scale = 240.0 / size[0]
        return Pinhole(320, 192, scale, centre, away, self.tilt_deg, 77.0 * seed)


def _cases() -> dict[str, Case]:
    corners = (1, 5, 6, 10, 0, 11)
    return {
        "planar": Case(planar(), corners, 48.0, 0.0, (5, 6, 7, 8)),
        "planar, camera tilted 20°": Case(planar(), corners, 48.0, 20.0, ()),
        "tree": Case(branched(), (0, 8, 11, 15), 16.0, 0.0, tuple(range(3, 15))),
    }


def rows(quick: bool) -> Iterator[Row]:
    """Yield errors of arrivals and false alarms in clean films, then closed vessels found."""
    cases = list(_cases().items())[: 1 if quick else None]
    alarms = clean = 0
    for name, case in cases:
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
    for _, case in cases:
        for vessel in case.shut[: 1 if quick else None]:
            tubes, data, _ = _measured(case, 100 + vessel, (vessel,))
            rest = set(np.flatnonzero(tubes.flow == 0.0).tolist())
            shut = [v for v in data["vessels"] if v["patency"] == "blocked"]
            closed = {v["vessel"] for v in data["vessels"] if v["patency"] in CLOSED}
            made += 1
            found += any(vessel == v["vessel"] or vessel in v["or_in"] for v in shut)
            wrong += len(closed - rest) + _alarms(data, closed)
    yield all_of("closed vessels found, by number or in its series", found, made)
    yield limited("open ones called closed, late or early beside them", wrong, "", 0)


def _measured(
    case: Case, seed: int, closed: Collection[int] = ()
) -> tuple[Tubes, Row, list[dict[str, str]]]:
    """Return the tubes' truth, and what the product reports of their film: numbers, places."""
    net, camera = case.part.network, case.camera(seed)
    radius = net.pieces()[2]
    tubes = dyed(net.nodes, net.vessel_nodes, radius, INFLOW_UL_S, START_S, case.seconds, closed)
    with scratch() as folder:
        write_film(folder / "film.avi", tubes, camera, FPS, Spoilt(), seed)
        write_network_csv(folder / "network.csv", net)
        read = camera.pixels(net.nodes[list(case.marked)])
        read += READ_PX * np.random.default_rng(seed).standard_normal(read.shape)
        marks = [{"node": n, "pixel": p} for n, p in zip(case.marked, read.tolist(), strict=True)]
        (folder / "marks.yaml").write_text(json.dumps({"marks": marks}))  # JSON is YAML
        command = printctl("dye", "film.avi", "--model", ".", "--marks", "marks.yaml", "--out", "o")
        command += ["--tolerance-percent", f"{TOLERANCE:g}"]
        # As a user does in that folder; a film that fails ends with 3.
        subprocess.run(command, cwd=folder, capture_output=True, check=False)
        data = json.loads((folder / "o" / "dye.json").read_text())
        return tubes, data, read_csv(folder / "o" / "dye.csv")


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
