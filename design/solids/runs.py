"""Cut vessel chains at sharp bends into tubes to sweep; list balls at bends and junctions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from design.network import VesselNetwork
from design.solids.chains import Chain, link_vessels, mitre_excess
from design.solids.facets import Facets
from kernels.arrays import FloatArray, IntArray

_LEAST_LENGTH_LEFT = 0.1
"""Share of a piece that its two mitres must leave on the inside of the bend."""

_RING_OVERLAP = 0.02
"""Share of the radius by which a closed ring's last end runs into its first."""


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
    crowded = np.r_[0.0, eaten] + np.r_[eaten, 0.0] > (1.0 - _LEAST_LENGTH_LEFT) * length
    cut |= (eaten > 0.0) & (crowded[:-1] | crowded[1:])
    bends: list[int] = (1 + np.flatnonzero(cut)).tolist()
    return bends


def _overlapping(chain: Chain) -> Chain:
    """A smooth ring's last point moved a little beyond its first, so that its ends overlap."""
    if chain.node[0] != chain.node[-1]:
        return chain
    points, step = chain.points.copy(), chain.points[-1] - chain.points[-2]
    points[-1] += _RING_OVERLAP * chain.radius[-1] * step / np.linalg.norm(step)
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
