"""Sweep a network's vessels to closed tubes: chains, cuts at bends, polygonal cross-sections."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.polyline import vectors_across
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

FaceArray = NDArray[np.int64]
EndShape = Literal["flat", "round"]


def tube_mesh(
    points: FloatArray, radius: FloatArray, facets: int, ends: tuple[EndShape, EndShape]
) -> tuple[FloatArray, FaceArray]:
    """Mesh of a tube through ``points``.

    Cross-sections are regular polygons of the circle's area. Rings at inner points lie in the
    plane that halves the bend, so both neighbouring pieces keep their cross-section up to it.

    Parameters
    ----------
    points : (k, 3) float64, mm
        Axis; no two neighbours equal, no bend of 180°.
    radius : (k,) float64, mm
        At each point, linear between.
    facets : int
        Sides of the polygon.
    ends : pair of "flat" or "round"
        Disc or half ball beyond the first and last point.

    Returns
    -------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int64
        Outward.
    """
    direction = np.diff(points, axis=0)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    unit = unit_rings(direction, facets)
    # Each ring as seen from the piece that follows it (the last: from the piece before).
    rings = points[:, None] + area_factor(facets) * radius[:, None, None] * unit
    head, head_apex = _cap(ends[0], points[0], -direction[0], radius[0], rings[0], facets)
    tail, tail_apex = _cap(ends[1], points[-1], direction[-1], radius[-1], rings[-1], facets)
    stack = np.concatenate([head[::-1], rings, tail])
    vertices = np.concatenate([stack.reshape(-1, 3), [head_apex, tail_apex]])
    return vertices, _faces(len(stack), facets)


def straight_tubes(
    points: FloatArray, radius: FloatArray, facets: int, ends: tuple[EndShape, EndShape]
) -> tuple[FloatArray, FaceArray]:
    """Meshes of many tubes of one piece, alike but for place, length and radius.

    A grown tree has thousands: made one by one by `tube_mesh`, they take twenty times as long.

    Parameters
    ----------
    points : (n, 2, 3) float64, mm
    radius : (n, 2) float64, mm
    facets, ends
        As `tube_mesh`, the same for all.

    Returns
    -------
    vertices : (n, v, 3) float64, mm
    faces : (m, 3) int64
        Of each tube, by its own vertices' numbers.
    """
    direction = points[:, 1] - points[:, 0]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    first, second = vectors_across(direction)
    angle = 2.0 * np.pi * np.arange(facets)[:, None] / facets
    across = np.cos(angle) * first[:, None] + np.sin(angle) * second[:, None]
    rings = points[:, :, None] + area_factor(facets) * radius[:, :, None, None] * across[:, None]
    head, head_apex = _cap(ends[0], points[:, 0], -direction, radius[:, 0], rings[:, 0], facets)
    tail, tail_apex = _cap(ends[1], points[:, 1], direction, radius[:, 1], rings[:, 1], facets)
    stack = np.concatenate([head[:, ::-1], rings, tail], axis=1)
    apexes = np.stack([head_apex, tail_apex], axis=1)
    vertices = np.concatenate([stack.reshape(len(points), -1, 3), apexes], axis=1)
    return vertices, _faces(stack.shape[1], facets)


def unit_rings(direction: FloatArray, facets: int) -> FloatArray:
    """Vectors from the axis to each ring's vertices for radius 1, (k + 1, facets, 3).

    At a bend the frame is carried on by reflection in the bisecting plane: it leaves the ring's
    vertices, which lie in that plane, where they are, and twists nothing.
    """
    angle = 2.0 * np.pi * np.arange(facets) / facets
    along = np.empty((len(direction) + 1, facets, 3))
    first, second = vectors_across(direction[0])
    across = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    along[0] = across
    for bend, (before, after) in enumerate(pairwise(direction), 1):
        normal = before + after
        normal /= np.linalg.norm(normal)
        lean = across @ normal
        along[bend] = across - np.outer(lean / (before @ normal), before)
        across = across - 2.0 * np.outer(lean, normal)
    along[-1] = across
    return along


def _cap(
    shape: EndShape,
    centre: FloatArray,
    outward: FloatArray,
    radius: FloatArray,
    rim: FloatArray,
    facets: int,
) -> tuple[FloatArray, FloatArray]:
    """Further rings beyond ``rim`` (..., j, facets, 3), and the apex (..., 3)."""
    if shape == "flat":
        return np.empty((*centre.shape[:-1], 0, facets, 3)), centre
    across, along = dome_profile(facets)
    steps = np.asarray(radius)[..., None, None] * along[:, None] * outward[..., None, :]
    middle = centre[..., None, None, :]
    flat = middle + across[:-1, None, None] * (rim[..., None, :, :] - middle)
    return flat + steps[..., :-1, None, :], centre + steps[..., -1, :]


def _faces(rings: int, facets: int) -> FaceArray:
    """Side quads halved, and a fan to either apex (the last two vertices)."""
    here = np.arange(facets)
    following = (here + 1) % facets
    base = facets * np.arange(rings - 1)[:, None]
    a, b = base + here, base + following
    c, d = a + facets, b + facets
    sides = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    head, tail = rings * facets, rings * facets + 1
    top = (rings - 1) * facets
    head_fan = np.stack([following, here, np.full(facets, head)], -1)
    tail_fan = np.stack([top + here, top + following, np.full(facets, tail)], -1)
    return np.concatenate([sides, head_fan, tail_fan])


FACET_TOLERANCE_MM = 0.001
"""Default greatest distance of a facet from its chord's arc, mm; far below any printed line."""
MIN_FACETS, MIN_COARSE_FACETS = 16, 12
"""Sides of a vessel's polygon, and where its tolerance follows from its radius."""


