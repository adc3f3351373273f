"""Refuse a recipe whose profiles, network or observation can't be printed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from design.hemodynamics import scaled_network
from design.network import VesselNetwork
from design.network_files.by_suffix import read_network
from design.toolpath.embedded import EmbeddedOptions, check_thinnest
from design.toolpath.fresh import FreshOptions, check_lumens
from firmware_profiles import Bath, Dish, Printer, load
from kernels.arrays import FloatArray
from printctl.checks.kinds import Kind
from printctl.checks.line_width import bore_check, shipped_bores
from printctl.checks.preflight.dish import hub_check, wall_check
from printctl.checks.preflight.mounted import (
    bath_checks,
    chemistry_check,
    held_check,
    needle_check,
    profile_checks,
    role_checks,
)
from printctl.checks.set_up import Check, PlacedDish, refuse_failed
from printctl.errors import UsageError
from printctl.machine.ports.detection import runs_files
from printctl.pipeline.context import RunContext
from printctl.pipeline.job.heads import (
    Filled,
    filled_heads,
    layer_lines_um,
    needle_options,
    vessel_heads,
)
from printctl.recipe import Recipe
from printctl.recipe.sections.growth import GivenNetwork
from printctl.recipe.sections.tissue import Annulus, Block, Cylinder
from printctl.recipe.sections.toolpath import Embedded, Fresh

_SIMULATED = "simulated"


def refuse_unobservable(recipe: Recipe, printer: Printer) -> None:
    """Refuse what an observer can't do, before anything is made.

    Raises
    ------
    UsageError
        For several heads or a valve, a plate, a controller that runs files by itself, no device, or
        a laser line over a bath.
    """
    part = recipe.observe
    if part is None:
        return
    if printer.heads or printer.pneumatic is not None or not printer.streamed:
        raise UsageError(
            f"observe: {printer.name} has several heads, a valve, or runs files by itself, and "
            "mends are put into the lines of one plunger; leave observe out"
        )
    if runs_files(recipe.printer.port):
        raise UsageError(
            f"observe: {recipe.printer.port} runs the file by itself and can't be held for an "
            "inspection; leave observe out, or print over serial or TCP"
        )
    if recipe.plate is not None:
        raise UsageError("observe: prints of a plate can't be observed; leave observe out")
    covered = isinstance(recipe.toolpath, Embedded) or recipe.printer.bath_depth_mm is not None
    if part.device == "laser_line" and covered:
        raise UsageError(
            "observe.device is laser_line, and what is printed lies in a bath (vessels written "
            "into it, or printer.bath_depth_mm above the part): of that a laser line sees the "
            "bath's surface alone; take oct or camera, or print layers that lie bare"
        )
    if not part.source and recipe.printer.port != _SIMULATED:
        raise UsageError(
            f"observe: no source is named, which means a simulated {part.device}, but port is "
            f"{recipe.printer.port}; name the {part.device} (source)"
        )


def refuse_before(recipe: Recipe, recipe_folder: Path) -> None:
    """Refuse a recipe whose profiles or given network can't be printed.

    A plate's wells vary what is looked at here, and a compensation changes the network: both are
    left to the stages.

    Raises
    ------
    SafetyError
        With every check that failed.
    ToolpathError
        For a vessel that the needle or the layers can't make.
    UsageError
        For heads that the printer hasn't, a vessel that no head writes, or a print that can't be
        observed as asked.
    NetworkError, ProfileError, OSError
        When a file is wrong or can't be read.
    """
    printer = load(Printer, recipe.printer.profile)
    refuse_unobservable(recipe, printer)
    if recipe.plate is not None:
        return
    heads = filled_heads(recipe.printer, recipe.toolpath.needle, printer)
    bath = load(Bath, recipe.printer.bath)
    checks = [] if printer.heads else list(_mounted(printer, heads[0], bath))
    checks += role_checks([one.ink for one in heads], bath, recipe.toolpath.written)
    checks += _lines(recipe, printer, heads)
    checks += _block_placed(recipe, printer)
    given = recipe.vasculature
    if not isinstance(given, GivenNetwork) or recipe.toolpath.compensation is not None:
        refuse_failed(checks)
        return
    network = scaled_network(
        read_network(recipe_folder / given.network, given.unit), recipe.print_scale
    )
    if isinstance(recipe.toolpath, Fresh):
        refuse_failed(checks)
        _check_layers(recipe, recipe.toolpath, printer, heads, network)
        return
    checks += [needle_check(_depth_mm(recipe, network), one.needle) for one in heads]
    if not printer.heads:
        checks.append(held_check(2 * float(network.radius.max()), heads[0].ink, bath))
        checks += _placed(recipe, printer, heads[0], network)
    refuse_failed(checks)
    _check_filaments(recipe, recipe.toolpath, heads, network)


def _mounted(printer: Printer, held: Filled, bath: Bath) -> Iterator[Check]:
    """What profiles say of each other."""
    if not printer.pneumatic:
        yield from profile_checks(held.syringe)
    yield chemistry_check(held.ink, bath)
    yield from bath_checks(bath)


def _lines(recipe: Recipe, printer: Printer, heads: Sequence[Filled]) -> Iterator[Check]:
    """Whether the needles write lines as narrow as the layers'."""
    part = recipe.toolpath
    if isinstance(part, Fresh):
        widths = layer_lines_um(part, recipe.printer.heads, printer.head_count)
        for line_um, one in zip(widths, heads, strict=True):
            yield bore_check(line_um * 1e-3, one.needle, part.thinnest_bore, "toolpath.line_um")


