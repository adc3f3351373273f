"""Benchmark rows on vessels: time, memory and diameter errors of a whole registration."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tifffile
import trimesh

from benchmarks.common import Row, row
from benchmarks.registration.cases import as_designed, case
from benchmarks.registration.phantom import Setting, branched, moved, planar, scan_of
from benchmarks.solids.slicing import timed
from registration import register_scan


def scene(folder: Path) -> list[str]:
    """Write a scan of 1000 x 500 x 250 voxels and its design; the command that registers it."""
    design = planar()
    volume, _ = scan_of(design, Setting(), 1)
    tifffile.imwrite(folder / "scan.tif", volume)
    vertices, faces = design.mesh()
    trimesh.Trimesh(vertices, faces, process=False).export(folder / "part.stl")
    (folder / "network.csv").write_text(design.csv())
    command = [sys.executable, "-m", "printctl", "register", str(folder / "scan.tif")]
    command += ["--model", str(folder / "part.stl"), "--voxel-um", "15,15,12", "--json"]
    command += ["--refractive-index", "1.34", "--geometric-depth", "--modality", "oct"]
    command += ["--scale", "linear", "--depth-down", "--axes", "ZYX"]
    return [*command, "--out", str(folder / "out")]


def finer(command: list[str], folder: Path) -> list[str]:
    """Write the same scan with every voxel four times, 1000 x 1000 x 500; the command for it."""
    volume = tifffile.imread(folder / "scan.tif")
    depth, wide, long = volume.shape
    fine = tifffile.memmap(
        folder / "fine.tif", shape=(2 * depth, 2 * wide, long), dtype=volume.dtype
    )
    for z, page in enumerate(volume):
        fine[2 * z : 2 * z + 2] = np.repeat(page, 2, axis=0)
    fine.flush()
    other = {str(folder / "scan.tif"): str(folder / "fine.tif"), "15,15,12": "15,7.5,6"}
    return [other.get(word, word) for word in command]


def whole_rows(quick: bool) -> Iterator[Row]:
    """``printctl register`` on a file of 1000 x 500 x 250 voxels, and on one of four times that."""
    with tempfile.TemporaryDirectory() as scratch:
        command = scene(Path(scratch))
        yield from job_rows("1000 x 500 x 250 voxels to report", command, 8, quick)
        command = finer(command, Path(scratch))
        yield from job_rows("1000 x 1000 x 500 voxels to report", command, 30, quick)


def job_rows(measure: str, command: list[str], most_s: float, quick: bool) -> Iterator[Row]:
    """Median time and memory of a whole process."""
    # As users run it: Python keeps what it has compiled of the sources.
    command = ["env", "-u", "PYTHONDONTWRITEBYTECODE", *command]
    runs = []
    for _ in range(2 if quick else 4):  # the first fills the disk's cache
        began = time.monotonic()
        cpu, memory = timed(command)
        runs.append((time.monotonic() - began, cpu, memory))
    wall, cpu, memory = np.median(np.array(runs[1:]), axis=0).tolist()
    yield row(f"{measure}: wall clock", wall, "s", f"<= {most_s:g}", wall <= most_s)
    yield row(f"{measure}: CPU", cpu, "s")
    yield row(f"{measure}: memory", memory / 1e3, "GB", "<= 1.2", memory <= 1.2e3)


def diameter_rows(quick: bool) -> Iterator[Row]:
    """Diameters of all vessels of clean scans against what was made."""
    errors: list[float] = []
    for design in (planar(), branched()):
        model, network = as_designed(design)
        for seed in range(1 if quick else 3):
            setting = moved(Setting(), turn_deg=4.0 * seed)
            here = case(design, setting, seed)
            found = register_scan(here.scan, model, network)
            made = 2000 * design.radius * np.mean(setting.stretch)
            for vessel, truth in zip(found.vessels, made, strict=True):
                errors += (vessel.diameter_um[np.isfinite(vessel.diameter_um)] - truth).tolist()
            print(json.dumps({"sections": len(errors)}), file=sys.stderr, flush=True)
    bias, spread = float(np.mean(errors)), float(np.std(errors))
    yield row("diameters: bias", bias, "um", "within 5", abs(bias) <= 5)
    yield row("diameters: sd over all sections", spread, "um", "<= 15", spread <= 15)
