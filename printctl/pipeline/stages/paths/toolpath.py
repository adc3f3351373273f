"""Stage 5: plan the toolpath and write the G-code for the printer's firmware."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import InitVar, asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.solids import Solid, lumen_solid, solid_from_surface
from design.tissue import zone_surface
from design.toolpath import Toolpath, join_toolpaths
from design.toolpath.embedded import (
    Bundles,
    EmbeddedHeads,
    EmbeddedOptions,
    EmbeddedReport,
    bundled,
    plan_embedded,
)
from design.toolpath.fresh import (
    Adaptive,
    Compensation,
    Filling,
    FreshLayers,
    FreshOptions,
    FreshReport,
    Region,
    check_lumens,
)
from design.toolpath.gcode import (
    Gcode,
    GcodeOptions,
    clear_mm,
    joint_mm,
    least_move_mm,
    save_gcode,
    stream_gcode,
)
from design.toolpath.toolpath import save_toolpath
from firmware_profiles import Bath, Printer, Syringe
from kernels.arrays import FloatArray
from printctl.checks.made_for import header_lines, made_for
from printctl.checks.preflight import written_arrays
from printctl.checks.set_up import ABOVE_WALL_MM
from printctl.errors import UsageError
from printctl.pipeline.context import RunContext
from printctl.pipeline.facts import heads_dump
from printctl.pipeline.job.heads import (
    Filled,
    gcode_options,
    head_loads,
    layer_lines_um,
    needle_options,
    speed_notes,
)
from printctl.pipeline.prepared.apply_compensation import (
    check_compensation,
    compensation_facts,
    solid_dependence,
    written_solid,
)
from printctl.pipeline.prepared.lag import ahead_of_lag, measured_lag_s, relief_ul
from printctl.pipeline.prepared.priming import primed
from printctl.pipeline.refusals import refuse_early
from printctl.pipeline.stage import Stage
from printctl.pipeline.tissue_source import make_zones
from printctl.progress import Report
from printctl.recipe.sections.observe import look_interval
from printctl.recipe.sections.regions import FillingPart, RegionPart
from printctl.recipe.sections.toolpath import Embedded, Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK, SOLID, SURFACE


def make_filling(part: FillingPart) -> Filling:
    """The recipe's infill."""
    return Filling(part.infill, part.infill_percent * 1e-2, part.infill_angles_deg)


def make_region(
    part: RegionPart, number: int, folder: Path, network: VesselNetwork, scale: float = 1.0
) -> Region:
    """Region ``number`` (0 first) of a recipe in ``folder``, for the part's ``network``.

    The network has the print's size; places, said in the design's, come ``scale`` times as large.

    Raises
    ------
    DesignError
        When its mesh can't be read or isn't closed, or it has no volume.
    """
    solid = _solid(part, f"toolpath.regions.{number}", folder, network, scale)
    return Region(solid, make_filling(part), part.head)


def _solid(
    part: RegionPart, name: str, folder: Path, network: VesselNetwork, scale: float
) -> Solid:
    if part.where is None:
        wider = replace(network, radius=network.radius + (part.around_vessels_mm or 0.0))
        return lumen_solid(wider)
    (zone,), _ = make_zones([part.where], folder)
    surface = zone_surface(zone, name)
    return solid_from_surface(surface.vertices * scale, surface.faces)


PATH: Final = "toolpath.npz"
"""Kept of a well, to be laid into the plate's job."""


def depends(context: RunContext) -> Any:
    """The section and every profile that shapes the path."""
    profiles = (context.printer, context.needle, context.syringe, context.ink, context.bath)
    return [
        context.recipe.toolpath.model_dump(mode="json"),
        [profile.model_dump(mode="json") for profile in profiles],
        *of_heads(context),
        context.place_mm.tolist(),
        context.digests(context.recipe.toolpath.files()),
        *solid_dependence(context),
        *(["look_within"] if looks_within(context) else []),
    ]


