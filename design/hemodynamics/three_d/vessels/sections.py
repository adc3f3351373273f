"""Compute flow and mean pressure at vessel cross-sections from a 3D flow solution.

For any function χ of the distance s along a direction that rises from 0 to 1 over a slab, the flow
through every section in it is ∫ u·∇χ, whatever the lumen's shape, since the wall is tight: exact
for a velocity without sources, and of the elements' own order for Taylor–Hood's. Here
χ' = 35/(32 h) (1 - (s/h)²)³ on (-h, h). Pressure is fitted as a line in s over the same slab, by
the same weights, and read at the section.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.errors import FlowError
from design.geometry.polyline import arc_lengths, places_along
from design.hemodynamics.probes import Probes, ProbeWaves, clear_parts
from design.hemodynamics.three_d.meshing.lumen_mesh import (
    WALL,
    LumenMesh,
    MeshPort,
    jacobian,
    quadratic,
    shapes,
    tetrahedron_rule,
)
from design.hemodynamics.three_d.solution import Field, ThreeDSolution
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Slabs(NamedTuple):
    """Sizes of sections' slabs; lengths in radii of the vessel."""

    half_width: float = 0.75  # h
    reach: float = 3.0  # of elements' centres from the section's
    spacing: float = 0.4  # of the places tried along a vessel, at most 24
    gauss_points: int = 8  # along an edge; the slab's weight is no polynomial over an element
    # Of the area within the wall, in a clear section: elements err by 1 %, another vessel adds 17 %
    # and more (31 loops).
    area_error: float = 0.1


