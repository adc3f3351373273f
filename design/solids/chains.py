"""Join vessels that continue at a gentle bend, about as wide, to chains swept as one tube.

Two tubes that end flat in one plane touch there without overlapping, and rounding makes a slit of
it. So wherever one vessel continues another gently and about as wide, they become one chain.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids.facets import Facets
from kernels.arrays import FloatArray, IntArray

_WIDTH_RATIO = 0.9
"""Least ratio of the radii of two ends that are joined; below it the wider one's ball covers the
thinner one's disc."""

_STEP_SHARE = 0.1
"""A jump of radius becomes a cone of this share of the radius (or of the piece) in length."""

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
        if gentle and thin >= _WIDTH_RATIO * wide:
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
    share = _STEP_SHARE * min(1.0, chain.radius[0] / length)
    own = (1.0 - share) * chain.radius[0] + share * chain.radius[1]
    return Chain(
        np.insert(chain.points, 1, first + share * step, axis=0),
        np.r_[wide, own, chain.radius[1:]],
        np.insert(chain.node, 1, -1),
    )
