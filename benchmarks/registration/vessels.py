"""Time, memory and diameter errors of a whole registration."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tifffile
import trimesh

from benchmarks.common import Row, limited, printctl, row, timed
from benchmarks.registration.phantom import Setting, branched, moved, planar, scan_of
from benchmarks.registration.pose import COARSE, as_designed, case
from registration import register_scan


def whole_rows(quick: bool) -> Iterator[Row]:
    """Yield ``printctl register``'s time and memory on a file of 1000 x 500 x 250 voxels."""
    design, setting = planar(), Setting(**COARSE) if quick else Setting()
    voxels = ",".join(f"{1e3 * size:g}" for size in setting.voxel_mm)
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        volume, _ = scan_of(design, setting, 1)
        tifffile.imwrite(folder / "scan.tif", volume)
        vertices, faces = design.mesh()
        trimesh.Trimesh(vertices, faces, process=False).export(folder / "part.stl")
        (folder / "network.csv").write_text(design.csv())
        given = ["--model", folder / "part.stl", "--voxel-um", voxels, "--json"]
        given += ["--refractive-index", "1.34", "--geometric-depth", "--modality", "oct"]
        given += ["--scale", "linear", "--depth-down", "--axes", "ZYX", "--out", folder / "out"]
        command = printctl("register", folder / "scan.tif", *given)
        # As users run it: Python keeps what it has compiled of the sources.
        command = ["env", "-u", "PYTHONDONTWRITEBYTECODE", *command]
        runs = []
        for _ in range(1 if quick else 4):  # the first fills the disk's cache
            began = time.monotonic()
            cpu, memory, _ = timed(command, allowed=(0, 3))
            runs.append((time.monotonic() - began, cpu, memory))
    wall, cpu, memory = np.median(np.array(runs[-3:]), axis=0).tolist()
    name = " x ".join(map(str, setting.shape)) + " voxels to report"
    yield limited(f"{name}: wall clock", wall, "s", 8.0) | {"cpu_s": cpu}
    yield limited(f"{name}: memory", memory / 1e3, "GB", 1.2)


def diameter_rows(quick: bool) -> Iterator[Row]:
    """Yield errors of all vessels' diameters in clean scans; quick has one coarse scan."""
    errors: list[float] = []
    plain = Setting(**COARSE) if quick else Setting()
    for design in (planar(),) if quick else (planar(), branched()):
        model, network = as_designed(design)
        for seed in range(1 if quick else 3):
            here = case(design, moved(plain, turn_deg=4.0 * seed), seed)
            found = register_scan(here.scan, model, network)
            made = 2000 * design.radius * np.mean(plain.stretch)
            for vessel, truth in zip(found.vessels, made, strict=True):
                errors += (vessel.diameter_um[np.isfinite(vessel.diameter_um)] - truth).tolist()
    bias, spread = float(np.mean(errors)), float(np.std(errors))
    yield row("diameters: bias", bias, "um", "within 5", abs(bias) <= 5)
    yield limited("diameters: sd over all sections", spread, "um", 15.0)
