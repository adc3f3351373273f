"""Find lumens of a part without a network: holes of its horizontal sections, layer by layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from design.solids import Solid
from design.solids.manifolds import solid_manifold
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.layer_spaces import Pixels, label_pieces, label_ring
from printctl.checks.lumens.leaks import DesignedLumens, Grid, margin_mm, mouth_pieces
from printctl.checks.lumens.lines import WrittenLines
from printctl.checks.lumens.stations import BEYOND, BEYOND_MM, SectionStations
from printctl.checks.lumens.width_kernels import widest_in_polygon
from printctl.errors import UsageError

LEAST_AREA_MM2: Final = 1e-4
"""Of a region of a section, or of two sections' overlap, that counts."""


def unfollowed_ways(sections: Sequence[Sequence[NDArray[np.float64]]]) -> int:
    """Handles that are left in a part once every hole of its sections is filled.

    A lumen that lies level and is open at both ends parts the sections instead of leaving a hole in
    them. The part is taken as a stack of slabs, each the section filled; by its Euler
    characteristic, regions less overlaps of neighbouring sections, it has ``pieces - χ`` handles.

    Parameters
    ----------
    sections : sequence of sequences of (n, 2) float64, mm
        Rings of each section from the lowest up: outlines anticlockwise, holes clockwise.
    """
    layers = [_regions(rings) for rings in sections]
    first = np.cumsum([0, *(len(regions) for regions in layers)])
    pairs, overlaps, rings = [], 0, 0
    for k, (lower, upper) in enumerate(pairwise(layers)):
        over, under = shapely.STRtree(lower).query(upper, predicate="intersects")
        met = shapely.intersection(np.array(upper)[over], np.array(lower)[under])
        for above, below, shape in zip(over.tolist(), under.tolist(), met, strict=True):
            parts = _wide(shape)
            overlaps += len(parts)
            rings += sum(len(part.interiors) for part in parts)
            if parts:
                pairs.append((first[k] + below, first[k + 1] + above))
    count = int(first[-1])
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends)), ends.T), shape=(count, count))
    pieces = connected_components(graph, directed=False)[0] if count else 0
    return max(0, pieces - (count - (overlaps - rings)))


def _regions(rings: Sequence[NDArray[np.float64]]) -> list[BaseGeometry]:
    """The outer regions of a section, holes filled; what stands within a hole is in them."""
    filled = [shapely.Polygon(ring) for ring in rings if signed_area(ring) > LEAST_AREA_MM2]
    return _wide(shapely.union_all(shapely.make_valid(np.array(filled)))) if filled else []


def _wide(shape: BaseGeometry) -> list[BaseGeometry]:
    parts = shapely.get_parts(shape)
    polygons = parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]
    return list(polygons[shapely.area(polygons) > LEAST_AREA_MM2])


def signed_area(corner: NDArray[np.float64]) -> float:
    """Area within a ring (n, 2), negative where it runs clockwise."""
    x, y = corner.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


CIRCLE_MM: Final = 2e-4


@dataclass(frozen=True)
class _Hole:
    """One hole of one section, in the part's frame."""

    layer: int
    ring: FloatArray
    centre: FloatArray
    inscribed: float
    area: float


def model_lumens(
    solid: Solid, lines: WrittenLines, place_mm: FloatArray
) -> tuple[SectionStations, DesignedLumens, int]:
    """A station for each hole of the part at the middle of each written layer.

    Holes that overlap from one layer to the next are one lumen as long as each has one partner;
    where a lumen forks, others begin. Lumens that lie in the layers show as slots while they are
    closed all round; where they are open to the side they aren't seen. The last value counts ways
    through the part that aren't (`unfollowed_ways`).

    Raises
    ------
    UsageError
        When no section has a hole.
    """
    body = solid_manifold(solid, "the part")
    middle = (lines.low + lines.high) / 2 - place_mm[2]
    sections = [_section(body, float(z)) for z in middle]
    holes = [hole for k, rings in enumerate(sections) for hole in _holes(rings, k)]
    if not holes:
        raise UsageError(
            "no level section of the part has a hole, so it has no lumen to measure; lumens that "
            "lie level need --network"
        )
    lumen, tree = _follow(holes, len(middle))
    order = np.argsort(lumen, kind="stable")
    stations = _stations([holes[k] for k in order], lumen[order], lines, place_mm)
    trees = _trees(holes, lumen, tree, stations, lines, place_mm)
    return stations, trees, unfollowed_ways(sections)


def _section(body: Manifold, z: float) -> list[FloatArray]:
    return [np.asarray(ring, dtype=np.float64) for ring in body.slice(z).to_polygons()]


