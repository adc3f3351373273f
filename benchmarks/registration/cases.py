"""Run the product on phantom scans, and compute its errors from the truth."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.registration.phantom import Design, Setting, Truth, scan_of
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.solids import Solid
from registration.alignment import Alignment
from registration.scan import Scan

FloatArray = NDArray[np.float64]

#: A scan of the same field at a sixth of the voxels.
COARSE: dict[str, Any] = {"shape": (500, 250, 100), "voxel_mm": (0.030, 0.030, 0.030)}


@dataclass(frozen=True)
class Case:
    """One scan and its truth."""

    scan: Scan
    truth: Truth


def case(design: Design, setting: Setting, seed: int) -> Case:
    """Scan a design."""
    volume, truth = scan_of(design, setting, seed)
    dx, dy, dz = setting.voxel_mm
    scan = Scan(volume, (dz, dy, dx), 1.34, False, "linear", "oct", True, Path(design.name))
    return Case(scan, truth)


def as_designed(design: Design) -> tuple[Solid, VesselNetwork]:
    """Mesh and network as the product takes them."""
    vertices, faces = design.mesh()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.csv"
        path.write_text(design.csv())
        return Solid(vertices.astype(np.float64), faces), read_network_csv(path, "mm")


def targets(design: Design) -> FloatArray:
    """Places all over the part, (125, 3), mm."""
    axes = [np.linspace(0, size, 5) for size in design.size]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)


def errors_um(design: Design, truth: FloatArray, found: FloatArray) -> FloatArray:
    """Target registration error at each place, µm: part to scan by truth, back by the product."""
    part = targets(design)
    scan = part @ truth[:3, :3].T + truth[:3, 3]
    return np.asarray(1e3 * np.linalg.norm(scan @ found[:3, :3].T + found[:3, 3] - part, axis=1))


def parameter_errors(truth: Truth, found: Alignment) -> tuple[FloatArray, FloatArray]:
    """Error of each parameter of the scaled fit, and the half width the product gave it.

    Turns in °, shifts of the part's middle in mm, scales; what wasn't fitted is left out.
    """
    fit, sure = found.scaled, found.uncertainty
    turn = (truth.scan_from_part[:3, :3] / truth.stretch).T
    middle = truth.scan_from_part[:3, :3] @ fit.centre + truth.scan_from_part[:3, 3]
    error = np.concatenate(
        [
            Rotation.from_matrix(fit.rotation @ turn.T).as_rotvec(degrees=True),
            fit.rotation @ middle + fit.shift - fit.centre,
            fit.scale / truth.stretch - 1,
        ]
    )
    half = np.concatenate([sure.rotation_deg, sure.shift_mm, sure.scale / truth.stretch])
    return error, half
