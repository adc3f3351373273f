"""Read the tip position that a job's first lines declare to the firmware (G92)."""

from __future__ import annotations

from printctl.machine.errors import LinkError
from printctl.machine.job.frame import renamings
from printctl.machine.job.job import Job
from printctl.machine.job.modal import declared_axes
from sim.gcode.reading import code_of, is_motion


def declared_start(job: Job) -> tuple[float, float, float] | None:
    """Tip position that the job's first lines declare; None where they don't.

    Of each axis the first word before any move counts: what is told later renames places, and
    the dry run follows it.

    Raises
    ------
    LinkError
        Where some of X, Y and Z are told there, or any is told behind a move, and not all three
        before it: nobody knows then where the checks ought to begin.
    """
    words: dict[str, float] = {}
    for line in job.lines:
        if code_of(line) == b"G28":
            return None  # homing finds the place; what is told behind it renames that
        if is_motion(line):
            break
        words = declared_axes(line) | words
    if set(words) == set("XYZ"):
        return words["X"], words["Y"], words["Z"]
    named = (one for one in renamings(job.lines) if one.declared or one.moved)
    late = next((one.index for one in named), None)
    if late is None:
        return None
    raise LinkError(
        f"line {job.file_lines[late]} ({job.lines[late].decode('ascii')}) tells the printer where "
        "the tip stands, and not all of X, Y and Z are told before the first move: tell all three "
        "there, or take it out"
    )
