"""Find the root on a tissue's surface of least tree cost, by growing small trial trees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from design.errors import DesignError, GrowthError
from design.tissue import Tissue
from design.vasculature.growth.surface_points import surface_points
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray

PROBE_TERMINALS = 200
"""Of the small tree grown from each candidate, at most."""

_SAMPLES = 4000


@dataclass(frozen=True)
class RootSearch:
    """Result of a root search.

    Attributes
    ----------
    points, directions : (k, 3) float64
        Candidates, mm, and inward unit normals.
    cost : (k,) float64
        Σ ℓᵘ r^λ of the tree grown from each; inf where none grew.
    best : int
    """

    points: FloatArray
    directions: FloatArray
    cost: FloatArray
    best: int

    @property
    def note(self) -> str:
        """One sentence: which candidate won, and by how much."""
        grew = np.sort(self.cost[np.isfinite(self.cost)])
        text = (
            "root searched for: of {} places tried ({} grew a tree) the one at "
            "({:.4g}, {:.4g}, {:.4g}) mm is cheapest".format(
                len(self.cost), len(grew), *self.points[self.best]
            )
        )
        if len(grew) < 2:
            return text
        text += f"; the next costs {grew[1] / grew[0] - 1.0:.1%} more"
        return f"{text}, the dearest {grew[-1] / grew[0] - 1.0:.1%} more"


def search_root(
    tissue: Tissue,
    options: GrowthOptions,
    grow: Callable[[Tissue, GrowthOptions], VesselTree],
) -> RootSearch:
    """Grow a small tree from each of several places spread over the surface.

    Parameters
    ----------
    tissue : Tissue
    options : GrowthOptions
        ``root_candidates`` places are tried, spread by farthest-point sampling.
    grow : function
        Grows one tree.

    Raises
    ------
    GrowthError
        When no candidate grew a tree; with what stopped the first.
    """
    points, directions = spread_over_surface(tissue, options.root_candidates, options.seed)
    probe = _probe(options)
    cost = np.full(len(points), np.inf)
    first: DesignError | None = None
    for n, (point, way) in enumerate(zip(points, directions, strict=True)):
        x, y, z = point.tolist()
        dx, dy, dz = way.tolist()
        try:
            tree = grow(
                tissue, replace(probe, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
            )
        except DesignError as error:
            first = first or error
            continue
        cost[n] = tree_cost(tree, options)
    if not np.isfinite(cost).any():
        raise GrowthError(
            f"none of {len(points)} places searched for a root grew a tree; at the first: {first}"
        ) from first
    return RootSearch(points, directions, cost, int(np.argmin(cost)))


def _probe(options: GrowthOptions) -> GrowthOptions:
    """The options of the small trees."""
    few = min(options.terminals, PROBE_TERMINALS)
    plain = replace(options, root_candidates=0, stages=())
    if options.terminal_points_mm is None:
        return replace(plain, terminals=few)
    chosen = np.linspace(0, options.terminals - 1, few).astype(np.int64)
    flows = options.terminal_flows
    return replace(
        plain,
        terminal_points_mm=np.array(options.terminal_points_mm)[chosen],
        terminal_flows=None if flows is None else np.array(flows)[chosen],
    )


def tree_cost(tree: VesselTree, options: GrowthOptions) -> float:
    """Σ ℓᵘ r^λ over all segments; mm to the power of u + λ."""
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    return float(length**options.length_exponent @ tree_radii(tree) ** options.radius_exponent)


def spread_over_surface(tissue: Tissue, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Points spread over the surface, and inward normals there, (count, 3) each.

    Of points sampled by area, in turn the one farthest from those chosen (Gonzalez 1985, doi
    10.1016/0304-3975(85)90224-5), beginning at the highest.
    """
    random = np.random.default_rng([seed, 0x5EA3])
    points, normals = surface_points(tissue, _SAMPLES, random)
    chosen = [int(np.argmax(points[:, 2]))]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, _SAMPLES):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen], normals[chosen]
