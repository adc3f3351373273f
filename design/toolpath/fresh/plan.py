"""Slice a solid into FRESH layers: from sections, walls and infill to a toolpath and report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from manifold3d import CrossSection

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath.fresh.coverage import RASTER_PER_LINE, Coverage, measure_coverage
from design.toolpath.fresh.infill import concentric_paths, gyroid_paths, infill_paths
from design.toolpath.fresh.layout import Carriage, LayerMoves, Section
from design.toolpath.fresh.options import Filling, FreshOptions
from design.toolpath.fresh.paths import Paths, join
from design.toolpath.fresh.report import (
    FreshReport,
    LayerNarrow,
    LevelPlaces,
    Tally,
    narrow_samples,
)
from design.toolpath.fresh.section import (
    Body,
    Layer,
    Region,
    Regions,
    RegionSections,
    adaptive_levels,
    even_levels,
    layers,
    rings,
)
from design.toolpath.fresh.walls import build_walls, clear_of_lumens, moved_in, remove_short_moves
from design.toolpath.toolpath import ARRAYS, MoveKind, Toolpath, join_toolpaths
from kernels.arrays import FloatArray

MEASURED_LAYERS: Final = 100
"""Cover is measured in at most so many layers, evenly spread; in all of a lower part."""


@dataclass(frozen=True)
class FreshPlan:
    """Toolpath of FRESH layers, with its report."""

    toolpath: Toolpath
    report: FreshReport


def plan_fresh(
    solid: Solid | Sequence[Solid],
    options: FreshOptions,
    regions: Sequence[Region] = (),
    heads: Sequence[FreshOptions] = (),
) -> FreshPlan:
    """Slice ``solid`` into FRESH layers and say how well they fill it; see `FreshLayers`.

    Raises
    ------
    ToolpathError
        As `FreshLayers`.
    """
    layers = FreshLayers(solid, options, regions, heads)
    return FreshPlan(join_toolpaths(list(layers)), layers.report())


class FreshLayers:
    """The layers of a part, made one by one while they are iterated over, from the lowest up.

    A line is laid out as the rectangle of its cross-section, `FreshOptions.spacing_mm` wide, in
    material whose boundary is moved inward by `FreshOptions.inset_mm`: there its rectangle ends,
    and its edge stands on the part's own boundary. Its volume is exactly spacing · layer height ·
    length. Layer k lies between `levels` k and k + 1 and is written with the tip at its top. Each
    begins where the one before it ended; one in which nothing is written is left out.

    Parameters
    ----------
    solid : Solid or sequence of Solid
        Several are written as one part; `Region` says which head writes each.
    options : FreshOptions
        Of head 0, which writes what no region gives to another.
    regions : sequence of Region
        Places with a filling of their own, or that another head writes.
    heads : sequence of FreshOptions
        Of the further heads, 1 first: line width, plunger and speeds may differ. Layer height,
        clearance of lumens and compensation are the part's, as in ``options``.

    Raises
    ------
    ToolpathError
        When a region names a head without options, or layer height, clearance or compensation
        differ among heads. While it is gone through, when the solid isn't a closed manifold, lower
        than half a layer, or nowhere as wide as the narrowest line.
    """

    def __init__(
        self,
        solid: Solid | Sequence[Solid],
        options: FreshOptions,
        regions: Sequence[Region] = (),
        heads: Sequence[FreshOptions] = (),
    ) -> None:
        solids = [solid] if isinstance(solid, Solid) else list(solid)
        self._solids = [options.compensation.enlarged(one) for one in solids]
        self._regions = regions
        self._options = options
        self._heads = (options, *heads)
        self._tally: Tally
        _check_heads(self._heads, regions)

    @property
    def _bounds(self) -> FloatArray:
        """Lowest and highest corner of all bodies, (2, 3), mm."""
        corners = np.array([solid.bounds for solid in self._solids])
        return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])

    @property
    def top_mm(self) -> float:
        """Highest that the tip goes, mm."""
        return float(self.levels[-1]) + max(max(one.lift_mm, one.hop_mm) for one in self._heads)

    @cached_property
    def levels(self) -> FloatArray:
        """Borders of the layers, those without material too, (n + 1,), mm."""
        low, high = self._bounds[:, 2].tolist()
        height, adaptive = self._options.layer_height_mm, self._options.adaptive
        if adaptive is None:
            levels = even_levels(low, high, height)
        else:
            levels = adaptive_levels(self._solids, height, adaptive)
        if len(levels) < 2:
            raise ToolpathError(
                f"solid is {high - low:g} mm high, less than half a layer of {height:g} mm; "
                "check the part's unit or write thinner layers (--layer-um; toolpath.layer_um in a "
                "recipe)"
            )
        return levels

    @property
    def moves(self) -> int:
        """Moves of the layers so far."""
        return self._tally.moves

    def report(self) -> FreshReport:
        """What was planned so far, in numbers."""
        return self._tally.report()

    def __iter__(self) -> Iterator[Toolpath]:
        options, low = self._options, self._bounds[0]
        every = self._measured_every()
        regions = Regions(self._regions, options.compensation)
        carriage = Carriage(self._heads, low[:2])
        body = Body(self._solids)
        finest = min(one.line_width_mm for one in self._heads)
        places = LevelPlaces(self._solids, self.levels, finest)
        self._tally = Tally(body.volume_ul, body.overlap_ul, places)
        for layer in layers(body, self.levels, self._inset_mm):
            heads = [one.in_layer(layer.height_mm) for one in self._heads]
            sections = _sections(layer, heads, regions.at(layer.middle_mm), low[:2])
            laid = carriage.write(sections, layer.tip_mm, layer.height_mm)
            measured = layer.index % every == 0
            coverage = _coverage(layer, laid, heads) if measured else None
            narrow = self._narrow(layer) if measured else None
            self._tally.add_layer(layer, coverage, narrow)
            lines = sum(section.paths.number for section in sections)
            if lines:
                yield self._counted(layer, laid, lines)
        if not self._tally.moves:
            raise ToolpathError(
                f"no place of the solid is as wide as {options.least_line:g} of a line of "
                f"{options.line_width_mm:g} mm; check the part's unit, or write narrower lines "
                "with a finer needle (--line-um, --needle; toolpath.line_um, toolpath.needle in a "
                "recipe)"
            )

    def _measured_every(self) -> int:
        return max(1, int(np.ceil((len(self.levels) - 1) / MEASURED_LAYERS)))

    def _inset_mm(self, height_mm: float) -> float:
        return self._options.in_layer(height_mm).inset_mm

    def _narrow(self, layer: Layer) -> LayerNarrow:
        wall = min(one.thinnest_wall_mm for one in self._heads)
        gap = min(one.line_width_mm for one in self._heads)
        walls = narrow_samples(layer.material, wall, gaps=False)
        gaps = narrow_samples(layer.material, gap, gaps=True)
        return LayerNarrow(layer.middle_mm, walls, gaps, wall, gap)

    def _counted(self, layer: Layer, laid: LayerMoves, lines: int) -> Toolpath:
        toolpath = _toolpath(layer, laid, differs=self._options.adaptive is not None)
        self._tally.add(toolpath, laid, lines)
        return toolpath


def _check_heads(heads: Sequence[FreshOptions], regions: Sequence[Region]) -> None:
    for number, region in enumerate(regions):
        if region.head is not None and not 0 <= region.head < len(heads):
            raise ToolpathError(
                f"region {number} is written by head {region.head}; options are given for "
                f"{len(heads)} (heads, counted from 0)"
            )
    for number, own in enumerate(heads):
        for name in ("layer_height_mm", "adaptive", "clear_mm", "compensation"):
            if getattr(own, name) != getattr(heads[0], name):
                raise ToolpathError(
                    f"{name} is {getattr(own, name)} for head {number} and "
                    f"{getattr(heads[0], name)} for head 0 (FRESH options); it is the part's: "
                    "give all heads the same"
                )


def _sections(
    layer: Layer, heads: Sequence[FreshOptions], cut: RegionSections, origin: FloatArray
) -> list[Section]:
    """What each head writes in a layer.

    Lumens are cleared, and the boundary is moved inward, before the material is parted: one on the
    border of two inks is no hole in either of them, and inks abut there.
    """
    part = heads[0]
    material = clear_of_lumens(layer.carved, part.clear_mm + part.compensation.radial_mm)
    parted = cut.sections(material)
    if set(parted) <= {0}:
        paths = _section_paths(moved_in(material, part.inset_mm), layer, cut, part, origin)
        return [Section(0, paths, layer.material)]
    sections = []
    for head, own in parted.items():
        rectangles = own ^ moved_in(material, heads[head].inset_mm)
        paths = _section_paths(rectangles, layer, cut, heads[head], origin, beside_ink=True)
        sections.append(Section(head, paths, own))
    return [section for section in sections if section.paths.number]


def _section_paths(
    material: CrossSection,
    layer: Layer,
    cut: RegionSections,
    options: FreshOptions,
    origin: FloatArray,
    *,
    beside_ink: bool = False,
) -> Paths:
    width, origin = options.spacing_mm, origin + options.inset_mm
    walls = build_walls(material, width, options.walls, options.least_line)
    outlines = remove_short_moves(walls.paths, options.least_move_mm, width, beside_ink=beside_ink)
    shares = cut.shares(walls.inside, options.filling)
    return join([outlines, *(_infill(share, layer, way, options, origin) for share, way in shares)])


def _infill(
    inside: CrossSection,
    layer: Layer,
    filling: Filling,
    options: FreshOptions,
    origin: FloatArray,
) -> Paths:
    width, density = options.spacing_mm, filling.density
    match filling.pattern:
        case "concentric":
            return concentric_paths(inside, width, density, options.least_line, options.walls)
        case "gyroid":
            return gyroid_paths(inside, width, density, layer.tip_mm, origin)
        case "lines":
            angle = filling.angles_deg[layer.index % len(filling.angles_deg)]
            return infill_paths(rings(inside), width, angle, origin, density)


def _coverage(layer: Layer, laid: LayerMoves, heads: Sequence[FreshOptions]) -> Coverage:
    wrote = laid.kind == MoveKind.WRITE
    begin = np.vstack([laid.start, laid.end])[:-1][wrote, :2]
    end = laid.end[wrote, :2]
    area = laid.volume_ul[wrote] / np.hypot(*(end - begin).T)
    width, height = np.zeros(len(area)), heads[0].layer_height_mm
    for number, options in enumerate(heads):
        own = laid.tool[wrote] == number
        width[own] = options.bead.width(area[own], height)
    pitch = heads[0].line_width_mm / RASTER_PER_LINE
    return measure_coverage(rings(layer.material), begin, end, width, pitch)


def _toolpath(layer: Layer, laid: LayerMoves, *, differs: bool) -> Toolpath:
    """Moves of one layer."""
    columns = laid._asdict()
    return Toolpath(
        **{name: columns[name] for name in ARRAYS if name in columns}
        | {"start": np.concatenate([laid.start[None], laid.end[:-1]])},
        source=np.full(len(laid.kind), layer.index, dtype=np.int64),
        source_kind="layer",
        layer_height_mm=layer.height_mm,
        heights_mm={layer.index: layer.height_mm} if differs else {},
    )
