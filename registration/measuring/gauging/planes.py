"""Section planes across each vessel's axis in the scan's frame; vessel lengths inside junctions."""

from __future__ import annotations

import numpy as np

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.measuring.gauging.sections import Planes


def stations(
    network: VesselNetwork, vessel: int, spacing_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Evenly spaced places along a vessel, in the part's frame.

    Returns
    -------
    along : (n,) float64, mm
        From the vessel's first node; ends are half a spacing off the nodes.
    centre, tangent : (n, 3) float64
        Position and unit direction.
    radius : (n,) float64, mm
        Designed.
    """
    points, radii = network.polyline(vessel)
    path = arc_lengths(points)
    count = max(3, int(np.ceil(path[-1] / spacing_mm)))
    along = (np.arange(count) + 0.5) * path[-1] / count
    centre = places_along(points, path, along)
    # A chord over about a radius, so that a kinked polyline's planes don't jump.
    reach = np.maximum(np.interp(along, path, radii), spacing_mm) / 2
    ends = [np.clip(along + side * reach, 0, path[-1]) for side in (1, -1)]
    chord = places_along(points, path, ends[0]) - places_along(points, path, ends[1])
    tangent = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    return along, centre, tangent, np.interp(along, path, radii)


def to_scan(centre: FloatArray, tangent: FloatArray, radius: FloatArray, fit: Fit) -> Planes:
    """Planes across the centreline, carried into the scan's frame.

    Positions follow the fitted map; lengths stay those of the scan, so that diameters are those
    of the print as it is.
    """
    return Planes(fit.invert(centre), across_tangents(tangent @ fit.rotation), radius)


def across_tangents(direction: FloatArray) -> FloatArray:
    """Two unit vectors across each unit direction (n, 3) and each other, (n, 2, 3)."""
    helper = np.where(np.abs(direction[:, 2:]) < 0.8, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], axis=1)


def clearances(network: VesselNetwork) -> FloatArray:
    """How far from its first and last node each vessel is free of its neighbours, (v, 2), mm.

    Two round lumens of radii r and R that leave a node at the angle φ part where
    t = (R + r cos φ) / sin φ along the first; continuing straight on they never overlap sideways.
    """
    ends = np.stack(
        [
            [_leaving(network, v, last) for last in (False, True)]
            for v in range(network.vessel_count)
        ]
    )
    radius = np.array(
        [[network.polyline(v)[1][k] for k in (0, -1)] for v in range(network.vessel_count)]
    )
    at_node: dict[int, list[tuple[int, int]]] = {}
    for vessel, side in np.ndindex(network.vessel_count, 2):
        at_node.setdefault(int(network.vessel_nodes[vessel, side]), []).append((vessel, side))
    out = np.zeros((network.vessel_count, 2))
    for meeting in at_node.values():
        for here in meeting:
            for other in meeting:
                if other != here:
                    cosine = float(ends[here] @ ends[other])
                    sine = max(np.sqrt(max(0.0, 1 - cosine**2)), 0.05)
                    reach = (radius[other] + radius[here] * cosine) / sine
                    limit = 4 * max(radius[other], radius[here])
                    out[here] = max(out[here], min(max(reach, 0.0), limit))
    return out


def _leaving(network: VesselNetwork, vessel: int, last: bool) -> FloatArray:
    """Unit direction in which a vessel leaves its first (or last) node."""
    points, radii = network.polyline(vessel)
    if last:
        points, radii = points[::-1], radii[::-1]
    away = np.linalg.norm(points - points[0], axis=1)
    far = int(np.argmax(away >= min(2 * radii[0], away.max())))
    return np.asarray((points[far] - points[0]) / away[far])