_SLABS: Final = _Slabs()


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
        Flow is the sum of their products with the velocity at these elements' nodes.
    pressure : (m, n') float64
        The same for pressure; 0 in other vessels' elements, unless all is junction.
    area : float, mm²
        Mean over the slab.
    clear : bool
        Whether the slab lies in its own vessel alone, and its area is that within the wall.
    """

    tet: IntArray
    velocity: FloatArray
    pressure: FloatArray
    area: float
    clear: bool

    def flow(self, field: Field) -> float:
        """Return the flow along the direction, µL/s; NaN where the section isn't clear."""
        through = float(np.vdot(self.velocity, field.velocity[self.tet]))
        return through if self.clear else float("nan")

    def mean_pressure(self, field: Field) -> float:
        """Return the mean pressure over the section, Pa."""
        return float(np.vdot(self.pressure, field.pressure[self.tet, :, 0]))


@dataclass(frozen=True)
class _Slab:
    """Connected elements of a slab, whether each is the vessel's own, and the slab's middle."""

    place: SectionPlace
    middle: float
    tet: IntArray
    own: NDArray[np.bool_]


def place_of(network: VesselNetwork, vessel: int, fraction: float) -> SectionPlace:
    """Place a section square to a vessel at a part of its length."""
    points, radius = network.polyline(vessel)
    arc = arc_lengths(points)
    at = fraction * arc[-1]
    here = float(np.interp(at, arc, radius))
    ends = np.clip([at - 0.25 * here, at + 0.25 * here], 0.0, arc[-1])
    place, before, after = places_along(points, arc, np.array([at, *ends]))
    return SectionPlace(place, (after - before) / np.linalg.norm(after - before), here)


class VesselSections:
    """Sections of a network's vessels in its mesh, for fields of one order.

    An element belongs to the vessel whose axis is nearest to its centre, in radii; vessels that
    follow each other without a branch count as one.
    """

    def __init__(self, network: VesselNetwork, mesh: LumenMesh, order: int) -> None:
        self.network, self.mesh, self.order = network, mesh, order
        self._centre = mesh.points[mesh.tets[:, :4]].mean(axis=1)
        self._tree = cKDTree(self._centre)
        self._pieces = network.pieces()
        self._line = _unbranched(network)
        self._on_wall = np.zeros(len(mesh.points), dtype=np.bool_)
        self._on_wall[mesh.faces[mesh.label == WALL]] = True

    def at(self, vessel: int, fraction: float) -> Section:
        """Return the section at a part of a vessel's length.

        Near a port the slab is moved inwards, where the flow is the same.

        Raises
        ------
        FlowError
            When the mesh has nothing at that place.
        """
        return self._weights(self._slab(vessel, place_of(self.network, vessel, fraction)))

    def clearest(self, vessel: int) -> Section | None:
        """Find the clear section nearest to the middle between junctions; None if none is."""
        radius, length = self.network.mean_radius()[vessel], self.network.lengths()[vessel]
        count = int(np.clip(np.ceil(length / (_SLABS.spacing * radius)), 3, 24))
        fractions = (np.arange(count) + 0.5) / count
        middle = clear_parts(self.network)[vessel].mean()
        for fraction in fractions[np.argsort(np.abs(fractions - middle), kind="stable")]:
            slab = self._slab(vessel, place_of(self.network, vessel, float(fraction)))
            if slab.own.all() and (section := self._weights(slab)).clear:
                return section
        return None

    def _slab(self, vessel: int, place: SectionPlace) -> _Slab:
        """Find the slab's elements that are connected with the one nearest to its centre."""
        half = _SLABS.half_width * place.radius
        ends = self.network.vessel_nodes[self._line == self._line[vessel]]
        ports = [p for p in self.mesh.ports if p.node < 0 or p.node in ends]
        middle = _inside(ports, place, half)
        centre = place.centre + middle * place.direction
        tet = np.sort(
            np.array(
                self._tree.query_ball_point(centre, _SLABS.reach * place.radius), dtype=np.int64
            )
        )
        from_centre = self.mesh.points[self.mesh.tets[tet]] - centre
        along = from_centre @ place.direction
        met = (along.min(axis=1) < half) & (along.max(axis=1) > -half)
        tet, distance = tet[met], np.linalg.norm(from_centre[met], axis=2).min(axis=1)
        if not len(tet) or distance.min() > place.radius:
            x, y, z = place.centre
            raise FlowError(
                f"the lumen's mesh has nothing at {x:.3f}, {y:.3f}, {z:.3f} mm, where a probe is; "
                "mesh the network that is probed"
            )
        corner = np.unique(self.mesh.tets[tet, :4], return_inverse=True)[1].ravel()
        part = _connected(np.repeat(np.arange(len(tet)), 4), corner, len(tet))
        tet = tet[part == part[distance.argmin()]]
        return _Slab(place, middle, tet, self._is_own(vessel, centre, tet, place.radius))

    def _is_own(
        self, vessel: int, centre: FloatArray, tet: IntArray, radius: float
    ) -> NDArray[np.bool_]:
        """Return whether the vessel's own axis is nearest to each element, in radii, (m,)."""
        start, end, r0, r1, of = self._pieces
        near = _away(centre[None], start, end, r0, r1)[0] * np.maximum(r0, r1) < (
            _SLABS.reach * radius + 2.0 * np.maximum(r0, r1)
        )
        away = _away(self._centre[tet], start[near], end[near], r0[near], r1[near])
        nearest = of[near][away.argmin(axis=1)]
        return np.asarray(self._line[nearest] == self._line[vessel])

    def _weights(self, slab: _Slab) -> Section:
        place, tet = slab.place, slab.tet
        half = _SLABS.half_width * place.radius
        at, weight = tetrahedron_rule(_SLABS.gauss_points)
        value, slope = quadratic(at)
        node = self.mesh.points[self.mesh.tets[tet]]
        along = np.einsum("qn,tnx,x->tq", value, node - place.centre, place.direction)
        bump = 35.0 / (32.0 * half)
        bump = bump * np.clip(1.0 - ((along - slab.middle) / half) ** 2, 0.0, None) ** 3
        measure = bump * weight * np.abs(np.linalg.det(jacobian(node, slope)))
        area = float(measure.sum())
        # Where a vessel is all junction, pressure is the junction's.
        hardly = float(measure[slab.own].sum()) < 0.1 * area
        own = measure * (slab.own | hardly)[:, None]
        total = np.array([(own * along**k).sum() for k in range(3)])
        line = (total[2] - total[1] * along) / (total[0] * total[2] - total[1] ** 2)
        by_velocity, by_pressure = shapes(self.order, at)[0], shapes(self.order - 1, at)[0]
        return Section(
            tet,
            (measure @ by_velocity)[..., None] * place.direction,
            (own * line) @ by_pressure,
            area,
            bool(slab.own.all()) and abs(area / self._within_wall(slab) - 1.0) < _SLABS.area_error,
        )

    def _within_wall(self, slab: _Slab) -> float:
        """Return the area of a circle of the wall's rms distance from its middle, mm²."""
        node = np.unique(self.mesh.tets[slab.tet])
        beside = self.mesh.points[node[self._on_wall[node]]] - slab.place.centre
        along = beside @ slab.place.direction
        beside = beside[np.abs(along - slab.middle) < _SLABS.half_width * slab.place.radius]
        across = np.cross(beside, slab.place.direction)
        return float(np.pi * across.var(axis=0).sum()) if len(across) else float("inf")


def sections_at(
    network: VesselNetwork, probes: Probes, mesh: LumenMesh, order: int
) -> tuple[Section, ...]:
    """Make a section for each probe, for fields of this mesh and order.

    Raises
    ------
    FlowError
        A probe that isn't on the network, or not in the mesh.
    """
    probes.check(network)
    sections = VesselSections(network, mesh, order)
    return tuple(
        sections.at(vessel, fraction)
        for vessel, fraction in zip(probes.vessel.tolist(), probes.fraction.tolist(), strict=True)
    )


def probe_steady(network: VesselNetwork, probes: Probes, field: Field) -> ProbeWaves:
    """Return steady flow (NaN where a section isn't clear) and pressure at probes.

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


def _inside(ports: Sequence[MeshPort], place: SectionPlace, half: float) -> float:
    """Return how far along the direction the slab must move so that no port cuts it, mm."""
    for port in ports:
        lean = float(port.outward @ place.direction)
        beside = place.centre - port.centre
        depth = -float(port.outward @ beside)
        near = float(np.linalg.norm(beside)) < 2.0 * place.radius
        if near and abs(lean) > 0.5 and depth < half:
            return float(np.sign(lean) * (depth - half))
    return 0.0


def _away(
    points: FloatArray, start: FloatArray, end: FloatArray, r0: FloatArray, r1: FloatArray
) -> FloatArray:
    """Return the distance of points (n, 3) from pieces (k, 3) over the radius there, (n, k)."""
    along = end - start
    share = np.einsum("nkx,kx->nk", points[:, None] - start, along)
    share = np.clip(share / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
    foot = start + share[..., None] * along
    distance = np.linalg.norm(points[:, None] - foot, axis=2)
    return np.asarray(distance / (r0 + share * (r1 - r0)))


def _connected(item: IntArray, node: IntArray, count: int) -> IntArray:
    """Label the connected parts of ``count`` items, of which ``item[k]`` has ``node[k]``."""
    size = count + int(node.max(initial=0)) + 1
    joined = coo_array((np.ones(len(item), np.int8), (item, count + node)), shape=(size, size))
    return np.asarray(connected_components(joined, directed=False)[1][:count])


def _unbranched(network: VesselNetwork) -> IntArray:
    """Label the line of vessels without branches that each vessel is in, (v,)."""
    vessel, end = np.nonzero(network.degree()[network.vessel_nodes] == 2)
    return _connected(vessel, network.vessel_nodes[vessel, end], network.vessel_count)


class _Balance(NamedTuple):
    """Limits of the mass balance."""

    junction: float = (
        0.39  # greatest share of a vessel's length that a junction takes of a clear one
    )
    correction: float = 0.02  # of its own flow; a section that is farther off is left out
    still: float = 1e-3  # of the largest port's flow: sections of less err by a part of this
    rank: float = 1e-9  # relative singular value that is 0
    rounding: float = 1e-6  # relative difference of values that are equal


_BALANCE: Final = _Balance()


def clear_sections(
    network: VesselNetwork, mesh: LumenMesh, order: int
) -> tuple[Section | None, ...]:
    """Return each vessel's clearest section, None where none is clear.

    Raises
    ------
    FlowError
        As `VesselSections.at`.
    """
    sections = VesselSections(network, mesh, order)
    return tuple(sections.clearest(vessel) for vessel in range(network.vessel_count))


def vessel_flows(network: VesselNetwork, solution: ThreeDSolution) -> FloatArray:
    """Return the steady flow in every vessel, (v,), µL/s, from its first node to its last.

    NaN as `conserve_mass`.

    Raises
    ------
    FlowError
        As `clear_sections`.
    """
    field = solution.field
    sections = clear_sections(network, field.mesh, field.order)
    amid = np.array([[np.nan if s is None else s.flow(field)] for s in sections])
    return conserve_mass(network, amid, field.mesh.ports, solution.port_flow[:, None])[:, 0]


def is_clear(network: VesselNetwork) -> BoolArray:
    """Return whether a vessel is longer than the junctions at its ends, (v,)."""
    parts = clear_parts(network)
    return np.asarray((parts[:, 0] < _BALANCE.junction) & (parts[:, 1] > 1.0 - _BALANCE.junction))


def conserve_mass(
    network: VesselNetwork, amid: FloatArray, ports: Sequence[MeshPort], port_flow: FloatArray
) -> FloatArray:
    """Correct the flows ``amid`` the vessels to (v, t) ones that conserve mass at the nodes.

    Least squares, each section weighing by its own flow. A section that the others contradict by
    more than 2 % of its flow is left out. Where no section is, flow follows from the nodes, or is
    NaN. The wall is rigid in 3D, so this holds at every moment.

    Parameters
    ----------
    network : VesselNetwork
    amid : (v, t) float64, µL/s
        Through a clear section of each vessel; NaN where it has none.
    ports : sequence of MeshPort
    port_flow : (p, t) float64, µL/s
        Out of the lumen.
    """
    incidence = np.zeros((len(network.nodes), network.vessel_count))
    vessel = np.arange(network.vessel_count)
    np.add.at(incidence, (network.vessel_nodes[:, 1], vessel), 1.0)
    np.subtract.at(incidence, (network.vessel_nodes[:, 0], vessel), 1.0)
    leaves = np.zeros((len(network.nodes), amid.shape[1]))
    for port, flow in zip(ports, port_flow, strict=True):
        if port.node >= 0:
            leaves[port.node] = flow
    size = np.sqrt((amid**2).mean(axis=1))
    still = _BALANCE.still * float(np.sqrt((leaves**2).mean(axis=1)).max())
    known = np.isfinite(size)
    while True:
        error = np.maximum(size[known], still)
        without = incidence[:, ~known]
        back = np.linalg.pinv(without, rcond=_BALANCE.rank)
        left = leaves - incidence[:, known] @ amid[known]
        # What no choice of the flows without a section can take up, as corrections of the others.
        matrix = (incidence[:, known] - without @ (back @ incidence[:, known])) * error
        inverse = np.linalg.pinv(matrix, rcond=_BALANCE.rank)
        step = inverse @ (left - without @ (back @ left))
        # A correction over the share of an error that the nodes can see (Baarda 1968).
        seen = np.sqrt(np.clip(np.einsum("km,mk->k", inverse, matrix), _BALANCE.rank, None))
        suspect = np.sqrt((step**2).mean(axis=1)) / seen
        worst = float(suspect.max(initial=0.0))
        if worst <= _BALANCE.correction:
            break
        # Sections that are as suspect go together.
        known[np.flatnonzero(known)[suspect > (1.0 - _BALANCE.rounding) * worst]] = False
    flow = np.full_like(amid, np.nan)
    flow[known] = amid[known] + step * error[:, None]
    follows = np.einsum("km,mk->k", back, without) > 1.0 - _BALANCE.rounding
    flow[~known] = np.where(
        follows[:, None], back @ (leaves - incidence[:, known] @ flow[known]), np.nan
    )
    return flow
