"""Cut horizontal sections of a solid at mid-layer heights, with lumens kept at full width.

A line's round side touches a slanted wall above or below its crest, so the section at mid-layer
alone lets it stand into the lumen, by r (1 - cos φ) for a side of radius r and a wall φ off the
upright. The crest must keep r (1/cos φ - 1) away from the wall at mid-layer. That is, to 3 µm up
to 80° at r = 30 µm, the greater of 0 and 0.8 r tan φ - 0.4 r.

Seven tenths of that are kept: the lumen is united with its sections 0.56 r above and below, each
made smaller by 0.28 r. All of it leaves the widest free circle as designed, but floors and ceilings
of lying lumens 0.4 layers too high, and lumens of the example planar_fresh 13 to 25 µm wide of the
design as scanned; without any they are 9 µm narrow to 7 µm wide, so they are 5 to 16 µm wide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from manifold3d import CrossSection, Error, JoinType, Manifold, Mesh, OpType

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.solids.solid import Solid
from design.toolpath.fresh.options import Adaptive, Compensation, Filling, FreshOptions
from kernels.arrays import FloatArray, IntArray


class _Slicing(NamedTuple):
    """How sections are cut."""

    # Vertices nearer than this to the line through their neighbours are dropped: triangulated
    # straight walls are cut into many collinear pieces.
    collinear_mm: float = 1e-4
    section_mm: float = 5e-4  # the same of sections: no motor step of 12.5 µm could tell them apart
    beside: float = 0.28  # sections beside the one at mid-layer, in layer heights: 0.56 r
    # Half the width of gaps that are closed between bodies of one part: where two surfaces that
    # should meet were made into triangles apart.
    closing_mm: float = 5e-3
    level: float = 0.9995  # |n_z| above which faces are floors or ceilings: within 2° of level
    floor_mm2: float = 0.01  # smaller level faces end no layer

    @property
    def behind(self) -> float:
        """By how much the sections beside are smaller, over what a bead exceeds its rectangle."""
        return self.beside / (1 - np.pi / 4)


SLICING: Final = _Slicing()


class Body:
    """One or more closed bodies that are cut as one.

    Parameters
    ----------
    solids : sequence of Solid
        Where there are several, gaps between them up to 2 `SLICING.closing_mm` wide are closed.

    Raises
    ------
    ToolpathError
        When one isn't a closed manifold.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        several = len(solids) > 1
        self._bodies = [
            manifold_of(solid, f"solid {k + 1}" if several else "solid")
            for k, solid in enumerate(solids)
        ]
        self.low_mm = min(float(solid.bounds[0, 2]) for solid in solids)
        self.high_mm = max(float(solid.bounds[1, 2]) for solid in solids)

    @cached_property
    def _united(self) -> list[Manifold]:
        return [_united(body) for body in self._bodies]

    @property
    def volume_ul(self) -> float:
        """Volume of the bodies, µL; where they overlap, once."""
        if len(self._united) == 1:
            return self._united[0].volume()
        return Manifold.batch_boolean(self._united, OpType.Add).volume()

    @property
    def overlap_ul(self) -> float:
        """Volume that shells of one body have in common, µL; of three alike, two."""
        pairs = zip(self._bodies, self._united, strict=True)
        return sum(max(body.volume() - union.volume(), 0.0) for body, union in pairs)

    def slice(self, z_mm: float) -> CrossSection:
        """Section at a height."""
        if len(self._bodies) == 1:
            return self._bodies[0].slice(z_mm)
        cuts = [body.slice(z_mm) for body in self._bodies]
        whole = CrossSection.batch_boolean(cuts, OpType.Add)
        closed = whole.offset(SLICING.closing_mm, JoinType.Miter, 2.0)
        return whole + closed.offset(-SLICING.closing_mm, JoinType.Miter, 2.0)


