"""From a solid to FRESH layers: section, walls, infill, order, travels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath.fresh.coverage import FINENESS, Coverage, measure_coverage
from design.toolpath.fresh.infill import fill
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.order import order_lines, order_loops
from design.toolpath.fresh.report import FreshReport, make_report
from design.toolpath.fresh.section import Layer, boundary, layers, rings
from design.toolpath.fresh.travel import Traveller
from design.toolpath.fresh.walls import build_walls
from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import FloatArray, Toolpath


@dataclass(frozen=True)
class FreshPlan:
    """A toolpath and its numbers."""

    toolpath: Toolpath
    report: FreshReport


@dataclass(frozen=True)
class Path:
    """One path to write in a layer: points (k, 2) mm and the width of its line, mm."""

    points: FloatArray
    width_mm: float


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
        a line.
    """
    traveller: Traveller | None = None
    coverage: list[Coverage] = []
    lines = 0
    for layer in layers(solid, options.layer_height_mm):
        at = solid.bounds[0, :2] if traveller is None else traveller.builder.tip[:2]
        paths = _layer_paths(layer, options, solid.bounds[0, :2], at)
        coverage.append(_coverage(layer, paths, options.line_width_mm))
        if not paths:
            continue
        if traveller is None:
            tip = np.append(paths[0].points[0], layer.tip_mm)
            builder = MoveBuilder(tip, "layer", options.layer_height_mm)
            traveller = Traveller(builder, options)
        _write_layer(traveller, layer, paths, options)
        lines += len(paths)
    if traveller is None:
        raise ToolpathError(
            f"no place of the solid is as wide as a line of {options.line_width_mm:g} mm "
            "(line_width_mm); check the part's unit or use a finer needle"
        )
    toolpath = traveller.builder.build()
    report = make_report(
        toolpath, coverage, lines, traveller.travels, traveller.lifted, traveller.links
    )
    return FreshPlan(toolpath, report)


def _layer_paths(
    layer: Layer, options: FreshOptions, origin: FloatArray, at: FloatArray
) -> list[Path]:
    """Paths of a layer in the order of writing: walls from the lumens outward, then infill."""
    width = options.line_width_mm
    walls = build_walls(layer.material, width, options.walls)
    paths: list[Path] = []
    for loops in walls.loops:
        for ring in order_loops(loops, at):
            paths.append(Path(ring, width))
            at = ring[-1]
    angle = options.infill_angles_deg[layer.index % len(options.infill_angles_deg)]
    lines = fill(rings(walls.inside), width, angle, origin)
    order, flipped = order_lines(lines.start, lines.end, at)
    for line in order:
        points = np.stack([lines.start[line], lines.end[line]])
        paths.append(Path(points[::-1] if flipped[line] else points, lines.width_mm[line]))
    return paths


def _write_layer(
    traveller: Traveller, layer: Layer, paths: list[Path], options: FreshOptions
) -> None:
    traveller.enter(layer.index, boundary(layer.material))
    starts = np.array([path.points[0] for path in paths])
    ends = np.vstack([traveller.builder.tip[:2], [path.points[-1] for path in paths[:-1]]])
    crossing = traveller.crosses(shapely.linestrings(np.stack([ends, starts], axis=1)))
    for path, crosses in zip(paths, crossing, strict=True):
        points = np.column_stack([path.points, np.full(len(path.points), layer.tip_mm)])
        traveller.go(points[0], bool(crosses))
        length = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
        volume = path.width_mm * options.layer_height_mm * length
        traveller.builder.write(points[1:], volume, options.write_speed_mm_s, layer.index)


def _coverage(layer: Layer, paths: list[Path], width_mm: float) -> Coverage:
    contours = rings(layer.material)
    if not paths:
        area = float(layer.material.area())
        return Coverage(area, area, 0.0)
    start = np.concatenate([path.points[:-1] for path in paths])
    end = np.concatenate([path.points[1:] for path in paths])
    width = np.repeat([path.width_mm for path in paths], [len(path.points) - 1 for path in paths])
    return measure_coverage(contours, start, end, width, width_mm / FINENESS)