def facet_count(radius_mm: float, tolerance_mm: float, least: int = MIN_FACETS) -> int:
    """Sides of the polygon whose sagitta r (1 - cos(π/n)) is at most ``tolerance_mm``.

    A multiple of four (so that circles reach their extremes along both axes), at least ``least``.
    """
    ratio = min(tolerance_mm / radius_mm, 1.0)
    wanted = math.pi / math.acos(1.0 - ratio)
    return max(least, 4 * math.ceil(wanted / 4.0))


@dataclass(frozen=True)
class Facets:
    """How near to its arc a facet lies: the greater of a length and a share of the radius.

    Attributes
    ----------
    tolerance_mm : float, mm
    ratio : float
        Of the radius there; 0 for the length alone.
    """

    tolerance_mm: float = FACET_TOLERANCE_MM
    ratio: float = 0.0

    def at(self, radius_mm: float) -> float:
        """Tolerance at a radius, mm."""
        return max(self.tolerance_mm, self.ratio * radius_mm)

    def count(self, radius_mm: float) -> int:
        """Sides of the polygon of a vessel of that radius."""
        least = MIN_COARSE_FACETS if self.ratio else MIN_FACETS
        return facet_count(radius_mm, self.at(radius_mm), least)


def area_factor(facets: int) -> float:
    """Circumradius over radius, for which the polygon's area is that of the circle.

    A regular n-gon of circumradius R has the area (n/2) R² sin(2π/n); set it to π r². Inscribed
    polygons of 16 sides lose 2.6 % of the area, and so 5 % of the conductance.
    """
    angle = 2.0 * math.pi / facets
    return math.sqrt(angle / math.sin(angle))


def inscribed_factor(facets: int) -> float:
    """Inradius of the area-correct polygon over the circle's radius (just below 1)."""
    return area_factor(facets) * math.cos(math.pi / facets)


