"""Check a G-code file for needle shaft collisions with ink, by the map of its lines to vessels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from printctl.checks.preflight.shaft import accepted_text, shaft_checks, shaft_lines, unmapped_check
from printctl.checks.preflight.shaft_map import read_written
from printctl.checks.preflight.shaft_run import shaft_clearance
from printctl.checks.set_up import Check, SetUp
from printctl.errors import UsageError
from sim.gcode.dry_run.run import DryRun

if TYPE_CHECKING:
    from sim.gcode.clearance import Clearance

_LEVEL_MM = 1e-3


@dataclass(frozen=True)
class FileShaft:
    """What the checker says of a file.

    Attributes
    ----------
    checks : list of Check
        None for a file of layers.
    found : Clearance or None
        None where it wasn't looked at.
    accepted : tuple of str
        What the user took, for the journal.
    """

    checks: list[Check]
    found: Clearance | None = None
    accepted: tuple[str, ...] = ()

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return {} if self.found is None else {"clearance": self.found.as_dict()}

    def lines(self) -> list[str]:
        """For people."""
        return [] if self.found is None else shaft_lines(self.found.as_dict())


def file_shaft(file: Path, run: DryRun, mounted: SetUp, *, accepted: bool = False) -> FileShaft:
    """Check a file's shaft.

    Parameters
    ----------
    file : Path
        Its map, ``FILE.map.npz``, stands beside it.
    run : DryRun
    mounted : SetUp
    accepted : bool
        Whether the user prints with crossings.

    Raises
    ------
    UsageError
        For a map that can't be read, or of another file.
    """
    path = file.with_suffix(".map.npz")
    if not path.is_file():
        return FileShaft([unmapped_check()] if _climbs(run) else [])
    written = read_written(path)
    if written is None:
        return FileShaft([])
    _check_lines(file, path, len(written.sources.vessel))
    loads = [mounted.load_of(number) for number in range(mounted.printer.head_count)]
    clearance = shaft_clearance(run, mounted.printer, loads, written)
    text = accepted_text(clearance)
    return FileShaft(
        shaft_checks(clearance, 0, accepted=accepted),
        clearance,
        (text,) if accepted and text else (),
    )


def _check_lines(file: Path, path: Path, mapped: int) -> None:
    data = file.read_bytes()
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    if lines != mapped:
        raise UsageError(
            f"{path.name} is of a file of {mapped} lines, and {file.name} has {lines}: it belongs "
            "to another job, so the needle's shaft can't be checked; write both anew with "
            "`printctl toolpath`, or move the map away"
        )


def _climbs(run: DryRun) -> bool:
    """Whether ink is pushed on the way up or down, as no layer does it."""
    height = np.diff(run.program.target[:, 2], prepend=run.program.start[2])
    return bool((run.doses & (np.abs(height) > _LEVEL_MM)).any())
