"""Find a tissue's unconnected parts, the part of each point, and each part's demand share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry import build_triangle_tree
from design.geometry.surface import Surface
from design.tissue.closed import FaceArray, enclosed_volume
from design.tissue.demand import UNIFORM, Demand
from design.tissue.grid import enclosed
from design.tissue.shells import enclosures, shells_of
from design.tissue.spacing import SpacingRule
from design.tissue.surface import SizeLimits, tissue_from_surface
from design.tissue.tissue import Tissue
from kernels.arrays import FloatArray

_TRIED = 20_000
"""Points drawn in a part's bounds when its mean demand is measured."""

_LEAST_BRICKS = 300
_LEAST_WEIGHT = 1e-12
_ANY_SIZE = SizeLimits(0.0, float("inf"))


@dataclass(frozen=True)
class Part:
    """A piece of a tissue that doesn't hang together with the rest.

    Attributes
    ----------
    faces : (m, 3) int32
        Of the tissue's vertices: its outer shell and its cavities.
    volume_mm3 : float
        Without its cavities and what lies in them.
    middle_mm : (3,) float64
        Of its bounds.
    """

    faces: FaceArray
    volume_mm3: float
    middle_mm: FloatArray

    def __str__(self) -> str:
        """Size and place, for messages."""
        x, y, z = self.middle_mm
        return f"the part of {self.volume_mm3:.3g} mm³ around ({x:.4g}, {y:.4g}, {z:.4g}) mm"


def parts_of(tissue: Tissue) -> tuple[Part, ...]:
    """The separate parts of a tissue, the largest first; parts that touch in a point are two.

    Raises
    ------
    TissueError
        When the surface has more than 2,000 shells.
    """
    return surface_parts(tissue.surface.vertices, tissue.surface.faces)


def surface_parts(points: FloatArray, faces: FaceArray) -> tuple[Part, ...]:
    """The same of a closed surface, by its vertices (n, 3), mm, and faces (m, 3)."""
    shell = shells_of(points, faces)
    count = int(shell.max()) + 1
    signed = np.array([enclosed_volume(points, faces[shell == n]) for n in range(count)])
    solid = np.flatnonzero(signed > 0)
    owner = np.arange(count)
    if len(solid) == 1:
        owner[:] = solid[0]
    else:
        holds = enclosures(points, faces, shell)
        for cavity in np.flatnonzero(signed <= 0):
            around = solid[holds[solid, cavity]]
            if len(around):
                owner[cavity] = around[np.argmin(signed[around])]
    volume = np.bincount(owner, weights=signed, minlength=count)
    order = solid[np.argsort(-volume[solid], kind="stable")]
    return tuple(_part(points, faces[owner[shell] == n], float(volume[n])) for n in order)


def without_cavities(surface: Surface) -> Surface:
    """The surface without the walls of closed cavities; as it is where it has none."""
    points, faces = surface.vertices, surface.faces
    shell = shells_of(points, faces)
    signed = [enclosed_volume(points, faces[shell == n]) for n in range(int(shell.max()) + 1)]
    outer = np.array(signed)[shell] > 0
    return surface if outer.all() else replace(surface, faces=np.ascontiguousarray(faces[outer]))


def _part(points: FloatArray, faces: FaceArray, volume_mm3: float) -> Part:
    corners = points[np.unique(faces)]
    middle: FloatArray = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return Part(np.ascontiguousarray(faces), volume_mm3, middle)


def part_numbers(tissue: Tissue, parts: Sequence[Part], points: FloatArray) -> NDArray[np.int64]:
    """Number of the part that each of ``points`` (n, 3), mm, lies in; -1 for none."""
    number, points = np.full(len(points), -1), np.ascontiguousarray(points)
    if len(parts) == 1:
        number[tissue.contains(points)] = 0
        return number
    for n, part in enumerate(parts):
        number[enclosed(build_triangle_tree(tissue.surface.vertices, part.faces), points)] = n
    return number


def part_tissue(tissue: Tissue, part: Part) -> Tissue:
    """A part as a tissue of its own, in the same place and with the same demand.

    Raises
    ------
    TissueError
        As `tissue_from_surface`, naming the part.
    """
    surface = tissue.surface
    rule = SpacingRule()
    share = part.volume_mm3 / tissue.volume_mm3
    rule = replace(rule, bricks=max(_LEAST_BRICKS, ceil(rule.bricks * share ** (2 / 3))))
    try:
        own = tissue_from_surface(surface.vertices, part.faces, limits=_ANY_SIZE, rule=rule)
    except TissueError as error:
        raise TissueError(f"{part} can't be prepared: {error}") from error
    if tissue.demand == UNIFORM:
        return own
    mean = max(_mean_weight(tissue, part), _LEAST_WEIGHT)
    return replace(own, demand=PartDemand(tissue.demand, mean))


@dataclass(frozen=True)
class PartDemand:
    """The demand of a whole tissue, seen from one of its parts."""

    whole: Demand
    mean_weight: float

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`."""
        return self.whole.weight(points)


def part_demands(tissue: Tissue, parts: Sequence[Part]) -> FloatArray:
    """Share of the tissue's demand in each part, (p,): by volume where the demand is uniform."""
    asked = np.array([part.volume_mm3 for part in parts])
    if tissue.demand != UNIFORM:
        asked = asked * [_mean_weight(tissue, part) for part in parts]
    shares: FloatArray = asked / asked.sum()
    return shares


def _mean_weight(tissue: Tissue, part: Part) -> float:
    """Mean of the demand's weight over a part."""
    points, tree = tissue.surface.vertices, build_triangle_tree(tissue.surface.vertices, part.faces)
    corners = points[np.unique(part.faces)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    tried = low + np.random.default_rng(0).random((_TRIED, 3)) * (high - low)
    tried = tried[enclosed(tree, tried)]
    return float(tissue.demand.weight(tried).mean()) if len(tried) else 1.0
