"""From a solid to FRESH layers: section, walls, infill, order, travels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath.fresh.coarsen import without_short_moves
from design.toolpath.fresh.contours import contours_of
from design.toolpath.fresh.coverage import FINENESS, Coverage, measure_coverage
from design.toolpath.fresh.infill import infill_paths
from design.toolpath.fresh.layout import Rows, lay_out, obstacles
from design.toolpath.fresh.options import Filling, FreshOptions
from design.toolpath.fresh.order import order_paths
from design.toolpath.fresh.paths import Paths, join
from design.toolpath.fresh.patterns import concentric_paths, gyroid_paths
from design.toolpath.fresh.regions import Region, Regions
from design.toolpath.fresh.report import FreshReport, Tally
from design.toolpath.fresh.section import Layer, layer_count, layers, rings
from design.toolpath.fresh.walls import build_walls, clear_of_lumens
from design.toolpath.toolpath import FloatArray, MoveKind, Toolpath, joined

#: Cover is measured in at most so many layers, evenly spread; in all of a lower part.
MEASURED = 100


@dataclass(frozen=True)
class FreshPlan:
    """A toolpath and its numbers."""

    toolpath: Toolpath
    report: FreshReport


def fresh_toolpath(solid: Solid, options: FreshOptions, regions: Sequence[Region] = ()) -> Toolpath:
    """Slice ``solid`` into FRESH layers; see `plan_fresh`."""
    return plan_fresh(solid, options, regions).toolpath


def plan_fresh(solid: Solid, options: FreshOptions, regions: Sequence[Region] = ()) -> FreshPlan:
    """Slice ``solid`` into FRESH layers and say how well they fill it; see `FreshLayers`.

    Raises
    ------
    ToolpathError
        As `FreshLayers`.
    """
    layers = FreshLayers(solid, options, regions)
    return FreshPlan(joined(list(layers)), layers.report())


class FreshLayers:
    """The layers of a part, made one by one as they are asked for, from the lowest up.

    Every line's volume is exactly width · layer height · length. Layer k lies in
    [z0 + k h, z0 + (k + 1) h] and is written with the tip at its top. Each begins where the one
    before it ended; one in which nothing is written is left out.

    Parameters
    ----------
    solid : Solid
    options : FreshOptions
    regions : sequence of Region
        Places with a filling of their own.

    Raises
    ------
    ToolpathError
        While it is gone through, when the solid isn't a closed manifold, lower than half a layer,
        or nowhere as wide as the narrowest line.
    """

    def __init__(self, solid: Solid, options: FreshOptions, regions: Sequence[Region] = ()) -> None:
        self._solid = options.compensation.enlarged(solid)
        self._regions = regions
        self._options = options
        self._tally = Tally()

    @property
    def top_mm(self) -> float:
        """Highest that the tip goes, mm."""
        low, high = self._solid.bounds[:, 2].tolist()
        height = self._options.layer_height_mm
        count = layer_count(low, high, height)
        return low + count * height + max(self._options.lift_mm, self._options.hop_mm)

    @property
    def moves(self) -> int:
        """Moves of the layers so far."""
        return self._tally.moves

    def report(self) -> FreshReport:
        """What was planned so far, in numbers."""
        return self._tally.report()

    def __iter__(self) -> Iterator[Toolpath]:
        self._tally = Tally()
        options, low = self._options, self._solid.bounds[0]
        every = self._measured_every()
        regions = Regions(self._regions, options.compensation)
        below, tip = None, None
        for layer in layers(self._solid, options.layer_height_mm):
            paths = _layer_paths(layer, options, regions, low[:2])
            here = obstacles(contours_of(layer.material), options.line_width_mm)
            at = low[:2] if tip is None else tip[:2]
            sequence = order_paths(paths, at, options.link_mm)
            if len(paths) and tip is None:
                tip = np.append(paths.points[sequence.first[0]], layer.tip_mm)
            start = np.append(at, layer.tip_mm) if tip is None else tip
            rows = lay_out(paths, sequence, start, layer.tip_mm, (here, below or here), options)
            measured = layer.index % every == 0
            self._tally.add_layer(_coverage(layer, start, rows, options) if measured else None)
            below, tip = here, rows.end[-1] if len(rows.end) else tip
            if len(paths):
                yield self._counted(layer.index, start, rows, len(paths))
        if not self._tally.moves:
            raise ToolpathError(
                f"no place of the solid is as wide as {options.least_line:g} of a line of "
                f"{options.line_width_mm:g} mm (line_width_mm); check the part's unit or use a "
                "finer needle"
            )

    def _measured_every(self) -> int:
        low, high = self._solid.bounds[:, 2].tolist()
        return max(1, int(np.ceil((high - low) / self._options.layer_height_mm / MEASURED)))

    def _counted(self, index: int, start: FloatArray, rows: Rows, lines: int) -> Toolpath:
        toolpath = _toolpath(index, start, rows, self._options.layer_height_mm)
        self._tally.add(
            toolpath, lines=lines, travels=rows.travels, lifted=rows.lifted, links=rows.links
        )
        return toolpath


def _layer_paths(
    layer: Layer, options: FreshOptions, regions: Regions, origin: FloatArray
) -> Paths:
    width = options.line_width_mm
    clear = options.clear_mm + options.compensation.radial_mm
    material = clear_of_lumens(layer.material, clear)
    walls = build_walls(material, width, options.walls, options.least_line)
    outlines = without_short_moves(walls.paths, options.least_move_mm, width)
    shares = regions.shares(walls.inside, layer.middle_mm, options.filling)
    return join([outlines, *(_infill(share, layer, way, options, origin) for share, way in shares)])


def _infill(
    inside: CrossSection,
    layer: Layer,
    filling: Filling,
    options: FreshOptions,
    origin: FloatArray,
) -> Paths:
    width, density = options.line_width_mm, filling.density
    match filling.pattern:
        case "concentric":
            return concentric_paths(inside, width, density, options.least_line, options.walls)
        case "gyroid":
            return gyroid_paths(inside, width, density, layer.tip_mm, origin)
        case "lines":
            angle = filling.angles_deg[layer.index % len(filling.angles_deg)]
            return infill_paths(rings(inside), width, angle, origin, density)


def _coverage(layer: Layer, start: FloatArray, rows: Rows, options: FreshOptions) -> Coverage:
    wrote = rows.kind == MoveKind.WRITE
    begin = np.vstack([start, rows.end])[:-1][wrote, :2]
    end = rows.end[wrote, :2]
    length = np.hypot(*(end - begin).T)
    width = rows.volume_ul[wrote] / (length * options.layer_height_mm)
    pitch = options.line_width_mm / FINENESS
    return measure_coverage(rings(layer.material), begin, end, width, pitch)


def _toolpath(index: int, start: FloatArray, rows: Rows, height_mm: float) -> Toolpath:
    """Moves of one layer."""
    count = len(rows.kind)
    return Toolpath(
        start=np.concatenate([start[None], rows.end[:-1]]),
        end=rows.end,
        volume_ul=rows.volume_ul,
        speed_mm_s=rows.speed_mm_s,
        duration_s=rows.duration_s,
        tool=np.zeros(count, dtype=np.int64),
        kind=rows.kind,
        source=np.full(count, index, dtype=np.int64),
        source_kind="layer",
        layer_height_mm=height_mm,
    )
