"""Print heads of a recipe: contents, assigned vessels, line widths, writer options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from design.network import VesselKind, VesselNetwork
from design.toolpath.gcode import GcodeOptions, HeadLoad
from firmware_profiles import Ink, Needle, Printer, Syringe, load, steady_flow
from kernels.arrays import IntArray
from printctl.checks.set_up import HeadLoading
from printctl.errors import UsageError

if TYPE_CHECKING:  # `printctl slice` has no recipe
    from printctl.recipe.sections.making import HeadPart, PrinterPart
    from printctl.recipe.sections.toolpath import Fresh


@dataclass(frozen=True)
class Filled(HeadLoading):
    """Loading of a head whose needle is known."""

    needle: Needle


def filled_heads(
    part: PrinterPart, needle: str, printer: Printer, ink: Ink | None = None
) -> tuple[Filled, ...]:
    """Load what each head holds; of a printer with one the recipe's syringe, ink and needle.

    Parameters
    ----------
    part : PrinterPart
    needle : str
        Profile for heads that name none.
    printer : Printer
    ink : Ink, optional
        In the place of the one head's.

    Raises
    ------
    UsageError
        When the recipe names other heads than the printer has.
    ProfileError
        When a profile is missing or wrong.
    """
    if not part.heads:
        held = load(Ink, part.ink) if ink is None else ink
        one = Filled(load(Syringe, part.syringe), held, load(Needle, needle))
        return (one,) * printer.head_count
    if len(part.heads) != printer.head_count:
        raise UsageError(
            f"printer.heads names {len(part.heads)}, and {printer.name} has "
            f"{printer.head_count}; name what each holds, or choose another profile"
        )
    return tuple(
        Filled(
            load(Syringe, head.syringe), load(Ink, head.ink), load(Needle, head.needle or needle)
        )
        for head in part.heads
    )


def needle_options(needle: Needle) -> dict[str, Any]:
    """A needle's measures as `EmbeddedOptions` calls them, mm."""
    return {
        "needle_inner_mm": needle.inner_mm,
        "needle_outer_mm": needle.outer_mm,
        "tip_outer_mm": needle.tip_outer_mm or 0.0,
        "cone_mm": needle.cone_mm or 0.0,
    }


_NOBODY = -1


def vessel_heads(network: VesselNetwork, heads: Sequence[HeadPart]) -> IntArray:
    """Head of each vessel, (v,).

    A head's `trees` count before any head's `kinds`; what nobody names the head writes that names
    nothing, or the first one where none names anything.

    Parameters
    ----------
    network : VesselNetwork
    heads : sequence of HeadPart
        Empty for a printer with one.

    Raises
    ------
    UsageError
        For a vessel that no head is to write.
    """
    if all(head.writes_the_rest for head in heads):
        return np.zeros(len(network.kind), dtype=np.int64)
    head_of = np.full(len(network.kind), _NOBODY, dtype=np.int64)
    for number, head in enumerate(heads):
        kinds = [int(VesselKind[kind.upper()]) for kind in head.kinds]
        head_of[np.isin(network.kind, kinds)] = number
    for number, head in enumerate(heads):
        head_of[np.isin(network.tree, list(head.trees))] = number
    rest = next((k for k, head in enumerate(heads) if head.writes_the_rest), _NOBODY)
    head_of[head_of == _NOBODY] = rest
    nobody = np.flatnonzero(head_of == _NOBODY)
    if len(nobody):
        vessel = int(nobody[0])
        kind = VesselKind(int(network.kind[vessel])).name.lower()
        raise UsageError(
            f"vessel {vessel} ({kind}, tree {int(network.tree[vessel])}) is written by no head, "
            f"nor are {len(nobody) - 1} more; name its kind or tree in printer.heads, or let one "
            "head name neither: it writes the rest"
        )
    return head_of


def layer_lines_um(part: Fresh, heads: Sequence[HeadPart], count: int) -> list[float]:
    """Width of each head's lines in layers, µm: a region's own, else the toolpath's.

    Parameters
    ----------
    part : Fresh
    heads : sequence of HeadPart
        Empty for a printer with one.
    count : int
        How many heads the printer has.

    Raises
    ------
    UsageError
        When a region's head isn't there, two regions of a head ask for lines of two widths, or a
        head names vessels, which are no lines in layers.
    """
    for number, head in enumerate(heads):
        if not head.writes_the_rest:
            raise UsageError(
                f"printer.heads.{number} names kinds or trees: vessels are written into a bath "
                "and left open in layers; name the head in toolpath.regions instead (head)"
            )
    widths = [part.line_um] * count
    region_of: dict[int, int] = {}
    for number, region in enumerate(part.regions):
        if region.head is None:
            continue
        if region.head >= count:
            raise UsageError(
                f"toolpath.regions.{number}: head is {region.head}, and the printer has {count} "
                "(counted from 0); name one of them, or choose another profile"
            )
        if region.line_um is None:
            continue
        first = region_of.setdefault(region.head, number)
        widths[region.head] = region.line_um
        if part.regions[first].line_um != region.line_um:
            raise UsageError(
                f"toolpath.regions.{number}: line_um is {region.line_um:g}, and region {first} "
                f"gives the same head {part.regions[first].line_um:g}; a needle writes lines of "
                "one width"
            )
    return widths


def head_loads(printer: Printer, loads: Sequence[HeadLoading]) -> tuple[HeadLoad, ...]:
    """What the writer is told of each head; a pneumatic one's flow where its needle is known.

    Raises
    ------
    ProfileError
        When a head's pressure doesn't move its ink.
    """
    each = []
    for number, one in enumerate(loads):
        air, span, flow = printer.of_head(number).pneumatic, one.ink.write_speed_mm_s, None
        if air is not None and one.needle is not None:
            flow = steady_flow(air, one.ink, one.needle).ul_s
        each.append(
            HeadLoad(
                one.syringe,
                one.ink.flow_factor,
                one.ink.retract_ul,
                one.ink.plunger_ul_s,
                flow,
                None if span is None else (span.low, span.high),
            )
        )
    return tuple(each)


def speed_notes(printer: Printer, speed: str) -> list[str]:
    """A sentence on ``speed``, as the user gave it, where air sets the speed; else none."""
    if not printer.airs:
        return []
    which = "" if len(printer.airs) == max(1, len(printer.heads)) else "the pneumatic heads of "
    pressures = " and ".join(f"{head.pressure_kpa:g} kPa" for head in printer.airs)
    return [
        f"{speed} isn't used for {which}{printer.name}: the pressure ({pressures}) fixes the flow, "
        "and each line is written at flow × length / volume; to change that speed, change the "
        "pressure, the needle or the line's width"
    ]


def gcode_options(
    ink: Ink,
    start_mm: tuple[float, float, float],
    travel_speed_mm_s: float,
    flow_ul_s: float | None,
) -> GcodeOptions:
    """The writer's choices for an ink; ``flow_ul_s`` is a pneumatic head's, else None."""
    span = ink.write_speed_mm_s
    return GcodeOptions(
        start_mm=start_mm,
        travel_speed_mm_s=travel_speed_mm_s,
        relieve_ul=ink.retract_ul,
        plunger_ul_s=ink.plunger_ul_s,
        flow_factor=ink.flow_factor,
        flow_ul_s=flow_ul_s,
        ink_speed_mm_s=None if span is None else (span.low, span.high),
    )
