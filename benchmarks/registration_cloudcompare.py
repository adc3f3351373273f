"""Surface distances of the report against CloudCompare's (Debian: cloudcompare).

Both read the same two files: the scanned surface that `printctl register` wrote, with its deviation
at every vertex, and the design. CloudCompare gets the design as PLY: reading an STL it merges
vertices by a tolerance, and is then 0.14 um off an exact distance itself.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from benchmarks.machine import row
from benchmarks.registration_vessels import scene

Row = dict[str, Any]
FloatArray = NDArray[np.float64]


def cloudcompare_rows(quick: bool) -> Iterator[Row]:
    """Cloud-to-mesh distances of all scanned vertices, of either program."""
    program = shutil.which("CloudCompare")
    if program is None:
        yield row("distances against CloudCompare's C2M: not installed", float("nan"), "um")
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        subprocess.run(scene(folder), check=True, stdout=subprocess.DEVNULL)
        mesh = trimesh.load_mesh(folder / "out" / "deviation.ply", process=False)
        ours = np.asarray(mesh.metadata["_ply_raw"]["vertex"]["data"]["deviation_um"], np.float64)
        np.savetxt(folder / "cloud.xyz", np.asarray(mesh.vertices), fmt="%.9g")
        trimesh.load_mesh(folder / "part.stl").export(folder / "part.ply")
        theirs = 1e3 * _distances(program, folder, folder / "cloud.xyz", folder / "part.ply")
    ours = ours.reshape(-1)
    seen = np.isfinite(ours)
    off = np.abs(np.abs(ours[seen]) - np.abs(theirs[seen]))
    name = f"distances of {len(off)} vertices against CloudCompare's C2M"
    yield row(f"{name}: p99.9", float(np.percentile(off, 99.9)), "um")
    yield row(f"{name}: largest", float(off.max()), "um", "<= 0.1", bool(off.max() <= 0.1))


def _distances(program: str, folder: Path, cloud: Path, mesh: Path) -> FloatArray:
    """CloudCompare's signed distances in the cloud's order, mm."""
    command = [program, "-SILENT", "-NO_TIMESTAMP", "-AUTO_SAVE", "OFF"]
    command += ["-C_EXPORT_FMT", "ASC", "-PREC", "9", "-O", str(cloud), "-O", str(mesh)]
    command += ["-C2M_DIST", "-SAVE_CLOUDS", "FILE", str(folder / "distances.asc")]
    environment = os.environ | {"QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": str(folder)}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment, timeout=600)
    found = np.loadtxt(folder / "distances.asc")
    return np.asarray(found[:, 3], dtype=np.float64)
