"""Check the lines and drops of a G-code file against the needle's bore."""

from __future__ import annotations

from typing import Final

import numpy as np

from firmware_profiles import Needle, Printer
from firmware_profiles.tools import THINNEST_BORE
from gcode.deposit.lay import Style
from gcode.deposit.written import Layering, written_levels
from gcode.dry_run.run import DryRun
from kernels.arrays import FloatArray, IntArray
from printctl.checks.kinds import Kind
from printctl.checks.line_width import bore_check
from printctl.checks.preflight.ink import volumes
from printctl.checks.set_up import Check, HeadLoading

_FLAT_MM: Final = 1e-3
_FLATTEST: Final = 0.25
"""Height of the lines of a file with one level, in bores: the least that slicers lay."""
_ROUNDED: Final = 0.95
"""Of the limit where the width is read from G-code: what rounding and compensation take."""
_WIDEST: Final[dict[Style, tuple[str, float]]] = {
    "layered": ("lines", 4.0),
    "embedded": ("filaments", 25.0),
}
"""Widest line and thickest filament, in bores: beyond its face a tip can't flatten what it
extrudes; a trunk of 4 mm by a 30G needle, where shipped designs have 11 bores at most."""

_LARGEST_DROP: Final = 15.0
"""Diameter, in bores, of what may come out at one place; shipped filaments have 11."""


def line_checks(
    run: DryRun,
    printer: Printer,
    load_of_head: HeadLoading,
    thinnest: float = THINNEST_BORE,
    style: Style | None = None,
) -> list[Check]:
    """Check the median and the widest line of a G-code file; none where nothing is extruded.

    A pneumatic head's lines are as wide as its flow makes them, which `pneumatic_checks` judges.

    Parameters
    ----------
    run : DryRun
        As one head sees it.
    printer : Printer
        With that head alone.
    load_of_head : HeadLoading
    thinnest : float
        As of `bore_check`.
    style : "layered" or "embedded" or None
        None guesses it: layers where nine tenths of the way are level.
    """
    needle = load_of_head.needle
    if needle is None or printer.pneumatic is not None:
        return []
    line, length, area, z = _laid(run, printer, load_of_head)
    if not len(line):
        return []
    along = length[np.abs(z[:, 1] - z[:, 0]) < _FLAT_MM].sum()
    guessed: Style = "embedded" if along < 0.9 * length.sum() else "layered"
    style = style or guessed
    if style == "embedded":
        width = np.sqrt(4 / np.pi * area)
    else:
        width = _line_widths(area, z[:, 1], load_of_head, needle)
    order = np.argsort(width)
    along = np.cumsum(length[order])
    middle = int(order[np.searchsorted(along, along[-1] / 2)])
    first = int(line[width <= width[middle]][0])
    return [
        bore_check(float(width[middle]), needle, _ROUNDED * thinnest, f"line {first}"),
        *_widest_check(line, length, _least_widths(area, z[:, 1], width), style, needle),
    ]


def _least_widths(area: FloatArray, z: FloatArray, width: FloatArray) -> FloatArray:
    """Widths that the file proves, mm: of a single level nobody knows how high its lines are."""
    round_mm: FloatArray = np.sqrt(4 / np.pi * area)
    return np.minimum(width, round_mm) if len(written_levels(z)) == 1 else width


def _widest_check(
    line: IntArray, length: FloatArray, width: FloatArray, style: Style, needle: Needle
) -> list[Check]:
    """Check the widest line; moves shorter than the bore are doses, not lines."""
    lines = np.flatnonzero(length > needle.inner_mm)
    if not len(lines):
        return []
    widest = int(lines[width[lines].argmax()])
    what, bores = _WIDEST[style]
    limit = bores * needle.inner_mm
    return [
        Check(
            Kind.BEAD_WIDTH,
            "widest bead vs. needle bore",
            float(width[widest]),
            limit,
            "mm",
            bool(width[widest] <= limit),
            f"line {int(line[widest])}, needle: inner_mm",
            f"the maximum for {what} is {bores:g} bores ({needle.name}: {needle.inner_mm:g} mm); "
            "the file was probably made for another syringe, or for a printer whose E isn't "
            "plunger travel in mm: specify the syringe it was made for, or export it for this one",
        )
    ]


def drop_checks(run: DryRun, printer: Printer, load_of_head: HeadLoading) -> list[Check]:
    """Refuse a drop among the lines that is beyond `_LARGEST_DROP`; else say nothing.

    A drop is what comes out at one place, a sphere; moves no longer than the bore don't leave it.
    What comes out above the highest line is a purge.
    """
    needle = load_of_head.needle
    if needle is None or printer.pneumatic is not None:
        return []
    program = run.program
    ul, length, _ = _pushed(run, printer, load_of_head)
    moves = length > needle.inner_mm
    top = program.target[moves & (ul > 0), 2].max(initial=-np.inf)
    rests = np.flatnonzero((ul > 0) & ~moves & (program.target[:, 2] <= top + _FLAT_MM))
    place = np.cumsum(moves)[rests]
    drops = np.bincount(place, weights=ul[rests], minlength=1)
    largest = int(drops.argmax())
    diameter, limit = float(np.cbrt(6 / np.pi * drops[largest])), _LARGEST_DROP * needle.inner_mm
    if diameter <= limit:
        return []
    return [
        Check(
            Kind.DROP,
            "largest drop vs. needle bore",
            diameter,
            limit,
            "mm",
            False,
            f"line {int(program.line[rests[place == largest][0]])}, needle: inner_mm",
            f"{drops[largest]:.3g} µL are dispensed at one point between beads; the file was "
            "probably made for a printer whose E isn't plunger travel in mm: export it for this "
            "one, or purge above the bath",
        )
    ]


def _laid(
    run: DryRun, printer: Printer, load_of_head: HeadLoading
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Line of the file, way, cross-section and heights at both ends of each row that lays ink."""
    ul, length, z = _pushed(run, printer, load_of_head)
    lays = (ul > 0) & (length > _FLAT_MM)
    return run.program.line[lays], length[lays], ul[lays] / length[lays], z[lays]


def _pushed(
    run: DryRun, printer: Printer, load_of_head: HeadLoading
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ink (n,), µL, way (n,) and heights at both ends (n, 2), mm, of each row."""
    program = run.program
    ul = volumes(run, printer, [load_of_head] * (int(program.tool.max(initial=0)) + 1))
    ends = np.vstack([program.start[None, :3], program.target[:, :3]])
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    return ul, length, np.stack([ends[:-1, 2], ends[1:, 2]], axis=1)


def _line_widths(area: FloatArray, z: FloatArray, held: HeadLoading, needle: Needle) -> FloatArray:
    """Width of each line of layers, mm."""
    section = held.ink.bead_section
    if len(written_levels(z)) == 1:
        return section.width(area, _FLATTEST * needle.inner_mm)
    return section.width(area, Layering.at(z, area).heights(z))
