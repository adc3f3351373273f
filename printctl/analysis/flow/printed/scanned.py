"""Extract a network's lumen surface from a registered scan, at the measured diameters."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from manifold3d import Manifold
from scipy.spatial import cKDTree

from design.errors import FlowError
from design.geometry.polyline import arc_lengths, vectors_across
from design.geometry.surface import Surface
from design.hemodynamics.probes import clear_parts
from design.hemodynamics.three_d.meshing.lumen_mesh import MeshPort
from design.hemodynamics.three_d.meshing.mesh import manifold_arrays
from design.hemodynamics.three_d.meshing.surface import axis_places, corner_normals
from design.hemodynamics.three_d.meshing.wall import free_ends
from design.network import VesselNetwork
from design.solids.denoise import denoised
from design.solids.lumen import lumen_solid
from design.solids.manifolds import solid_manifold, to_manifold
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NUMBERS
from printctl.run_folder.registration_files import DEVIATION, load_deviation

_APART: Final = 0.25
_SECTIONS: Final = 5
"""Of a vessel."""
_LEAST_CLEAR: Final = 0.3
"""Share of a vessel that is clear of junctions, from which on it is cut."""
_NEAR: Final = 0.3
"""Radii off the measured wall beyond which a section isn't the vessel's own."""


def set_out(lumen: Manifold, network: VesselNetwork) -> Manifold:
    """The lumen with its wall where registration measured it.

    A field blurred by a standard deviation σ has its surface σ²/2r inwards of the wall;
    registration's diameters have that undone, and say how large σ² is.
    """
    squared = blur_squared(lumen, network)
    points, faces = manifold_arrays(lumen)
    axis, apart, _ = axis_places(network, _APART)
    radius = apart[cKDTree(axis).query(points, workers=1)[1]] / _APART
    normals, at_faces = np.zeros_like(points), corner_normals(points, faces)
    for k in range(3):
        np.add.at(normals, faces[:, k], at_faces[:, k])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    moved = points + (squared / (2.0 * radius))[:, None] * normals
    return to_manifold(moved, faces, "the scanned lumen")


def blur_squared(lumen: Manifold, network: VesselNetwork) -> float:
    """σ² by which sections of equal area fall short of the measured radii, mm²; 0 if none is clear.

    The median over all sections; below 0 where the surface is wider than the wall.
    """
    variances = []
    for vessel in range(network.vessel_count):
        first, last = clear_parts(network)[vessel]
        if last - first < _LEAST_CLEAR:
            continue
        way, radii = network.polyline(vessel)
        path = arc_lengths(way)
        for at in np.linspace(first, last, _SECTIONS) * path[-1]:
            piece = min(int(np.searchsorted(path, at, side="right")) - 1, len(path) - 2)
            step = way[piece + 1] - way[piece]
            place = way[piece] + (at - path[piece]) * step / np.linalg.norm(step)
            radius = float(np.interp(at, path, radii))
            seen = _section_radius(lumen, place, step / np.linalg.norm(step))
            if abs(seen / radius - 1.0) < _NEAR:
                variances.append(2.0 * radius * (radius - seen))
    return float(np.median(variances)) if variances else 0.0


def facing(lumen: Manifold, place: FloatArray, way: FloatArray) -> tuple[Manifold, FloatArray]:
    """The lumen seen from a place along the unit vector ``way``, and the (3, 4) that takes back."""
    turn = np.column_stack([*vectors_across(way), way])
    return lumen.transform(np.column_stack([turn.T, -turn.T @ place])), np.column_stack(
        [turn, place]
    )


def _section_radius(lumen: Manifold, place: FloatArray, way: FloatArray) -> float:
    """Of the circle as large as the section around a place, mm; 0 where there is none."""
    here, _ = facing(lumen, place, way)
    areas = []
    for part in here.slice(0.0).decompose():
        low_x, low_y, high_x, high_y = part.bounds()
        if low_x < 0.0 < high_x and low_y < 0.0 < high_y:
            areas.append(part.area())
    return float(np.sqrt(min(areas) / np.pi)) if areas else 0.0


PASSES: Final = 10
_AROUND: Final = 1.4
"""Measured radii within which the lumen is looked for."""
_AMID: Final = 0.3
_LEAST, _MOST = 0.5, 1.6
"""Of the measured vessels' volume: all of what is looked through has twice as much."""
_INSET_VOXELS: Final = 4.0
"""A mouth is rounded by the segmentation's smoothing; so far from it the lumen is taken as it is,
and drawn out straight to the end. Registration leaves out sections there, too."""