def _united(body: Manifold) -> Manifold:
    """Return a body whose shells overlap or stand twice as its sections have it: each place once.

    A cavity is cut out of the smallest shell that holds all of it.
    """
    shells = sorted(body.decompose(), key=Manifold.volume)
    solids = [shell for shell in shells if shell.volume() > 0]
    boxes = np.array([shell.bounding_box() for shell in solids]).reshape(-1, 2, 3)
    meet = (boxes[:, None, 0] < boxes[None, :, 1]).all(axis=2)
    if np.count_nonzero(meet & meet.T) == len(solids):
        return body
    for cavity in shells[: len(shells) - len(solids)]:
        mesh = cavity.to_mesh()
        faces = np.array(mesh.tri_verts[:, ::-1], np.uint32, order="C")
        hole = Manifold(Mesh(np.array(mesh.vert_properties, np.float32, order="C"), faces))
        for k, solid in enumerate(solids):
            if (solid ^ hole).volume() > 0.99 * hole.volume():
                solids[k] = solid - hole
                break
    return Manifold.batch_boolean(solids, OpType.Add)


@dataclass(frozen=True)
class Layer:
    """One layer of the part."""

    index: int  # 0 for the lowest
    tip_mm: float  # mm, the needle's tip while the layer is written: the layer's top
    material: CrossSection  # section at the middle of the layer
    # The same without what lines would stand in lumens with, above or below their crests
    carved: CrossSection
    middle_mm: float  # mm, height of that section
    height_mm: float  # mm, of the layer


def layers(body: Body, levels: FloatArray, inset_mm: Callable[[float], float]) -> Iterator[Layer]:
    """Yield the layers from the lowest up; a layer without material is left out.

    Parameters
    ----------
    body : Body
    levels : (n + 1,) float64, mm
        Borders of the layers, ascending.
    inset_mm : callable
        By how much half a line's bead is wider than half its rectangle, of a layer's height.
    """
    for index, (low, high) in enumerate(pairwise(levels.tolist())):
        middle, height = 0.5 * (low + high), round(high - low, 9)
        material = body.slice(middle).simplify(SLICING.section_mm)
        if not material.is_empty():
            carved = _carved(body, material, middle, height, inset_mm(height))
            yield Layer(index, high, material, carved, middle, height)


def _carved(
    body: Body, material: CrossSection, middle: float, height: float, inset: float
) -> CrossSection:
    """The material without the lumens' sections above and below; see the module."""
    for side in (-SLICING.beside, SLICING.beside):
        hollow = _hollow(body.slice(middle + side * height))
        if not hollow.is_empty():
            material = material - hollow.offset(-SLICING.behind * inset, JoinType.Miter, 2.0)
    return material.simplify(SLICING.section_mm)


def _hollow(section: CrossSection) -> CrossSection:
    """Lumens of a section, those that open to the outside too: its pieces' hulls without it."""
    pieces = section.decompose()
    if all(piece.num_contour() == 1 and _is_convex(piece) for piece in pieces):
        return CrossSection()
    return CrossSection.batch_boolean([piece.hull() for piece in pieces], OpType.Add) - section


def _is_convex(piece: CrossSection) -> bool:
    return piece.hull().area() - piece.area() < SLICING.collinear_mm**2


def rings(section: CrossSection) -> list[FloatArray]:
    """Closed contours, each (k, 2) mm without a repeated last point; holes run clockwise."""
    return [np.asarray(ring, dtype=np.float64) for ring in section.to_polygons() if len(ring) > 2]


def manifold_of(solid: Solid, what: str) -> Manifold:
    """Hand a solid to manifold3d.

    Raises
    ------
    ToolpathError
        When ``what`` isn't a closed manifold.
    """
    body = Manifold(Mesh(solid.vertices.astype(np.float32), solid.faces.astype(np.uint32)))
    if body.status() != Error.NoError or body.is_empty():
        raise ToolpathError(
            f"{what} can't be sliced: its mesh isn't a closed manifold ({body.status().name}); "
            "mend it before slicing"
        )
    return body


def check_lumens(network: VesselNetwork, options: FreshOptions) -> None:
    """Check every vessel of ``network`` against the smallest lumen the options leave open.

    Raises
    ------
    ToolpathError
        With the narrowest vessel, its diameter, the limit and the remedy.
    """
    narrowest = np.minimum.reduceat(network.radius, network.offset[:-1]) * 2
    limit = options.smallest_lumen_mm
    closed = np.flatnonzero(narrowest < limit * (1 - 1e-9))
    if len(closed):
        vessel = int(closed[np.argmin(narrowest[closed])])
        raise ToolpathError(
            f"vessel {vessel}: lumen of {narrowest[vessel]:.3f} mm is narrower than "
            f"{limit:.3f} mm, which lines of {options.line_width_mm:g} mm in layers of "
            f"{options.layer_height_mm:g} mm leave open ({len(closed)} such vessels); "
            "use a finer needle and thinner layers, or fix a larger smallest lumen in the design"
        )