def looks_within(context: RunContext) -> bool:
    """Whether an embedded print is looked at within vessels, where a mend would come too late."""
    part = context.recipe.observe
    embedded = isinstance(context.recipe.toolpath, Embedded)
    return embedded and part is not None and look_interval(part.every).measure == "vessel"


def of_heads(context: RunContext) -> list[Any]:
    """What several heads hold and write, and the dish above which they are changed, or purged."""
    dish = context.dish and context.dish.model_dump(mode="json")
    if not context.printer.heads:
        return [] if context.recipe.toolpath.prime is None else [dish]
    heads = [head.model_dump(mode="json") for head in context.recipe.printer.heads]
    return [heads, heads_dump(context), dish]


@dataclass(frozen=True)
class PlannedPath:
    """A path in the part's frame, in one part or layer by layer.

    Attributes
    ----------
    parts : iterable of Toolpath
    top_mm : float, mm
        Highest that the tip goes.
    report : callable
        How well it went, once the parts have been gone through.
    bundles : Bundles or None
        The strands that `parts` name as their sources; None for layers.
    """

    parts: Iterable[Toolpath]
    top_mm: float
    report: Callable[[], FreshReport | EmbeddedReport]
    bundles: Bundles | None = None


def plan(context: RunContext, *, compensated: bool = True) -> PlannedPath:
    """Plan the path by the recipe's method; where it says so, ahead of the ink's lag."""
    part = context.recipe.toolpath
    match part:
        case Fresh():
            refuse_early(context)
            options = fresh_options(context, part)
            check_compensation(context, max(own.line_width_mm for own in options))
            for own in options:
                check_lumens(context.written_network, own)
            layers = FreshLayers(
                written_solid(context), options[0], written_regions(context, part), options[1:]
            )
            return _after_priming(context, PlannedPath(layers, layers.top_mm, layers.report))
        case Embedded():
            refuse_early(context)
            ahead = part.compensate_lag and compensated
            choices = tuple(
                replace(
                    embedded_options(part, one, context.bath, ahead=ahead),
                    look_within=looks_within(context),
                )
                for one in context.loads
            )
            thinnest = float(context.network.radius.min())
            check_compensation(context, max(own.smallest_wall_mm(thinnest) for own in choices))
            bundles = written_bundles(context)
            heads = EmbeddedHeads(choices, context.vessel_head[bundles.owner])
            embedded = plan_embedded(bundles, heads)
            toolpath = embedded.toolpath
            if part.prime is not None:
                relief = relief_ul(context.loads[0]) if ahead else None
                before = primed(context, toolpath, toolpath.top_mm, relief)
                toolpath = join_toolpaths([before, toolpath])
            if ahead:
                toolpath = ahead_of_lag(context, toolpath)
            return PlannedPath([toolpath], toolpath.top_mm, lambda: embedded.report, bundles)


def _after_priming(context: RunContext, planned: PlannedPath) -> PlannedPath:
    """Layers, with what comes before the first of them where the recipe asks for it."""
    if context.recipe.toolpath.prime is None:
        return planned
    parts = iter(planned.parts)
    first = next(parts)
    before = primed(context, first, planned.top_mm, None)
    return replace(
        planned,
        parts=itertools.chain([join_toolpaths([before, first])], parts),
        top_mm=max(planned.top_mm, before.top_mm),
    )


def written_bundles(context: RunContext) -> Bundles:
    """The written network as strands, none wider than one filament of its head may be."""
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        raise UsageError("layers have no strands; this is for embedded prints")
    heads = [embedded_options(part, one, context.bath, ahead=False) for one in context.loads]
    widest = np.array([one.widest_mm for one in heads])
    return bundled(context.written_network, widest[context.vessel_head])


def plain_job(context: RunContext) -> Gcode:
    """The same job as if the ink had no lag; its lines name strands."""
    planned = plan(context, compensated=False)
    parts = stream_gcode(planned.parts, *machine(context, ahead=False), planned.top_mm)
    return Gcode.joined(list(parts))