def _holes(rings: list[FloatArray], layer: int) -> list[_Hole]:
    holes = []
    for corner in rings:
        area = signed_area(corner)
        if area > -LEAST_AREA_MM2:
            continue
        centre = corner.mean(axis=0)
        reach = float(np.abs(corner - centre).max())
        local = np.ascontiguousarray(corner - centre)
        x, y, radius = widest_in_polygon(local, 0.0, 0.0, reach, CIRCLE_MM)
        holes.append(_Hole(layer, corner, centre + [x, y], radius, -area))
    return holes


def _follow(holes: list[_Hole], layers: int) -> tuple[IntArray, IntArray]:
    """Number of the lumen of each hole, (n,), and of the tree of each lumen."""
    of = np.array([hole.layer for hole in holes])
    first = np.searchsorted(of, np.arange(layers + 1))
    shapes = shapely.polygons([shapely.linearrings(hole.ring) for hole in holes])
    lumen = np.full(len(holes), -1, dtype=np.int64)
    joined: list[IntArray] = []
    count = 0
    for k in range(layers):
        below = np.arange(first[k - 1], first[k]) if k else np.empty(0, dtype=np.int64)
        here = np.arange(first[k], first[k + 1])
        up, down = shapely.STRtree(shapes[below]).query(shapes[here], predicate="intersects")
        alone = (np.bincount(up, minlength=len(here))[up] == 1) & (
            np.bincount(down, minlength=len(below))[down] == 1
        )
        lumen[here[up[alone]]] = lumen[below[down[alone]]]
        new = here[lumen[here] < 0]
        lumen[new] = count + np.arange(len(new))
        count += len(new)
        joined.append(np.column_stack([lumen[here[up]], lumen[below[down]]]))
    pair = np.concatenate(joined)
    graph = coo_matrix((np.ones(len(pair)), pair.T), shape=(count, count))
    return lumen, connected_components(graph, directed=False)[1].astype(np.int64)


def _trees(
    holes: list[_Hole],
    lumen: IntArray,
    tree: IntArray,
    stations: SectionStations,
    lines: WrittenLines,
    place: FloatArray,
) -> DesignedLumens:
    """Lumens that fork into one another are a tree; each may open at its ends."""
    margin = margin_mm(lines)
    first = np.searchsorted(np.array([hole.layer for hole in holes]), np.arange(len(lines.low) + 1))
    middle = (lines.low + lines.high) / 2
    ends = np.concatenate([stations.first[:-1], stations.first[1:] - 1])
    reach = np.hypot(stations.window[ends] + 2 * margin, (lines.high - lines.low).max())
    ball = mouth_pieces(stations.axis[ends], reach)

    def label(layer: int, grid: Grid, pixels: Pixels) -> None:
        corner = (grid.left, grid.bottom, grid.pixel)
        z = float(middle[layer])
        near = np.flatnonzero(np.abs(ball[:, 2] - z) <= reach + margin).astype(np.int64)
        label_pieces(ball, near, z, margin, *corner, pixels)
        for k in range(first[layer], first[layer + 1]):
            label_ring(holes[k].ring + place[:2], len(ball) + k, margin, *corner, pixels)

    group = np.concatenate([tree[stations.lumen[ends]], tree[lumen]])
    names = tuple(str(k) for k in range(int(tree.max()) + 1))
    return DesignedLumens(label, group, names, stations.axis[ends], reach)


def _stations(
    holes: list[_Hole], lumen: IntArray, lines: WrittenLines, place: FloatArray
) -> SectionStations:
    layer = np.array([hole.layer for hole in holes])
    flat = np.array([hole.centre for hole in holes])
    height = ((lines.low + lines.high) / 2)[layer]
    axis = np.column_stack([flat + place[:2], height])
    thick = (lines.high - lines.low)[layer]
    inscribed = np.array([hole.inscribed for hole in holes])
    radius = np.sqrt(np.array([hole.area for hole in holes]) / np.pi)
    far = np.array([np.linalg.norm(h.ring - h.centre, axis=1).max() for h in holes])
    up = np.zeros_like(axis)
    up[:, 2] = 1.0
    return SectionStations(
        lumen=lumen,
        axis=axis,
        along=up,
        designed_mm=2 * inscribed,
        radius=radius,
        window=far,
        limit=BEYOND * far + BEYOND_MM,
        step_mm=thick,
        own=np.ones(len(lumen), dtype=np.bool_),
        names=tuple(str(k) for k in range(int(lumen.max()) + 1)),
    )