def _block_placed(recipe: Recipe, printer: Printer) -> Iterator[Check]:
    """Whether a block in layers lies within the printer's travel, where its place is said."""
    tissue, place = recipe.tissue, recipe.printer.place_mm
    if printer.heads or place is None or not isinstance(tissue, Block):
        return
    if isinstance(recipe.toolpath, Fresh) and not (tissue.keep_out or tissue.keep_within):
        corners = np.array([(0.0, 0.0, 0.0), tissue.size_mm]) * recipe.print_scale
        yield from reach_checks(corners + np.array(place), printer, "part")


def _depth_mm(recipe: Recipe, network: VesselNetwork) -> float:
    """Depth of the part where its shape says it, else of the network in it, mm."""
    tissue = recipe.tissue
    if not (tissue.keep_out or tissue.keep_within):
        if isinstance(tissue, Block):
            return tissue.size_mm[2] * recipe.print_scale
        if isinstance(tissue, Cylinder | Annulus):
            return tissue.height_mm * recipe.print_scale
    return float(np.ptp(network.points[:, 2]))


def _placed(
    recipe: Recipe, printer: Printer, held: Filled, network: VesselNetwork
) -> Iterator[Check]:
    """Whether the network fits into the printer, and where its place is said, into the dish."""
    part = recipe.printer
    if part.place_mm is None:
        yield from _size_checks(network.points, printer)
        return
    points = network.points + np.array(part.place_mm)
    yield from reach_checks(points, printer)
    if part.dish is None or part.dish_centre_mm is None:
        return
    standing = PlacedDish(load(Dish, part.dish), part.dish_centre_mm, printer.z_mm.low)
    tips, moves = np.stack([points, points], axis=1), np.ones(len(points), np.bool_)
    yield wall_check(tips, moves, standing, held.needle, _vessel_of(network))
    yield hub_check(tips, moves, standing, held.needle, _vessel_of(network))


def _vessel_of(network: VesselNetwork) -> Sequence[str]:
    counts = np.diff(network.offset)
    return [f"vessel {k}" for k in np.repeat(np.arange(len(counts)), counts).tolist()]


def _size_checks(points: FloatArray, printer: Printer) -> Iterator[Check]:
    """Whether the printer is as large as the network, wherever that is put."""
    for axis, span in enumerate((printer.x_mm, printer.y_mm, printer.z_mm)):
        name, size = "xyz"[axis], float(np.ptp(points[:, axis]))
        yield Check(
            Kind.TRAVEL,
            f"length of the network in {name}",
            size,
            span.high - span.low,
            "mm",
            size <= span.high - span.low,
            f"printer: {name}_mm",
            "take a larger printer or a smaller part; check the network's unit",
        )


def reach_checks(points: FloatArray, printer: Printer, what: str = "network") -> Iterator[Check]:
    """Whether every point lies within the printer's travel.

    Parameters
    ----------
    points : (n, 3) float64, mm
        Printer's frame; of the axes, or corners of the part.
    printer : Printer
    what : str
        Whose points they are, for messages.
    """
    for axis, span in enumerate((printer.x_mm, printer.y_mm, printer.z_mm)):
        name = "xyz"[axis]
        low, high = float(points[:, axis].min()), float(points[:, axis].max())
        for value, limit, end in ((low, span.low, "low"), (high, span.high, "high")):
            yield Check(
                Kind.TRAVEL,
                f"{'least' if end == 'low' else 'greatest'} {name} of the {what}",
                value,
                limit,
                "mm",
                bool(np.isfinite(value)) and (value >= limit if end == "low" else value <= limit),
                f"printer: {name}_mm.{end}",
                "place the part elsewhere (printer.place_mm), or take a larger printer",
            )


def _check_layers(
    recipe: Recipe,
    part: Fresh,
    printer: Printer,
    heads: Sequence[Filled],
    network: VesselNetwork,
) -> None:
    widths = layer_lines_um(part, recipe.printer.heads, printer.head_count)
    for line_um, one in zip(widths, heads, strict=True):
        options = FreshOptions(
            layer_height_mm=part.layer_um * 1e-3,
            line_width_mm=line_um * 1e-3,
            bead=one.ink.bead_section,
        )
        check_lumens(network, options)


def _check_filaments(
    recipe: Recipe, part: Embedded, heads: Sequence[Filled], network: VesselNetwork
) -> None:
    """Refuse vessels thinner than their head's needle can write."""
    writer = vessel_heads(network, recipe.printer.heads)
    for number, one in enumerate(heads):
        options = EmbeddedOptions(**needle_options(one.needle), thinnest=part.thinnest_bore)
        thin = 2 * float(network.radius.min()) < options.smallest_lumen_mm
        needles = shipped_bores() if thin else None
        check_thinnest(network, options, np.flatnonzero(writer == number), needles)


def refuse_early(context: RunContext) -> None:
    """Refuse what the needles or the printer can't reach: an embedded network, layers of a part.

    The same is asked of the G-code again, which knows of ways and overlaps too.

    Raises
    ------
    SafetyError
        With every check that failed.
    """
    bounds, checks = context.written_bounds, []
    embedded = isinstance(context.recipe.toolpath, Embedded)
    if embedded:
        depth = float(np.ptp(bounds[:, 2]))
        checks += [needle_check(depth, load.needle) for load in context.loads]
    if not context.printer.heads:
        # Several heads stand apart from the carriage: their reach is looked at in the G-code.
        points, what = (context.written_network.points, "network") if embedded else (bounds, "part")
        checks += reach_checks(points + context.place_mm, context.printer, what)
    refuse_failed(checks)
