"""openBF's own networks by our 1D solver, against the waves stored in its repository.

``OPENBF_CHECKOUT`` names a checkout of github.com/INSIGNEO/openBF, with ``models`` and
``test/ref_*.jls``; without it nothing is run. The stored waves and ours are read by this file's
own code. Files are run as openBF computes them: the line "gamma profile", which it doesn't read, is
left out; an inlet's times are put in order; and tapers are straightened (``Rd: Rp``), since its
radius along a vessel, src/vessel.jl, changes by the taper times the cell's length in metres, a
thousandth of it. The 56 arteries are run once more with the tapers as written.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from benchmarks.common import Row, SkippedError, row, scratch
from benchmarks.flow.openbf_case import OpenBFCase, case_of, run_openbf
from firmware_profiles.yaml_file import read_yaml

_HEAD: Final = re.compile(
    rb"\x21\x01([PQAu])\x15\x00\x0e\x14\x02(?:\x31(.{4})|([\xe0-\xff]))(.)", re.S
)
"""A key of one letter and a matrix's head: Float64, rows and columns (Julia's Serialization)."""

_SMALL: Final = 0xDF
"""Tag of the integer 0 in Julia's serializer; small integers follow."""


class Case(NamedTuple):
    """One of openBF's networks: its stored waves' name, its file, and the bar.

    ``rms``: root of the mean square difference in pressure and flow, of the swing in the vessel,
    median over vessels and places.
    """

    name: str
    path: str
    rms: float
    cell_mm: float | None = None


CASES: Final = (
    Case("cca", "boileau2015/cca/cca.yaml", 0.01),
    Case("ibif", "boileau2015/ibif/ibif.yaml", 0.025),
    Case("adan56", "boileau2015/adan56/adan56.yaml", 0.04, 4.0),
    Case("circle_of_willis", "alastruey2007/circle_of_willis.yaml", 0.03, 4.0),
)


def rows(quick: bool) -> Iterator[Row]:
    """A row a network: the difference from the stored waves, and the CPU time."""
    checkout = os.environ.get("OPENBF_CHECKOUT")
    if not checkout:
        raise SkippedError("needs OPENBF_CHECKOUT: a checkout of openBF with its stored waves")
    for case in CASES[:2] if quick else CASES:
        yield _case(Path(checkout), case)
    if not quick:
        yield _case(Path(checkout), CASES[2], straight=False)


def _case(checkout: Path, case: Case, straight: bool = True) -> Row:
    stored = stored_waves((checkout / "test" / f"ref_{case.name}.jls").read_bytes())
    with scratch() as folder:
        file = _prepared(checkout / "models" / case.path, folder, straight)
        inlet = np.loadtxt(folder / f"{file.stem}_inlet.dat", ndmin=2)
        begun = time.process_time()
        ours = _solved(case_of(read_yaml(file.read_text(encoding="utf-8")), inlet), case.cell_mm)
        spent = time.process_time() - begun
    away = {q: _away(ours, stored, q) for q in ("P", "Q")}
    what = f"openBF's {case.name}" + ("" if straight else ", tapers as written")
    median = max(float(np.median(a)) for a in away.values())
    bar = (f"<= {case.rms:g}", median <= case.rms) if straight else ()
    made = row(what + ": rms over the swing, median", median, "", *bar)
    worst = {"pressure_worst": float(away["P"].max()), "flow_worst": float(away["Q"].max())}
    return made | worst | {"cpu_s": spent}


def _solved(case: OpenBFCase, cell_mm: float | None) -> dict[str, np.ndarray]:
    if cell_mm is not None:
        case = replace(case, options=replace(case.options, cell_mm=cell_mm))
    waves = run_openbf(case)[1]
    return {"label": np.array(waves.labels), "time_s": waves.time_s} | waves.waves


def _prepared(source: Path, folder: Path, straight: bool) -> Path:
    """Write the network as openBF computes it, and its inlet in order of time."""
    lines, proximal = [], ""
    for line in source.read_text(encoding="utf-8").splitlines():
        key, _, value = line.strip().removeprefix("- ").partition(":")
        if key in ("gamma profile", "inlet_file"):
            continue
        proximal = value if key == "Rp" else proximal
        straighten = straight and key == "Rd"
        lines.append(line.replace(value, proximal) if straighten else line)
    table = np.loadtxt(source.with_name(f"{source.stem}_inlet.dat"))
    np.savetxt(folder / f"{source.stem}_inlet.dat", table[np.argsort(table[:, 0], kind="stable")])
    file = folder / source.name
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def _away(
    ours: dict[str, np.ndarray], stored: dict[str, dict[str, np.ndarray]], q: str
) -> np.ndarray:
    """Root mean square difference over the vessel's swing, at five places of every vessel."""
    time = ours["time_s"]
    period = time[1] * len(time)
    found = []
    for label, waves in zip(ours["label"].tolist(), ours[q], strict=True):
        theirs = stored[label][q]
        swing = np.ptp(theirs[:, 1:])
        for place in range(5):
            mine = np.interp(theirs[:, 0] % period, time, waves[place], period=period)
            found.append(np.sqrt(np.mean((mine - theirs[:, 1 + place]) ** 2)) / swing)
    return np.array(found)


def stored_waves(data: bytes) -> dict[str, dict[str, np.ndarray]]:
    """Matrices (time, five places) by vessel and quantity, of a file by Julia's Serialization."""
    found: dict[str, dict[str, np.ndarray]] = {}
    label, after = "", 0
    for head in _HEAD.finditer(data):
        rows = int.from_bytes(head[2], "little") if head[2] else head[3][0] - _SMALL
        columns = head[4][0] - _SMALL
        if head.start() != after:  # a vessel's name stands before its first matrix
            label = _last_text(data[after : head.start()])
        body = np.frombuffer(data, "<f8", rows * columns, head.end())
        found.setdefault(label, {})[head[1].decode()] = body.reshape(columns, rows).T
        after = head.end() + 8 * rows * columns
    return found


def _last_text(data: bytes) -> str:
    """The last short text: a mark, its length, its letters."""
    for at in range(len(data) - 2, -1, -1):
        size = data[at + 1]
        word = data[at + 2 : at + 2 + size]
        shown = word.decode("ascii", "replace")
        if data[at] == 0x21 and 0 < size == len(word) and word.isascii() and shown.isprintable():
            return shown
    raise ValueError("no name stands before a matrix")
