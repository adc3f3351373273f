"""Compute flow and mean pressure at vessel cross-sections from a 3D flow solution.

For any function χ of the distance s along a direction that rises from 0 to 1 over a slab, the flow
through every section in it is ∫ u·∇χ, whatever the lumen's shape, since the wall is tight: exact
for a velocity without sources, and of the elements' own order for Taylor–Hood's. It needs no
point to be found and no rim to be clipped. Here χ' = 35/(32 h) (1 - (s/h)²)³ on (-h, h).

Pressure is fitted as a line in s over the same slab, by the same weights, and read at the section.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.errors import FlowError
from design.geometry.polyline import arc_lengths, places_along
from design.hemodynamics.probes import Probes, ProbeWaves
from design.hemodynamics.three_d.lagrange import jacobian, quadratic, shapes, tetrahedron_rule
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.solution import Field, ThreeDWaves
from design.network import FloatArray, IntArray, VesselNetwork

_HALF_WIDTH: Final = 0.75
"""h of a slab, in radii of the vessel."""

_REACH: Final = 2.0
"""How far from its centre a section may go, in radii."""

_RULE: Final = 8
"""Gauss points along an edge; the slab's weight is no polynomial over an element."""


@dataclass(frozen=True)
class SectionPlace:
    """A section: its centre (3,) in mm, unit direction (3,) along the vessel, radius in mm."""

    centre: FloatArray
    direction: FloatArray
    radius: float


@dataclass(frozen=True)
class Section:
    """Weights on the elements of a slab.

    Attributes
    ----------
    tet : (m,) int64
    velocity : (m, n, 3) float64
        Flow is their product's sum with the velocity at these elements' nodes.
    pressure : (m, n') float64
        As much for pressure.
    area : float, mm²
        Mean over the slab.
    """

    tet: IntArray
    velocity: FloatArray
    pressure: FloatArray
    area: float

    def flow(self, field: Field) -> float:
        """Along the direction, µL/s."""
        return float(np.vdot(self.velocity, field.velocity[self.tet]))

    def mean_pressure(self, field: Field) -> float:
        """Over the section, Pa."""
        return float(np.vdot(self.pressure, field.pressure[self.tet, :, 0]))


def place_of(network: VesselNetwork, vessel: int, fraction: float) -> SectionPlace:
    """Section square to a vessel at a part of its length; direction over half a radius."""
    points, radius = network.polyline(vessel)
    arc = arc_lengths(points)
    at = fraction * arc[-1]
    here = float(np.interp(at, arc, radius))
    ends = np.clip([at - 0.25 * here, at + 0.25 * here], 0.0, arc[-1])
    place, before, after = places_along(points, arc, np.array([at, *ends]))
    return SectionPlace(place, (after - before) / np.linalg.norm(after - before), here)


def section_of(mesh: LumenMesh, place: SectionPlace, order: int) -> Section:
    """Weights of a section for fields of this order.

    Near a port the slab lies inside it, since flow is the same there.

    Raises
    ------
    FlowError
        When the mesh has nothing at that place.
    """
    half = _HALF_WIDTH * place.radius
    middle = _inside(mesh, place, half)
    tet = _slab(mesh, place, middle, half)
    at, weight = tetrahedron_rule(_RULE)
    value, slope = quadratic(at)
    node = mesh.points[mesh.tets[tet]]
    along = np.einsum("qn,tnx,x->tq", value, node - place.centre, place.direction)
    bump = 35.0 / (32.0 * half) * np.clip(1.0 - ((along - middle) / half) ** 2, 0.0, None) ** 3
    measure = bump * weight * np.abs(np.linalg.det(jacobian(node, slope)))
    total = np.array([(measure * along**k).sum() for k in range(3)])
    line = (total[2] - total[1] * along) / (total[0] * total[2] - total[1] ** 2)
    by_velocity, by_pressure = shapes(order, at)[0], shapes(order - 1, at)[0]
    return Section(
        tet,
        (measure @ by_velocity)[..., None] * place.direction,
        (measure * line) @ by_pressure,
        float(total[0]),
    )


def sections_at(
    network: VesselNetwork, probes: Probes, mesh: LumenMesh, order: int
) -> tuple[Section, ...]:
    """A section for each probe, for fields of this mesh and order.

    Raises
    ------
    FlowError
        A probe that isn't on the network, or not in the mesh.
    """
    probes.check(network)
    return tuple(
        section_of(mesh, place_of(network, int(vessel), float(fraction)), order)
        for vessel, fraction in zip(probes.vessel, probes.fraction, strict=True)
    )


def probe_steady(network: VesselNetwork, probes: Probes, field: Field) -> ProbeWaves:
    """Steady flow at probes.

    Raises
    ------
    FlowError
        As `sections_at`.
    """
    sections = sections_at(network, probes, field.mesh, field.order)
    return ProbeWaves(
        np.zeros(1),
        np.array([[s.mean_pressure(field)] for s in sections]),
        np.array([[s.flow(field)] for s in sections]),
    )


def probe_waves(waves: ThreeDWaves) -> ProbeWaves:
    """What pulsatile flow recorded at sections, as other fidelities tell it."""
    return ProbeWaves(waves.time_s, waves.section_pressure, waves.section_flow)


def _inside(mesh: LumenMesh, place: SectionPlace, half: float) -> float:
    """Where along the direction the slab's middle lies, so that no port cuts it, mm."""
    for port in mesh.ports:
        lean = float(port.outward @ place.direction)
        beside = place.centre - port.centre
        depth = -float(port.outward @ beside)
        near = float(np.linalg.norm(beside)) < 2.0 * place.radius
        if near and abs(lean) > 0.5 and depth < half:
            return float(np.sign(lean) * (depth - half))
    return 0.0


def _slab(mesh: LumenMesh, place: SectionPlace, middle: float, half: float) -> IntArray:
    """Elements of the slab that hang together with the one nearest to its centre."""
    centre = place.centre + middle * place.direction
    from_centre = mesh.points - centre
    along = (from_centre @ place.direction)[mesh.tets]
    distance = np.linalg.norm(from_centre, axis=1)[mesh.tets].min(axis=1)
    met = (along.min(axis=1) < half) & (along.max(axis=1) > -half)
    tet = np.flatnonzero(met & (distance < _REACH * place.radius))
    if not len(tet) or distance[tet].min() > place.radius:
        x, y, z = place.centre
        raise FlowError(
            f"the lumen's mesh has nothing at {x:.3f}, {y:.3f}, {z:.3f} mm, where a probe is; "
            "mesh the network that is probed"
        )
    nearest = tet[distance[tet].argmin()]
    rows = np.repeat(np.arange(len(tet)), 4)
    count = len(tet) + mesh.corner_count
    joined = coo_array(
        (np.ones(len(rows), np.int8), (rows, len(tet) + mesh.tets[tet, :4].ravel())),
        shape=(count, count),
    )
    _, part = connected_components(joined, directed=False)
    return np.asarray(tet[part[: len(tet)] == part[np.searchsorted(tet, nearest)]])
