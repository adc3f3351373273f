"""Write a toolpath as G-code, in one call or streamed in parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.errors import ToolpathError
from design.files import atomic_replacement
from design.toolpath.gcode.job import Gcode, GcodeOptions
from design.toolpath.gcode.writer import Writer
from design.toolpath.toolpath import Toolpath
from firmware_profiles import Printer, Syringe


def write_gcode(
    toolpath: Toolpath,
    printer: Printer,
    syringe: Syringe,
    place_mm: ArrayLike,
    options: GcodeOptions | None = None,
) -> Gcode:
    """Write ``toolpath``, moved by ``place_mm``, in the dialect of the printer's firmware.

    Positions are absolute mm (G21, G90); E is the plunger's absolute travel in mm (M82) and is
    rounded once from the running total, so that it never drifts. The job doesn't home. It goes
    straight up or down to a height above the whole toolpath, across, and down to the first
    point; so the tip must begin outside the dish's walls and no lower than they allow. At the end
    it relieves the plunger and goes straight up. Feeds are lowered where an axis' limit asks
    for it. Writing moves shorter than the firmware's least are merged. Comments mark where the
    job may be interrupted (`design.toolpath.gcode.marks`).

    A pneumatic head's job has no E: a valve opens before each written path and closes after it,
    and the speed of each move follows from the flow (`design.toolpath.gcode.pneumatic`).

    Of several heads the toolpath says which makes each move, the options what each holds; how they
    are changed says `design.toolpath.gcode.writer`.

    Parameters
    ----------
    toolpath : Toolpath
    printer : Printer
    syringe : Syringe
    place_mm : (3,) array, mm
        From the part's frame to the printer's.
    options : GcodeOptions

    Raises
    ------
    ToolpathError
        For a head that the printer hasn't, a change of heads above the end of z, a line longer
        than the firmware takes, one move that pushes more than E can hold, or a speed that a
        pneumatic head's flow asks for and printer or ink don't bear.
    """
    parts = stream_gcode([toolpath], printer, syringe, place_mm, options, toolpath.top_mm)
    return Gcode.joined(list(parts))


def stream_gcode(
    toolpaths: Iterable[Toolpath],
    printer: Printer,
    syringe: Syringe,
    place_mm: ArrayLike,
    options: GcodeOptions | None,
    top_mm: float,
) -> Iterator[Gcode]:
    """Write a job whose toolpath comes in parts, as `write_gcode` would write their whole.

    Each part begins where the one before it ended, with a travel or standing, and is given back as
    soon as the next one is there: so a job of any length needs the memory of two parts.

    Parameters
    ----------
    toolpaths : iterable of Toolpath
        None of them empty: layers, or any number of whole layers each.
    printer, syringe, place_mm, options
        As for `write_gcode`.
    top_mm : float, mm
        Highest that the tip goes in any part, in the part's frame.

    Raises
    ------
    ToolpathError
        As `write_gcode`; when no part comes, or one goes above ``top_mm``.
    """
    place = np.asarray(place_mm, dtype=np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ToolpathError(f"place_mm is {place}; give three finite numbers, mm")
    parts = iter(toolpaths)
    ahead = next(parts, None)
    if ahead is None:
        raise ToolpathError("the toolpath has no moves; there is nothing to write")
    writer = Writer(printer, syringe, place, options or GcodeOptions(), top_mm)
    while ahead is not None:
        part, ahead = ahead, next(parts, None)
        yield writer.write(part, last=ahead is None)


def save_gcode(
    path: Path,
    map_path: Path,
    parts: Iterable[Gcode],
    beside: Mapping[str, NDArray[Any]] | None = None,
) -> int:
    """Write the parts of a job to ``path`` one by one, then their map; return the command count.

    The map (NPZ) has ``source``, ``move`` and ``kind`` of each line, as in `Gcode`,
    ``source_kind``, and what is given as ``beside``. Neither file takes its name before all parts
    are written.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    lines = 0
    source, move, kind, counts = [], [], [], "layer"
    with atomic_replacement(path) as draft, atomic_replacement(map_path) as map_draft:
        with draft.open("wb") as handle:
            for part in parts:
                handle.write(part.data)
                lines += part.line_count
                source.append(part.line_source.astype(np.int32))
                move.append(part.line_move.astype(np.int32))
                kind.append(part.line_kind.astype(np.int8))
                counts = part.source_kind
        with map_draft.open("wb") as handle:
            arrays: dict[str, Any] = {
                "source": np.concatenate(source),
                "move": np.concatenate(move),
                "kind": np.concatenate(kind),
                "source_kind": np.array(counts),
                **(beside or {}),
            }
            np.savez(handle, **arrays)
    return lines
