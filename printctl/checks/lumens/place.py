"""Find a part's origin in the printer's frame from the printed lines or filaments."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.network import VesselNetwork
from design.solids import Solid
from design.solids.manifolds import solid_manifold
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.lines import WrittenLines
from printctl.errors import UsageError
from sim.gcode.deposit.strands import Strands

TOLERANCE_MM: Final = 0.1
"""Ink and part may differ in size by this; by more, what is written isn't the part alone."""
LAYERS: Final = 60
"""Compared, evenly chosen."""


def find_place(lines: WrittenLines, part: Solid) -> FloatArray:
    """The part's origin in the printer's frame, (3,), mm: layers of ink over the part's sections.

    Median over the layers, so that one blot of ink at the rim moves nothing.

    Parameters
    ----------
    lines : WrittenLines
    part : Solid
        In its own frame, with or without its lumens.

    Raises
    ------
    UsageError
        When the sizes differ, so that something else is written too (a skirt, a purge line), or
        the part is turned or scaled.
    SolidError
        When the part isn't closed.
    """
    low, high = part.bounds
    height = float(high[2] - low[2])
    wrote = float(lines.high[-1] - lines.low[0])
    if abs(wrote - height) > float((lines.high - lines.low).max()):
        raise UsageError(
            f"ink is written over {wrote:.3f} mm of height, the part is {height:.3f} mm high: "
            f"{_REMEDY}"
        )
    z = float(lines.low[0] - low[2])
    chosen = np.unique(np.linspace(0, len(lines.low) - 1, LAYERS).round().astype(np.int64))
    asked = _sections(part, (lines.low + lines.high)[chosen] / 2 - z)
    ink = _ink(lines)[chosen]
    size, has = np.median((ink - asked)[:, 1] - (ink - asked)[:, 0], axis=0), asked[0]
    if not (np.abs(size) <= TOLERANCE_MM).all():
        here = ink[0, 1] - ink[0, 0]
        raise UsageError(
            f"ink is written over {_by(here)} mm in the lowest layer, the part there is "
            f"{_by(has[1] - has[0])} mm: {_REMEDY}"
        )
    middle = np.median((ink - asked).mean(axis=1), axis=0)
    return np.array([*middle, z])


def find_filament_place(strands: Strands, network: VesselNetwork) -> FloatArray:
    """The part's origin in the printer's frame, (3,), mm: written axes over the designed ones.

    Raises
    ------
    UsageError
        When the written box isn't as large as the network's, so that something else is written
        too, or overlaps reach beyond it.
    """
    asked = np.array([network.points.min(axis=0), network.points.max(axis=0)])
    ends = np.concatenate([strands.start, strands.end])
    wrote = np.array([ends.min(axis=0), ends.max(axis=0)])
    shift: FloatArray = wrote - asked
    if np.abs(shift[1] - shift[0]).max() > TOLERANCE_MM:
        raise UsageError(
            f"filaments are written over {_by(wrote[1] - wrote[0])} mm, the network's axes over "
            f"{_by(asked[1] - asked[0])} mm: {_REMEDY}"
        )
    place: FloatArray = shift.mean(axis=0)
    return place


_REMEDY: Final = (
    "where the part stands can't be told from that (a skirt or purge line, another part, scaled "
    "or turned); give --place X,Y,Z, the part's origin in the printer's frame"
)


def _sections(part: Solid, heights: FloatArray) -> FloatArray:
    """Bounds of the part's sections, (k, 2, 2), mm; NaN where there is none."""
    body = solid_manifold(part, "the part")
    bounds = np.full((len(heights), 2, 2), np.nan)
    for k, z in enumerate(heights):
        section = body.slice(float(z))
        if not section.is_empty():
            bounds[k] = np.reshape(section.bounds(), (2, 2))
    return bounds


def _ink(lines: WrittenLines) -> FloatArray:
    """Bounds of each layer's ink, (k, 2, 2), mm."""
    half = lines.width[:, None] / 2
    order: IntArray = np.argsort(lines.layer, kind="stable").astype(np.int64)
    first = np.searchsorted(lines.layer[order], np.arange(len(lines.low)))
    low = (np.minimum(lines.start, lines.end) - half)[order]
    high = (np.maximum(lines.start, lines.end) + half)[order]
    return np.stack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)], axis=1)


def _by(size: FloatArray) -> str:
    return " x ".join(f"{value:.3f}" for value in size)
