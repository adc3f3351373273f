"""Find the root on a tissue's surface of least tree cost, by growing small trial trees.

Find surface points with the deepest tissue below, as roots of trees with wide vessels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from design.errors import DesignError, GrowthError, NoRoomError, RootError
from design.tissue import Tissue
from design.vasculature.growth.mouths import MOUTHS, face_room
from design.vasculature.growth.root import rooted_at
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray


class RootSettings(NamedTuple):
    """Samples by which a root is searched for."""

    probe_terminals: int = 200
    """Of the small tree grown from each candidate, at most."""
    spread_samples: int = 4000
    depth_samples: int = 2000
    """Points on the surface from which candidates are taken that are spread, or lie deep."""
    depth_steps: int = 40
    """Along each inward normal, to 2.5 times the tissue's largest depth."""
    separation: float = 0.1
    """Least distance of two deep places, over the diagonal of the tissue's bounds."""


ROOT = RootSettings()


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
    reach_mm: float,
) -> RootSearch:
    """Grow a small tree from each of several places spread over the surface.

    Parameters
    ----------
    tissue : Tissue
    options : GrowthOptions
        ``root_candidates`` places are tried, spread by farthest-point sampling.
    grow : function
        Grows one tree.
    reach_mm : float
        Of the trunk's radius and wall; places nearer to an edge are left out.

    Raises
    ------
    GrowthError
        When no candidate grew a tree; with what stopped the first.
    """
    points, directions = spread_over_surface(
        tissue, options.root_candidates, options.seed, reach_mm
    )
    probe = _probe(options)
    cost = np.full(len(points), np.inf)
    first: DesignError | None = None
    for n, (point, way) in enumerate(zip(points, directions, strict=True)):
        try:
            tree = grow(tissue, rooted_at(probe, point, way))
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
    few = min(options.terminals, ROOT.probe_terminals)
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


def spread_over_surface(
    tissue: Tissue, count: int, seed: int, reach_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Points spread over the surface, and inward normals there, (count, 3) each.

    Points nearer to an edge than ``reach_mm`` are left out, unless all are.

    Of points sampled by area, in turn the one farthest from those chosen (Gonzalez 1985, doi
    10.1016/0304-3975(85)90224-5), beginning at the highest.
    """
    random = np.random.default_rng([seed, 0x5EA3])
    points, normals = _inside_faces(
        tissue, *surface_points(tissue, ROOT.spread_samples, random), reach_mm
    )
    chosen = [int(np.argmax(points[:, 2]))]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen], normals[chosen]


def _inside_faces(
    tissue: Tissue, points: FloatArray, inward: FloatArray, reach_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Those of points on the surface that are ``reach_mm`` from every edge; else all."""
    room = face_room(tissue, points, -inward, reach_mm, MOUTHS.face_degrees[-1])
    inside = room >= reach_mm
    return (points[inside], inward[inside]) if inside.any() else (points, inward)


def deep_roots(
    tissue: Tissue,
    count: int,
    seed: int,
    separation: float = ROOT.separation,
    reach_mm: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Places on the surface below which the tissue is deepest, deepest first.

    A root is as wide as Murray's law makes it, and so are its first branches: a printable tree
    grows as far as they find room. Points are sampled on the surface by area; below each, the
    depth is followed along the inward normal until the line leaves the tissue.

    Parameters
    ----------
    tissue : Tissue
    count : int
        How many at most.
    seed : int
    separation : float
        Least distance of any two, over the diagonal of the tissue's bounds.
    reach_mm : float
        Places nearer to an edge are left out, unless all are.

    Returns
    -------
    points, directions : (k, 3) float64
        mm, and inward unit normals.
    """
    points, normals = surface_points(
        tissue, ROOT.depth_samples, np.random.default_rng([seed, 0xDEEB])
    )
    points, normals = _inside_faces(tissue, points, normals, reach_mm)
    reach = 2.5 * tissue.grid.deepest_mm
    along = np.linspace(0.0, reach, ROOT.depth_steps + 1)[1:]
    line = points[:, None] + along[None, :, None] * normals[:, None]
    depth = -tissue.grid.distance(line.reshape(-1, 3)).reshape(line.shape[:2])
    stays = np.logical_and.accumulate(depth > 0, axis=1)
    deepest = np.where(stays, depth, 0.0).max(axis=1)
    least = separation * float(np.linalg.norm(np.ptp(tissue.bounds, axis=0)))
    chosen: list[int] = []
    for n in np.argsort(-deepest, kind="stable"):
        away = np.linalg.norm(points[chosen] - points[n], axis=1)
        if deepest[n] > 0 and (away >= least).all():
            chosen.append(int(n))
        if len(chosen) == count:
            break
    return points[chosen], normals[chosen]


def surface_points(
    tissue: Tissue, count: int, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Points (count, 3), mm, uniform over the surface, and the inward unit normals there.

    Uniform in a triangle: Osada et al. 2002, doi 10.1145/571647.571648, equation 1.
    """
    corner = tissue.surface.vertices[tissue.surface.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(across, axis=1)
    face = random.choice(len(size), count, p=size / size.sum())
    u, v = np.sqrt(random.uniform(size=count)), random.uniform(size=count)
    mix = np.column_stack([1.0 - u, u * (1.0 - v), u * v])
    points: FloatArray = np.einsum("nk,nkx->nx", mix, corner[face])
    normals: FloatArray = -across[face] / size[face, None]
    return points, normals


def grow_from_deep_root(
    tissue: Tissue,
    options: GrowthOptions,
    count: int,
    why: RootError | NoRoomError,
    grow: Callable[[Tissue, GrowthOptions], VesselTree],
    reach_mm: float,
) -> VesselTree:
    """Grow from one of ``count`` deep places, after the default root failed by ``why``.

    Raises
    ------
    RootError, NoRoomError
        When none of the places holds the tree: of the root that placed most terminals.
    """
    place = "at the highest point" if options.root_at_top else "in the face on top"
    trouble = f"no trunk fits {place}"
    if isinstance(why, NoRoomError):
        trouble = f"from a root {place} only {why.placed} terminals fit"
    roots = deep_roots(tissue, count, options.seed, reach_mm=reach_mm)
    for point, way in zip(*roots, strict=True):
        try:
            tree = grow(tissue, rooted_at(options, point, way))
        except (RootError, NoRoomError) as error:
            why = max(why, error, key=lambda one: one.placed)
            continue
        note = (
            "{}, so the root was put at ({:.4g}, {:.4g}, {:.4g}) mm, where the tissue is "
            "deep".format(trouble, *point)
        )
        return replace(tree, notes=(note, *tree.notes))
    raise why