def dome_profile(facets: int) -> tuple[np.ndarray, np.ndarray]:
    """Rings of a hemispherical cap on an area-correct polygon, of the hemisphere's volume.

    Returns
    -------
    across : (k,) float64
        Radius of each ring over that of the base ring (base excluded, apex, 0, included).
    along : (k,) float64
        Height over the base, over the sphere's radius. It is stretched a little along the axis,
        which takes the volume between rings, h/3 (A₀ + √(A₀A₁) + A₁), up to that of the half ball.
    """
    angle = np.linspace(0.0, math.pi / 2, facets // 4 + 1)
    across, along = np.cos(angle), np.sin(angle)
    across[-1] = 0.0
    lower, upper = across[:-1], across[1:]
    volume = np.sum(np.diff(along) * (lower**2 + lower * upper + upper**2)) / 3.0
    return across[1:], along[1:] * (2.0 / 3.0) / volume


class ChainRules(NamedTuple):
    """When vessels are swept as one tube, and how its radius and ends meet."""

    # Of two ends that are joined; below it the wider one's ball covers the thinner one's
    # disc.
    min_width_ratio: float = 0.9
    # A jump of radius becomes a cone of this share of the radius (or of the piece) in length.
    step: float = 0.1
    # Share of a piece that its two mitres must leave on the inside of the bend.
    min_left: float = 0.1
    # Share of the radius by which a closed ring's last end runs into its first.
    overlap: float = 0.02


CHAINS = ChainRules()


@dataclass(frozen=True)
class Balls:
    """Where runs meet at an angle.

    Attributes
    ----------
    centre : (n, 3) float64, mm
    radius : (n,) float64, mm
        That of the widest vessel there.
    """

    centre: FloatArray
    radius: FloatArray


def split_runs(network: VesselNetwork, facets_of: Facets) -> tuple[list[Chain], Balls]:
    """Cut the network's chains where a mitre would differ from a ball by more than a facet may.

    A mitre also eats r tan(θ/2) of both its pieces on the inside of the bend, which must leave a
    tenth of them; where it doesn't, the chain is cut too.

    Raises
    ------
    SolidError
        For a vessel of zero length.
    """
    runs: list[Chain] = []
    passing = np.zeros(len(network.nodes), dtype=np.int64)
    centre: list[FloatArray] = []
    radius: list[float] = []
    for chain in link_vessels(network, facets_of):
        if len(chain.points) == 2:  # most of a grown tree's
            runs.append(chain)
            continue
        cuts = _sharp_bends(chain, facets_of)
        inner = np.setdiff1d(np.arange(1, len(chain.points) - 1), cuts)
        np.add.at(passing, chain.node[inner][chain.node[inner] >= 0], 2)
        within = [cut for cut in cuts if chain.node[cut] < 0]
        centre += [chain.points[cut] for cut in within]
        radius += [float(chain.radius[cut]) for cut in within]
        cut_chain = _overlapping(chain) if not cuts else chain
        for start, end in pairwise([0, *cuts, len(cut_chain.points) - 1]):
            part = slice(start, end + 1)
            runs.append(Chain(cut_chain.points[part], cut_chain.radius[part], cut_chain.node[part]))
    junction = np.flatnonzero((network.degree() > 1) & (passing < network.degree()))
    return runs, Balls(
        centre=np.concatenate([network.nodes[junction], np.reshape(centre, (-1, 3))]),
        radius=np.r_[_widest(network)[junction], radius],
    )


def _sharp_bends(chain: Chain, facets_of: Facets) -> list[int]:
    """Inner points at which the chain must be cut."""
    if len(chain.points) < 3:
        return []
    step = np.diff(chain.points, axis=0)
    length = np.linalg.norm(step, axis=1)
    direction = step / length[:, None]
    cosine = np.clip(np.sum(direction[:-1] * direction[1:], axis=1), -1.0, 1.0)
    radius = chain.radius[1:-1]
    cut = mitre_excess(cosine, radius) > np.maximum(
        facets_of.tolerance_mm, facets_of.ratio * radius
    )
    with np.errstate(divide="ignore"):
        eaten = np.where(cut, 0.0, radius * np.sqrt((1.0 - cosine) / (1.0 + cosine)))
    # A piece whose two mitres would meet loses both: cheap, and right whatever the order.
    crowded = np.r_[0.0, eaten] + np.r_[eaten, 0.0] > (1.0 - CHAINS.min_left) * length
    cut |= (eaten > 0.0) & (crowded[:-1] | crowded[1:])
    bends: list[int] = (1 + np.flatnonzero(cut)).tolist()
    return bends


def _overlapping(chain: Chain) -> Chain:
    """A smooth ring's last point moved a little beyond its first, so that its ends overlap."""
    if chain.node[0] != chain.node[-1]:
        return chain
    points, step = chain.points.copy(), chain.points[-1] - chain.points[-2]
    points[-1] += CHAINS.overlap * chain.radius[-1] * step / np.linalg.norm(step)
    return Chain(points, chain.radius, chain.node)


def _widest(network: VesselNetwork) -> FloatArray:
    """Radius of the widest vessel that ends at each node, (m,), mm."""
    widest = np.zeros(len(network.nodes))
    ends = np.stack([network.offset[:-1], network.offset[1:] - 1], axis=1)
    np.maximum.at(widest, network.vessel_nodes.ravel(), network.radius[ends].ravel())
    return widest


def free_ends(network: VesselNetwork) -> IntArray:
    """Nodes at which one vessel ends and none goes on."""
    return np.flatnonzero(network.degree() == 1)


# Two tubes that end flat in one plane touch there without overlapping, and rounding makes a slit of
# it. So wherever one vessel continues another gently and about as wide, they become one chain.
End = tuple[int, int]
"""A vessel, and which of its ends: 0 the first, 1 the last."""


@dataclass(frozen=True)
class Chain:
    """Vessels that continue each other, swept as one tube.

    Attributes
    ----------
    points : (k, 3) float64, mm
        No two neighbours equal.
    radius : (k,) float64, mm
    node : (k,) int64
        The network's node at a point, -1 where there is none.
    """

    points: FloatArray
    radius: FloatArray
    node: IntArray

    def reversed(self) -> Chain:
        """The same the other way round."""
        return Chain(self.points[::-1], self.radius[::-1], self.node[::-1])


def mitre_excess(cosine: FloatArray, radius: FloatArray | float) -> FloatArray:
    """How far a mitre's outer corner stands over a ball at a bend by θ: r (1/cos(θ/2) - 1), mm."""
    half = np.sqrt((1.0 + np.clip(cosine, -1.0, 1.0)) / 2.0)
    with np.errstate(divide="ignore"):
        excess: FloatArray = radius * (1.0 / half - 1.0)
    return excess


def link_vessels(network: VesselNetwork, facets_of: Facets) -> list[Chain]:
    """Join the vessels of ``network`` where a mitre is as near to a ball as a facet may be.

    Only where two vessels meet: at a junction of more the union is made of all of them.

    Raises
    ------
    SolidError
        For a vessel of zero length.
    """
    vessels = [_vessel_chain(network, vessel) for vessel in range(network.vessel_count)]
    partner = _partners(network, vessels, facets_of)
    chains: list[Chain] = []
    seen: set[int] = set()
    # First those that begin at an unjoined end; what then remains are closed rings.
    starts = [(v, e) for v in range(len(vessels)) for e in (0, 1) if (v, e) not in partner]
    for start in [*starts, *((vessel, 0) for vessel in range(len(vessels)))]:
        if start[0] not in seen:
            chains.append(_follow(start, vessels, partner, seen))
    return chains


def _vessel_chain(network: VesselNetwork, vessel: int) -> Chain:
    points, radius = network.polyline(vessel)
    if (points[1:] == points[:-1]).all(axis=1).any():
        kept = np.r_[True, np.any(np.diff(points, axis=0) != 0.0, axis=1)]
        points, radius = points[kept], radius[kept]
    if len(points) < 2:
        raise SolidError(f"vessel {vessel} has zero length; remove it or move its ends apart")
    node = np.full(len(points), -1, dtype=np.int64)
    node[0], node[-1] = network.vessel_nodes[vessel]
    return Chain(points, radius, node)


def _partners(network: VesselNetwork, vessels: list[Chain], facets_of: Facets) -> dict[End, End]:
    """The end that continues each joined end, at nodes of two ends."""
    at_node: dict[int, list[End]] = defaultdict(list)
    for vessel, nodes in enumerate(network.vessel_nodes.tolist()):
        at_node[nodes[0]].append((vessel, 0))
        at_node[nodes[1]].append((vessel, 1))
    partner: dict[End, End] = {}
    for ends in at_node.values():
        if len(ends) != 2:
            continue
        one, two = (_outward(vessels[vessel], end) for vessel, end in ends)
        thin, wide = sorted(float(vessels[vessel].radius[-end]) for vessel, end in ends)
        cosine = -float(one @ two)
        gentle = cosine > 0.0 and mitre_excess(np.array(cosine), wide) <= facets_of.at(wide)
        if gentle and thin >= CHAINS.min_width_ratio * wide:
            partner[ends[0]], partner[ends[1]] = ends[1], ends[0]
    return partner


def _outward(chain: Chain, end: int) -> FloatArray:
    """Unit vector from the chain's inside to its ``end``."""
    step = chain.points[0] - chain.points[1] if end == 0 else chain.points[-1] - chain.points[-2]
    unit: FloatArray = step / np.linalg.norm(step)
    return unit


def _follow(start: End, vessels: list[Chain], partner: dict[End, End], seen: set[int]) -> Chain:
    """All vessels from ``start`` on until an end is unjoined or the ring closes."""
    parts: list[Chain] = []
    here: End | None = start
    while here is not None and here[0] not in seen:
        vessel, end = here
        seen.add(vessel)
        parts.append(vessels[vessel] if end == 0 else vessels[vessel].reversed())
        here = partner.get((vessel, 1 - end))
    return _concatenated(parts)


def _concatenated(parts: list[Chain]) -> Chain:
    whole = parts[0]
    for after in parts[1:]:
        before = whole
        wide = max(before.radius[-1], after.radius[0])
        if before.radius[-1] < wide:
            before = _stepped(before.reversed(), wide).reversed()
        elif after.radius[0] < wide:
            after = _stepped(after, wide)
        whole = Chain(
            np.concatenate([before.points, after.points[1:]]),
            np.concatenate([before.radius, after.radius[1:]]),
            np.concatenate([before.node, after.node[1:]]),
        )
    return whole


def _stepped(chain: Chain, wide: float) -> Chain:
    """The chain begun with radius ``wide``, which a short cone takes to its own."""
    first, step = chain.points[0], chain.points[1] - chain.points[0]
    length = float(np.linalg.norm(step))
    share = CHAINS.step * min(1.0, chain.radius[0] / length)
    own = (1.0 - share) * chain.radius[0] + share * chain.radius[1]
    return Chain(
        np.insert(chain.points, 1, first + share * step, axis=0),
        np.r_[wide, own, chain.radius[1:]],
        np.insert(chain.node, 1, -1),
    )
