"""Write a registration's exports and deviation surface; gather its facts on design and scan.

Apart from the stage, so that `printctl register` needn't load all that makes a run.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.solids import Solid, write_ply
from printctl.run_folder.manifest import digest_file
from registration import RegistrationReport, Scan
from registration.files.exports import (
    write_axes_vtp,
    write_scan_nrrd,
    write_surface_vtp,
    write_tables,
)
from registration.json_ready import Record
from registration.measuring.gauging.deviation import split_summary
from registration.result import scaled_vertices

DEVIATION = "deviation.ply"
VIEWS = "views.npz"
SURFACE_VTP, AXES_VTP, SCAN_NRRD = "deviation.vtp", "sections.vtp", "scan_in_part.nrrd"

_MOST_VOXELS = 8_000_000
"""Of the scan as it is written for 3D Slicer."""


def design_facts(network: Path) -> dict[str, str]:
    """Return what identifies a design, so that comparisons don't mix designs."""
    return {"network_sha256": digest_file(network)}


def surface_facts(
    report: RegistrationReport, network: VesselNetwork
) -> dict[str, dict[str, object] | None]:
    """Deviations of lumens and of outer faces apart, and where outer faces stand out."""
    known = report.seen & np.isfinite(report.scaled_deviation_um)
    facts = split_summary(
        scaled_vertices(report)[known],
        network,
        report.deviation_um[known],
        report.scaled_deviation_um[known],
    )
    if (faces := facts["outer_faces"]) is not None:
        faces["places"] = [asdict(place) for place in report.places]
    return facts


def scan_facts(scan: Scan) -> dict[str, object]:
    """What a compensation must know of the scan behind the numbers."""
    dz, dy, dx = scan.geometric_voxel_mm
    return {
        "modality": scan.modality,
        "voxel_um": [dx * 1e3, dy * 1e3, dz * 1e3],
        "optical_depth": scan.optical_depth,
        "depth_standard": scan.depth_standard,
        "handedness": scan.handedness,
        "space": None
        if scan.space is None
        else {"name": scan.space.name, "from_scan": scan.space.from_scan.tolist()},
    }


AS_CORDS: Final[dict[str, str | None]] = {"written": "cords", "perfusion": None}
"""Over the numbers of solid cords (`toolpath.writes`), which nothing flows through."""


def write_exports(
    folder: Path,
    scan: Scan,
    network: VesselNetwork,
    judged: tuple[RegistrationReport, Record],
) -> list[str]:
    """Tables, and files for ParaView and 3D Slicer, of a report and its judged numbers."""
    report, numbers = judged
    write_surface_vtp(folder / SURFACE_VTP, report)
    write_axes_vtp(folder / AXES_VTP, network, report)
    # Fine enough to see the thinnest lumen, and small enough to be looked at.
    size = float(np.prod(np.array(scan.geometric_voxel_mm) * scan.volume.shape))
    voxel = max(float(2 * network.radius.min()) / 8, (size / _MOST_VOXELS) ** (1 / 3))
    write_scan_nrrd(folder / SCAN_NRRD, scan, report, voxel)
    return [*write_tables(folder, numbers), SURFACE_VTP, AXES_VTP, SCAN_NRRD]


def write_deviation(path: Path, report: RegistrationReport) -> None:
    """Write the scanned surface after the scaled fit, part frame, with its signed deviation.

    The deviation is NaN (grey in viewers) where the surface wasn't seen.
    """
    surface = Solid(scaled_vertices(report), report.surface.faces)
    write_ply(path, surface, scalar=report.scaled_deviation_um, scalar_name="deviation_um")


def load_deviation(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]:
    """Read back what `write_deviation` wrote: vertices, faces, deviation in µm."""
    import trimesh  # heavy, and only reading back needs it

    mesh = trimesh.load_mesh(path, process=False)
    values = mesh.metadata["_ply_raw"]["vertex"]["data"]["deviation_um"]
    return (
        np.asarray(mesh.vertices, dtype=np.float64),
        np.asarray(mesh.faces, dtype=np.int32),
        np.asarray(values, dtype=np.float64).reshape(-1),
    )