def written_regions(context: RunContext, part: Fresh) -> list[Region]:
    """The recipe's regions, which follow the part where it is compensated."""
    stretch = context.corrections.stretch
    made = (
        make_region(
            region,
            number,
            context.recipe_folder,
            context.local_network,
            context.recipe.print_scale,
        )
        for number, region in enumerate(part.regions)
    )
    return [replace(region, solid=stretch.solid(region.solid)) for region in made]


def fresh_options(context: RunContext, part: Fresh) -> list[FreshOptions]:
    """The planner's choices for each head, by its ink and the lines that it writes."""
    count = context.printer.head_count
    widths = layer_lines_um(part, context.recipe.printer.heads, count)
    return [
        FreshOptions(
            layer_height_mm=part.layer_um * 1e-3,
            adaptive=_adaptive(context.printer, part),
            line_width_mm=line_um * 1e-3,
            bead=load.ink.bead_section,
            walls=part.walls,
            filling=make_filling(part),
            least_move_mm=least_move_mm(printer),
            clear_mm=clear_mm(printer),
            compensation=Compensation(
                part.compensate.shrink_percent, part.compensate.radial_um * 1e-3
            ),
            write_speed_mm_s=part.write_speed_mm_s,
            travel_speed_mm_s=part.travel_speed_mm_s,
            joint_mm=joint_mm(printer),
            retract_ul=load.ink.retract_ul,
            plunger_ul_s=load.ink.plunger_ul_s,
        )
        for line_um, load, printer in zip(
            widths, context.loads, map(context.printer.of_head, range(count)), strict=True
        )
    ]


def _adaptive(printer: Printer, part: Fresh) -> Adaptive | None:
    """Layers that follow the slopes, in whole steps of the vertical motor."""
    if part.thinnest_layer_um is None:
        return None
    thinnest_mm, stair_mm = part.thinnest_layer_um * 1e-3, part.stair_um * 1e-3
    return Adaptive(thinnest_mm, stair_mm, 1 / printer.steps_per_mm.z)


def embedded_options(part: Embedded, filled: Filled, bath: Bath, *, ahead: bool) -> EmbeddedOptions:
    """The planner's choices for a head, by its needle and ink; ``ahead`` of its lag or not."""
    return EmbeddedOptions(
        **needle_options(filled.needle),
        recovery_s=bath.recovery_s or 0.0,
        write_speed_mm_s=part.write_speed_mm_s,
        travel_speed_mm_s=part.travel_speed_mm_s,
        overlap_radii=part.overlap_radii,
        thinnest=part.thinnest_bore,
        retract_ul=relief_ul(filled) if ahead else filled.ink.retract_ul,
        plunger_ul_s=filled.ink.plunger_ul_s,
        dwell_s=filled.ink.dwell_s,
        widest_filament_mm=part.widest_filament_mm,
        open_joints=part.open_joints,
        leave_out=part.leave_out,
    )


def head_options(context: RunContext) -> dict[str, Any]:
    """The writer's choices for several heads: what each holds, and how high they are changed."""
    if not context.printer.heads:
        return {}
    loads = head_loads(context.printer, context.loads)
    safe = None
    if context.dish is not None:
        safe = context.printer.z_mm.low + context.dish.wall_mm + ABOVE_WALL_MM
    return {"heads": loads, "safe_z_mm": safe}


def machine(
    context: RunContext, *, ahead: bool
) -> tuple[Printer, Syringe, FloatArray, GcodeOptions]:
    """What the writer is told besides the path."""
    x, y, z = context.start_mm.tolist()
    travel = context.recipe.toolpath.travel_speed_mm_s
    options = gcode_options(context.ink, (x, y, z), travel, context.flow_ul_s)
    recorded = made_for(context.printer, context.loads, context.bath, context.dish)
    options = replace(options, header=header_lines(recorded), **head_options(context))
    if ahead:
        options = replace(options, relieve_ul=relief_ul(context.loads[0]))
    return context.printer, context.syringe, context.place_mm, options


