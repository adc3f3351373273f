"""Write the map of G-code lines to layers or vessels of a recovered print's remaining job."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import atomic_replacement
from printctl.machine.prints.recovery import Recovery

MAP: Final = ".map.npz"
OF_LINES: Final = ("source", "move", "kind")
"""What a job's map has of each line (`design.toolpath.gcode.save_gcode`)."""


def write_map(job: Path, plan: Recovery, rest: Path) -> None:
    """Write the rest's map beside it; without a usable map of the job remove an older one.

    Parameters
    ----------
    job : Path
        G-code file of the print.
    plan : Recovery
    rest : Path
        G-code file of what is left.
    """
    arrays = _map_of_rest(job, plan)
    if arrays is None:
        rest.with_suffix(MAP).unlink(missing_ok=True)
        return
    with atomic_replacement(rest.with_suffix(MAP)) as draft, draft.open("wb") as handle:
        np.savez(handle, **arrays)


def _map_of_rest(job: Path, plan: Recovery) -> dict[str, Any] | None:
    """Make the rest's map of the job's; None where there is none that can be used."""
    try:
        with np.load(job.with_suffix(MAP), allow_pickle=False) as arrays_file:
            arrays: dict[str, Any] = {name: arrays_file[name] for name in arrays_file.files}
        lines = _line_count(job.read_bytes())
        if {arrays[name].shape for name in OF_LINES} != {(lines,)}:
            return None
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None
    rows = np.array(plan.rows, np.int64)
    for name in OF_LINES:
        way_in = np.full(_line_count(plan.gcode) - len(rows), -1, dtype=arrays[name].dtype)
        kept = np.where(rows < 0, -1, arrays[name][rows]).astype(arrays[name].dtype)
        arrays[name] = np.append(way_in, kept)
    return arrays


def _line_count(data: bytes) -> int:
    return data.count(b"\n") + (not data.endswith(b"\n"))