@dataclass(frozen=True)
class Region:
    """A body inside which the part is filled in another way, or written by another head.

    Without a head walls go on through it: they follow the part's own boundary. What a head writes
    is a section of its own, with walls on both sides of the border: their edges meet there.

    Attributes
    ----------
    solid : Solid
        In the part's frame; where it reaches out of the part nothing is written.
    filling : Filling
    head : int or None
        Which head writes here; None leaves that to the regions before, and head 0 without any.
    """

    solid: Solid
    filling: Filling
    head: int | None = None


@dataclass(frozen=True)
class RegionSections:
    """Regions at one height; where several overlap, the last counts."""

    # As they were given.
    regions: tuple[tuple[CrossSection, Region], ...]

    def shares(
        self, inside: CrossSection, filling: Filling
    ) -> Iterator[tuple[CrossSection, Filling]]:
        """Part ``inside`` among the regions' fillings; the rest has ``filling``."""
        for section, region in reversed(self.regions):
            share = inside ^ section
            if not share.is_empty():
                yield share, region.filling
                inside = inside - section
        yield inside, filling

    def sections(self, material: CrossSection) -> dict[int, CrossSection]:
        """What each head writes of ``material``, those without any left out."""
        by_head: dict[int, CrossSection] = {}
        for section, region in reversed(self.regions):
            if region.head is None:
                continue
            share = material ^ section
            if not share.is_empty():
                before = by_head.get(region.head)
                by_head[region.head] = share if before is None else before + share
                material = material - section
        if not material.is_empty():
            by_head[0] = material if 0 not in by_head else by_head[0] + material
        return by_head


class Regions:
    """Regions as they are written, ready to be cut level by level.

    Parameters
    ----------
    regions : sequence of Region
        Where several overlap, the last counts.
    compensation : Compensation
        The part's own: they grow with it.

    Raises
    ------
    ToolpathError
        When a region isn't a closed manifold.
    """

    def __init__(self, regions: Sequence[Region], compensation: Compensation) -> None:
        self._bodies: list[tuple[Manifold, Region]] = [
            (manifold_of(compensation.enlarged(region.solid), f"region {number}"), region)
            for number, region in enumerate(regions)
        ]

    def at(self, z_mm: float) -> RegionSections:
        """The regions' sections at a height."""
        return RegionSections(tuple((body.slice(z_mm), region) for body, region in self._bodies))


def even_levels(low_mm: float, high_mm: float, layer_height_mm: float) -> FloatArray:
    """Borders of layers all alike, (n + 1,), mm: as many as come nearest to the part's height.

    A slanted wall becomes a stair. Measured across the wall a stair of layers h high is h |n_z|
    deep, n_z the vertical part of the wall's unit normal (Dolenc and Mäkelä 1994, "Slicing
    procedures for layered manufacturing techniques", doi:10.1016/0010-4485(94)90032-9, eq. 4). So
    upright walls take layers of any height, and the floors and ceilings of lumens the thinnest.
    Level faces make no stair but an error of height, so a layer ends at each of them.
    """
    count = int(np.floor((high_mm - low_mm) / layer_height_mm + 0.5 - 1e-6))
    return np.asarray(low_mm + np.arange(max(count, 0) + 1) * layer_height_mm)