@dataclass
class Count:
    """What the parts of a path add up to; the parts themselves where they are ``wanted``."""

    moves: int = 0
    length_mm: float = 0.0
    written_ul: float = 0.0
    wanted: InitVar[bool] = False

    def __post_init__(self, wanted: bool) -> None:
        self._kept: list[Toolpath] | None = [] if wanted else None

    def along(self, parts: Iterable[Toolpath]) -> Iterator[Toolpath]:
        """Hand the parts on, counted."""
        for part in parts:
            self.moves += len(part)
            self.length_mm += float(part.lengths.sum())
            self.written_ul += part.written_ul
            if self._kept is not None:
                self._kept.append(part)
            yield part

    def keep(self, path: Path) -> list[str]:
        """Write the parts to a file as one, if they were wanted; its name."""
        if self._kept is None:
            return []
        save_toolpath(path, join_toolpaths(self._kept))
        return [path.name]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Plan, write, map: FRESH layer by layer."""
    planned, count = plan(context), Count(wanted=context.stand is not None)
    report(0.2, "writing G-code")
    part = context.recipe.toolpath
    ahead = isinstance(part, Embedded) and part.compensate_lag
    job = stream_gcode(count.along(planned.parts), *machine(context, ahead=ahead), planned.top_mm)
    beside: dict[str, NDArray[Any]] = {}
    if planned.bundles is not None:
        beside = written_beside(context, planned.bundles, ahead=ahead)
        if not planned.bundles.is_plain:
            job = planned.bundles.of_design(job, beside)
    lines = save_gcode(context.folder / GCODE, context.folder / LINE_MAP, job, beside)
    facts, kept = compensation_facts(context)
    figures = planned.report()
    if isinstance(figures, FreshReport):
        for note in (*figures.overlap_notes, *figures.narrow_notes):
            context.bars.remark("toolpath", note)
    notes = []
    if "write_speed_mm_s" in part.model_fields_set:
        notes = speed_notes(
            context.printer, f"toolpath.write_speed_mm_s ({part.write_speed_mm_s:g} mm/s)"
        )
    for note in notes:
        context.bars.remark("toolpath", note)
    summary = {
        "method": context.recipe.toolpath.method,
        **asdict(count),
        "lines": lines,
        **facts,
        "plan": plan_facts(figures),
        **({"notes": notes} if notes else {}),
    }
    return summary, [GCODE, LINE_MAP, *kept, *count.keep(context.folder / PATH)]


def written_beside(
    context: RunContext, bundles: Bundles, *, ahead: bool
) -> dict[str, NDArray[Any]]:
    """What the map of an embedded job holds besides its lines, for the checks that read it."""
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        return {}
    heads = [embedded_options(part, one, context.bath, ahead=ahead) for one in context.loads]
    arrays = written_arrays(
        context.written_network,
        context.place_mm,
        max(one.overlap_radii for one in heads),
        max(one.clearance_mm for one in heads),
        [
            (one.needle_outer_mm, one.tip_outer_mm or one.needle_outer_mm, one.cone_mm)
            for one in heads
        ],
        None if bundles.is_plain else np.bincount(bundles.owner) > 1,
    )
    return arrays | ({"lag_s": np.array(measured_lag_s(context.loads[0]))} if ahead else {})


def plan_facts(planned: FreshReport | EmbeddedReport) -> dict[str, Any]:
    """The plan's own numbers, JSON-ready."""
    facts = asdict(planned)
    if isinstance(planned, FreshReport):
        facts |= {"unfilled": planned.unfilled_fraction, "outside": float(planned.outside.mean())}
    return facts


def reads(context: RunContext) -> tuple[str, ...]:
    """The design; and the tissue, from which a compensated construct is made anew.

    A path along centrelines needs the network alone.
    """
    if isinstance(context.recipe.toolpath, Embedded) and context.compensation is None:
        return (NETWORK,)
    return (NETWORK, SOLID) if context.compensation is None else (NETWORK, SOLID, SURFACE)


STAGE = Stage("toolpath", depends, reads, ("kernels", "design"), work)