@dataclass(frozen=True)
class ScannedLumen:
    """A lumen's surface, and the network in the same frame.

    Attributes
    ----------
    surface : Surface
        Of the lumen.
    network : VesselNetwork
    """

    surface: Surface
    network: VesselNetwork


def scanned_lumen(folder: Path, network: VesselNetwork) -> ScannedLumen:
    """Find the lumen of ``network``, whose radii are the measured ones, in a run's scan.

    The run folder has the scan's surface stretched onto the design; here it has its own size
    again, and the network's axes are put where they lie in it.

    Raises
    ------
    UsageError
        When the run has no surface, or not the numbers to it.
    FlowError, SolidError
        When there is no lumen in it.
    """
    numbers, path = _numbers(folder), folder / DEVIATION
    if not path.is_file():
        raise UsageError(f"--scanned takes the lumen from {DEVIATION}, and there is none at {path};"
                         " register a scan first, or leave --scanned out")  # fmt: skip
    points, faces, _ = load_deviation(path)
    unstretched = np.array(numbers["transform_scan_to_part"]) @ np.linalg.inv(
        np.array(numbers["scaled_scan_to_part"])
    )
    placed = _moved(network, unstretched)
    voxel = 1e-3 * max(numbers["measured_by"]["voxel_um"])
    body = to_manifold(
        denoised(_applied(unstretched, points), faces, PASSES), faces, "the scanned surface"
    )
    lumen = set_out(_lumen(body, placed, voxel), placed)
    for port in free_ends(placed):
        lumen = _drawn_out(lumen, port, _INSET_VOXELS * voxel)
    _check_size(lumen, placed)
    return ScannedLumen(Surface(*manifold_arrays(lumen)), placed)


def _numbers(folder: Path) -> dict[str, Any]:
    try:
        numbers = json.loads((folder / NUMBERS).read_text(encoding="utf-8"))
    except (OSError, ValueError) as exc:
        raise UsageError(f"{folder / NUMBERS} can't be read ({exc}); register the scan") from exc
    missing = {"transform_scan_to_part", "scaled_scan_to_part", "measured_by"} - set(numbers)
    if missing:
        raise UsageError(f"{folder / NUMBERS} has no {min(missing)}; register the scan again")
    return dict(numbers)


def _applied(matrix: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _moved(network: VesselNetwork, matrix: FloatArray) -> VesselNetwork:
    """Axes moved; radii, which were measured in the print's own size, left."""
    return replace(
        network, nodes=_applied(matrix, network.nodes), points=_applied(matrix, network.points)
    )


def _lumen(body: Manifold, network: VesselNetwork, voxel: float) -> Manifold:
    """What is open within reach of the network; ``body`` is the gel, or the lumen itself."""
    around = _along_axes(network, _AROUND * network.radius + 2.0 * voxel)
    amid = _along_axes(network, _AMID * network.radius)
    # Gel has the axes outside of it.
    in_gel = (amid ^ body).volume() < 0.5 * amid.volume()
    return around - body if in_gel else around ^ body


def _along_axes(network: VesselNetwork, radius: FloatArray) -> Manifold:
    """Vessels of another radius, drawn out by it at the ends."""
    other = replace(network, radius=radius)
    ends = free_ends(other)
    solid = lumen_solid(
        other,
        extend_ends_mm=np.array([port.radius_mm for port in ends]),
        extend_nodes=np.array([port.node for port in ends], dtype=np.int64),
        tolerance_mm=0.1 * float(radius.min()),
    )
    return solid_manifold(solid, "the space around the vessels")


def _check_size(lumen: Manifold, network: VesselNetwork) -> None:
    expected = float((np.pi * network.mean_radius() ** 2 * network.lengths()).sum())
    volume = float(lumen.volume())
    if not _LEAST < volume / expected < _MOST:
        raise FlowError(
            f"the scan has {volume:.3g} µL of lumen where the measured vessels have "
            f"{expected:.3g}; leave --scanned out, or register the scan again"
        )


def _drawn_out(lumen: Manifold, port: MeshPort, inset: float) -> Manifold:
    """The lumen whose last ``inset`` mm before a port are those of its section there."""
    start = port.centre - inset * port.outward
    here, back = facing(lumen, start, port.outward)
    reach = 2.0 * _AROUND * port.radius_mm
    disc = Manifold.cylinder(4.0 * reach, reach, reach, 64)
    section = (here ^ disc.translate((0.0, 0.0, -0.5 * reach))).slice(0.0)
    mouth = section.extrude(inset + 0.5 * port.radius_mm)
    return ((here - disc) + mouth).transform(back)
