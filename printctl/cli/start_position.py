"""Start position of a job, from the G-code file's first lines or from `--start`."""

from __future__ import annotations

import math
from pathlib import Path

from firmware_profiles import Printer
from printctl.cli.options import read_gcode_file, three_numbers
from printctl.errors import UsageError
from printctl.machine.link.errors import LinkError
from printctl.machine.link.job import parse_job
from printctl.machine.link.job_start import declared_start
from printctl.machine.link.start_checks import ASIDE_MM

Place = tuple[float, float, float]


def read_start_position(file: Path, printer: Printer, text: str | None) -> Place:
    """Return the tip's position before the first line, mm.

    Parameters
    ----------
    file : Path
        Its first lines may tell the firmware (G92, SET_KINEMATIC_POSITION).
    printer : Printer
    text : str or None
        ``--start``.

    Raises
    ------
    UsageError
        When the two aren't the same place, or the file tells a part of it and nobody the rest.
    """
    given = None if text is None else three_numbers(text, "--start")
    declared = _declared(file, printer, given)
    if declared is None:
        return given or (0.0, 0.0, 0.0)
    if given is not None and math.dist(given, declared) > ASIDE_MM:
        raise UsageError(
            f"--start {text}: the first lines of {file} tell the printer that the tip stands at "
            f"{','.join(f'{mm:g}' for mm in declared)}; leave --start out, or correct the file"
        )
    return declared


def _declared(file: Path, printer: Printer, given: Place | None) -> Place | None:
    """Where the job says that it starts; None where it doesn't, or other checks refuse it."""
    try:
        job = parse_job(read_gcode_file(file), file.name, printer)
    except LinkError:
        return None
    try:
        return declared_start(job)
    except LinkError as exc:
        if given is not None:
            return None
        raise UsageError(f"{file}: {exc}, or give --start X,Y,Z") from exc
