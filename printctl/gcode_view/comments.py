"""What slicers say in comments: kinds of lines, layer heights, the filament, their own name."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim.gcode import parse_line

IntArray = NDArray[np.int64]

# A literal "\n;" to begin with lets the search skip lines of moves ten times faster than "^;" does.
_KIND: Final = re.compile(rb"\n;[ ]*(?:TYPE:|FEATURE:|feature )[ ]*([^\n]*?)[ ]*(?=\n|\Z)")
_HEIGHT: Final = re.compile(rb"\n;[ ]*(?:HEIGHT:|LAYER_HEIGHT:)[ ]*(\d*\.?\d+)")
_LAYER: Final = re.compile(rb"\n;[ ]*(?:LAYER_CHANGE|CHANGE_LAYER|LAYER:\d+)")
_FILAMENT: Final = re.compile(rb"\n;[ ]*filament_diameter[ ]*[=:][ ]*(\d*\.?\d+)")
_STADIUM: Final = re.compile(rb"PrusaSlicer|SuperSlicer|OrcaSlicer|BambuStudio|Slic3r")
_MADE_BY: Final = 4000
"""Bytes at the file's head within which a slicer says its name."""
_BEFORE_MOVING: Final = 200


def plain_lines(gcode: bytes) -> bytes:
    """The same with every line ended by a line feed; a carriage return ends one, too."""
    if b"\r" not in gcode:
        return gcode
    return gcode.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


@dataclass(frozen=True, eq=False)
class Comments:
    """What the comments tell.

    Attributes
    ----------
    kind_lines, kind : (k,) int64
        Line of each comment and the place in `kinds` of what it says.
    kinds : tuple of str
    height_lines : (h,) int64
    height_mm : (h,) float64, mm
        Of the layer that begins there.
    layer_lines : (m,) int64
        Where a new layer begins.
    filament_mm : float or None, mm
        Diameter that the slicer counts E in.
    stadium : bool
        Whether the slicer takes lines as flat bands with round sides; else as bands with straight
        sides.
    """

    kind_lines: IntArray
    kind: IntArray
    kinds: tuple[str, ...]
    height_lines: IntArray
    height_mm: NDArray[np.float64]
    layer_lines: IntArray
    filament_mm: float | None
    stadium: bool


def read_comments(text: bytes) -> Comments:
    """Read a file of `plain_lines`."""
    text = b"\n" + text
    begins = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    kinds: dict[str, int] = {}
    found = list(_KIND.finditer(text))
    names = [match[1].decode("utf-8", "replace") or "no name" for match in found]
    kind = [kinds.setdefault(name, len(kinds)) for name in names]
    heights = list(_HEIGHT.finditer(text))
    filament = _FILAMENT.search(text)
    return Comments(
        kind_lines=_lines(found, begins),
        kind=np.array(kind, np.int64),
        kinds=tuple(kinds),
        height_lines=_lines(heights, begins),
        height_mm=np.array([float(match[1]) for match in heights]),
        layer_lines=_lines(list(_LAYER.finditer(text)), begins),
        filament_mm=float(filament[1]) if filament and float(filament[1]) > 0 else None,
        stadium=_STADIUM.search(text[:_MADE_BY]) is not None,
    )


def _lines(found: list[re.Match[bytes]], begins: IntArray) -> IntArray:
    """Line number of each match, from 1."""
    return np.searchsorted(begins, np.array([match.start() for match in found], np.int64)) + 1


def said_start(text: bytes) -> tuple[float, float, float] | None:
    """Where the file itself says that the tip stands before it moves (G92 X Y Z), mm."""
    for line in text[: 100 * _BEFORE_MOVING].split(b"\n")[:_BEFORE_MOVING]:
        command = parse_line(line)
        if command.name in ("G0", "G1", "G2", "G3", "G28", "G20"):
            return None
        if command.name == "G92" and all(axis in command.values for axis in "XYZ"):
            return command.values["X"], command.values["Y"], command.values["Z"]
    return None
