"""From a solid to FRESH layers: section, walls, infill, order, travels."""

from __future__ import annotations

from collections.abc import Iterator
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
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.order import order_paths
from design.toolpath.fresh.paths import Paths, join
from design.toolpath.fresh.patterns import concentric_paths, gyroid_paths
from design.toolpath.fresh.report import FreshReport, make_report
from design.toolpath.fresh.section import Layer, layers, rings
from design.toolpath.fresh.walls import build_walls, clear_of_lumens
from design.toolpath.toolpath import FloatArray, MoveKind, Toolpath

#: Cover is measured in at most so many layers, evenly spread; in all of a lower part.
MEASURED = 100


@dataclass(frozen=True)
class FreshPlan:
    """A toolpath and its numbers."""

    toolpath: Toolpath
    report: FreshReport


@dataclass(frozen=True)
class Written:
    """One layer's moves, and where its needle came from."""

    index: int
    start: FloatArray
    rows: Rows
    paths: int
    coverage: Coverage | None


def fresh_toolpath(solid: Solid, options: FreshOptions) -> Toolpath:
    """Slice ``solid`` into FRESH layers; see `plan_fresh`."""
    return plan_fresh(solid, options).toolpath


def plan_fresh(solid: Solid, options: FreshOptions) -> FreshPlan:
    """Slice ``solid`` into FRESH layers and say how well they fill it.

    Every line's volume is exactly width · layer height · length. Layer k lies in
    [z0 + k h, z0 + (k + 1) h] and is written with the tip at its top.

    Raises
    ------
    ToolpathError
        When the solid isn't a closed manifold, lower than half a layer, or nowhere as wide as
        the narrowest line.
    """
    written = list(_layers(options.compensation.enlarged(solid), options))
    found = [layer for layer in written if layer.paths]
    if not found:
        raise ToolpathError(
            f"no place of the solid is as wide as {options.least_line:g} of a line of "
            f"{options.line_width_mm:g} mm (line_width_mm); check the part's unit or use a "
            "finer needle"
        )
    toolpath = _assembled(found, options)
    coverage = [layer.coverage for layer in written if layer.coverage is not None]
    report = make_report(
        toolpath,
        coverage,
        layers=len(written),
        lines=sum(layer.paths for layer in found),
        travels=sum(layer.rows.travels for layer in found),
        lifted=sum(layer.rows.lifted for layer in found),
        links=sum(layer.rows.links for layer in found),
    )
    return FreshPlan(toolpath, report)


def _layers(solid: Solid, options: FreshOptions) -> Iterator[Written]:
    low, high = solid.bounds
    every = max(1, int(np.ceil((high[2] - low[2]) / options.layer_height_mm / MEASURED)))
    below, tip = None, None
    for layer in layers(solid, options.layer_height_mm):
        paths = _layer_paths(layer, options, low[:2])
        here = obstacles(contours_of(layer.material), options.line_width_mm)
        at = low[:2] if tip is None else tip[:2]
        sequence = order_paths(paths, at, options.link_mm)
        if len(paths) and tip is None:
            tip = np.append(paths.points[sequence.first[0]], layer.tip_mm)
        start = np.append(at, layer.tip_mm) if tip is None else tip
        around = (here, below or here)
        rows = lay_out(paths, sequence, start, layer.tip_mm, around, options)
        cover = _coverage(layer, start, rows, options) if layer.index % every == 0 else None
        yield Written(layer.index, start, rows, len(paths), cover)
        below, tip = here, rows.end[-1] if len(rows.end) else tip


def _layer_paths(layer: Layer, options: FreshOptions, origin: FloatArray) -> Paths:
    width = options.line_width_mm
    clear = options.clear_mm + options.compensation.radial_mm
    material = clear_of_lumens(layer.material, clear)
    walls = build_walls(material, width, options.walls, options.least_line)
    outlines = without_short_moves(walls.paths, options.least_move_mm, width)
    return join([outlines, _infill(walls.inside, layer, options, origin)])


def _infill(inside: CrossSection, layer: Layer, options: FreshOptions, origin: FloatArray) -> Paths:
    width, density = options.line_width_mm, options.infill_density
    match options.infill:
        case "concentric":
            return concentric_paths(inside, width, density, options.least_line, options.walls)
        case "gyroid":
            return gyroid_paths(inside, width, density, layer.tip_mm, origin)
        case "lines":
            angle = options.infill_angles_deg[layer.index % len(options.infill_angles_deg)]
            return infill_paths(rings(inside), width, angle, origin, density)


def _coverage(layer: Layer, start: FloatArray, rows: Rows, options: FreshOptions) -> Coverage:
    wrote = rows.kind == MoveKind.WRITE
    begin = np.vstack([start, rows.end])[:-1][wrote, :2]
    end = rows.end[wrote, :2]
    length = np.hypot(*(end - begin).T)
    width = rows.volume_ul[wrote] / (length * options.layer_height_mm)
    pitch = options.line_width_mm / FINENESS
    return measure_coverage(rings(layer.material), begin, end, width, pitch)


def _assembled(found: list[Written], options: FreshOptions) -> Toolpath:
    """One toolpath of the rows of all layers."""
    end = np.concatenate([layer.rows.end for layer in found])
    count = [len(layer.rows.kind) for layer in found]
    return Toolpath(
        start=np.concatenate([found[0].start[None], end[:-1]]),
        end=end,
        volume_ul=np.concatenate([layer.rows.volume_ul for layer in found]),
        speed_mm_s=np.concatenate([layer.rows.speed_mm_s for layer in found]),
        duration_s=np.concatenate([layer.rows.duration_s for layer in found]),
        tool=np.zeros(len(end), dtype=np.int64),
        kind=np.concatenate([layer.rows.kind for layer in found]),
        source=np.repeat(np.array([layer.index for layer in found], dtype=np.int64), count),
        source_kind="layer",
        layer_height_mm=options.layer_height_mm,
    )
