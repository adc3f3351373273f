"""Place at which a job's first lines tell the firmware that the tip stands."""

from __future__ import annotations

from printctl.link.errors import LinkError
from printctl.link.job import Job
from printctl.link.modal import places_told
from sim.reading import code_of, is_motion


def declared_start(job: Job, begin: int) -> tuple[float, float, float] | None:
    """Where the job tells the firmware that the tip stands, before its first move."""
    places = [k for k, line in enumerate(job.lines[:begin]) if places_told(line)]
    moves = (k for k, line in enumerate(job.lines) if is_motion(line))
    if not places:
        return None
    first = next(moves, begin)
    words = places_told(job.lines[places[0]])
    if len(places) > 1 or places[0] > first or set(words) != set("XYZ"):
        raise LinkError(
            f"line {job.file_lines[places[-1]]} moves the job's frame ({job.lines[places[-1]]!r}); "
            "the rest can't be placed by a machine"
        )
    return words["X"], words["Y"], words["Z"]


def told_start(job: Job) -> tuple[float, float, float] | None:
    """Where the job's first lines tell the firmware that the tip stands; None where they don't.

    Of each axis the first word before any move counts: what is told later renames places, and
    the dry run follows it.

    Raises
    ------
    LinkError
        Where some of X, Y and Z are told there, or any is told behind a move, and not all three
        before it: nobody knows then where the checks ought to begin.
    """
    found: dict[str, float] = {}
    for line in job.lines:
        if code_of(line) == b"G28":
            return None  # homing finds the place; what is told behind it renames that
        if is_motion(line):
            break
        found = places_told(line) | found
    if set(found) == set("XYZ"):
        return found["X"], found["Y"], found["Z"]
    late = next((k for k, line in enumerate(job.lines) if places_told(line)), None)
    if late is None:
        return None
    raise LinkError(
        f"line {job.file_lines[late]} ({job.lines[late].decode('ascii')}) tells the printer where "
        "the tip stands, and not all of X, Y and Z are told before the first move: tell all three "
        "there, or take it out"
    )