def adaptive_levels(
    solids: Sequence[Solid], layer_height_mm: float, adaptive: Adaptive
) -> FloatArray:
    """Borders of layers no higher than the slopes beside them bear, (n + 1,), mm.

    Each layer is as high as it may be, and no lower than the thinnest; a layer ends at each level
    face, for which the last ones before it may be one step higher.

    Raises
    ------
    ToolpathError
        When the thinnest layer isn't thinner than the others, or no whole step.
    """
    step = adaptive.step_mm
    most = int(np.floor(layer_height_mm / step + 1e-6))
    least = int(np.ceil(adaptive.thinnest_mm / step - 1e-6))
    if not 1 <= least < most:
        raise ToolpathError(
            f"thinnest layer is {1e3 * adaptive.thinnest_mm:g} µm, others {1e3 * layer_height_mm:g}"
            f" µm, in steps of {1e3 * step:g} µm (adaptive layers); the thinnest must be at least "
            "a step lower: give a lower one or higher layers"
        )
    low = min(float(solid.bounds[0, 2]) for solid in solids)
    high = max(float(solid.bounds[1, 2]) for solid in solids)
    count = int(np.rint((high - low) / step))
    allowed, floors = _slopes(solids, low, count, (least, most), adaptive)
    borders = [0]
    for end in _ends(floors, count, least):
        heights = _filled(borders[-1], end, allowed, least)
        borders += np.cumsum([borders[-1], *heights])[1:].tolist()
    return low + step * np.array(borders)


def _slopes(
    solids: Sequence[Solid], low: float, count: int, span: tuple[int, int], adaptive: Adaptive
) -> tuple[IntArray, IntArray]:
    """Highest layer that each step of height bears, (count,), and level faces, in steps."""
    least, most = span
    allowed = np.full(count, most)
    layers = []
    for solid in solids:
        corners = solid.vertices[solid.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(normal, axis=1)
        slope = np.abs(normal[:, 2]) / np.maximum(twice, 1e-300)
        heights = (corners[:, :, 2] - low) / adaptive.step_mm
        first = np.clip(np.floor(heights.min(axis=1) + 1e-6), 0, count).astype(np.int64)
        last = np.clip(np.ceil(heights.max(axis=1) - 1e-6), 0, count).astype(np.int64)
        level = slope > SLICING.level
        layers.append(_floors(np.rint(heights.mean(axis=1))[level], twice[level] / 2))
        with np.errstate(divide="ignore"):
            bears = np.floor(adaptive.stair_mm / slope / adaptive.step_mm + 1e-6)
        bears = np.clip(bears, least, most)
        for value in np.unique(bears[~level & (bears < most)]):
            rows = ~level & (bears == value)
            ends = np.bincount(first[rows], minlength=count + 1)
            ends -= np.bincount(last[rows], minlength=count + 1)
            here = np.cumsum(ends)[:count] > 0
            allowed[here] = np.minimum(allowed[here], int(value))
    return allowed, np.unique(np.concatenate(layers))


def _floors(height: FloatArray, area: FloatArray) -> IntArray:
    """Heights, in steps, that level faces of enough area stand at."""
    at, which = np.unique(height.astype(np.int64), return_inverse=True)
    return at[np.bincount(which, weights=area, minlength=len(at)) >= SLICING.floor_mm2]


def _ends(floors: IntArray, count: int, least: int) -> list[int]:
    """Where a layer ends, ascending, none nearer to the next than the thinnest layer."""
    ends: list[int] = []
    for at in floors.tolist():
        if at - (ends[-1] if ends else 0) >= least and count - at >= least:
            ends.append(at)
    return [*ends, count]


def _filled(at: int, end: int, allowed: IntArray, least: int) -> list[int]:
    """Heights of the layers from a step to another, all of them of steps."""
    heights: list[int] = []
    while at < end:
        heights.append(min(_highest(allowed[at:end], least), end - at))
        at += heights[-1]
    return _shared(heights, least)


def _shared(heights: list[int], least: int) -> list[int]:
    """The same without a last layer that is too thin.

    Those before it give what it lacks, the nearest first. Where none is thicker than the thinnest,
    its steps are shared among them.
    """
    *before, last = heights
    if last >= least or not before:
        return heights
    if sum(before) + last >= len(heights) * least:
        for k in reversed(range(len(before))):
            given = min(least - last, before[k] - least)
            before[k], last = before[k] - given, last + given
        return [*before, last]
    for k in range(last):
        before[-1 - k % len(before)] += 1
    return before


def _highest(allowed: IntArray, least: int) -> int:
    """Highest layer that all steps of height in it bear."""
    bears = np.minimum.accumulate(allowed) >= np.arange(1, len(allowed) + 1)
    return max(int(np.argmin(bears)) if not bears.all() else len(allowed), least)
