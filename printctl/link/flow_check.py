"""Judge a correction of the flow: its bounds, and what the plunger must do for it."""

from __future__ import annotations

import math

from printctl.link.errors import Refused
from printctl.link.insert_check import InsertPlace
from printctl.link.inserts import Insert
from printctl.link.job import Job
from sim.reading import is_motion, read_sent
from sim.reading.flow_factor import LEAST, MOST


def check_flow(job: Job, insert: Insert, place: InsertPlace, name: str) -> None:
    """Refuse a flow out of bounds, or one at which a move pushes faster than drive or ink bear.

    Moves that the file itself makes so fast pass.

    Parameters
    ----------
    job : Job
        Without the insert.
    insert : Insert
    place : InsertPlace
    name : str
        What it is called in messages.

    Raises
    ------
    Refused
    """
    flow, printer = insert.flow or 0.0, place.printer
    if printer.pneumatic is not None or len(printer.heads) > 1:
        what = "several heads" if printer.heads else "a valve and no plunger"
        raise Refused(f"{name} isn't taken: {printer.name} has {what}, so no flow can be set")
    if not LEAST <= flow <= MOST:
        raise Refused(
            f"{name} isn't taken: a flow of {flow:g} times the file's is outside {LEAST:g} to "
            f"{MOST:g}; look at ink, syringe and needle"
        )
    if place.at.e is None:
        raise Refused(f"{name} isn't taken: the plunger's count isn't known there")
    grown = job.grown(insert)
    limit = min(printer.max_speed_mm_s.e, place.plunger_mm_s)
    own, now = _fastest(job, place, insert.after), _fastest(grown, place, insert.after)
    if now > max(limit, own) * (1 + 1e-6):
        raise Refused(
            f"{name} isn't taken: at a flow of {flow:g} the plunger would go {now:g} mm/s, at most "
            f"{limit:g} (max_speed_mm_s.e of {printer.name}, plunger_ul_s of the ink)"
        )
    longest = max(map(len, grown.lines)) + len(b"N9999999 *255\n")
    if longest > printer.max_line_bytes:
        raise Refused(f"{name} isn't taken: a line would have {longest} bytes (max_line_bytes)")


def _fastest(job: Job, place: InsertPlace, begin: int) -> float:
    """Fastest push of the job's moves across from a line on, mm/s."""
    at = dict.fromkeys("XYZEF", 0.0)
    known = zip("XYZEF", "xyzef", strict=True)
    at |= {word: float(getattr(place.at, name) or 0.0) for word, name in known}
    fastest = 0.0
    for line in job.lines[begin:]:
        if not is_motion(line) and not line.startswith(b"G92 "):
            continue
        words = read_sent(line).words
        to = at | {word: mm for word, mm in words.items() if word in at and mm is not None}
        way = math.dist([at[axis] for axis in "XYZ"], [to[axis] for axis in "XYZ"])
        if way and to["E"] > at["E"] and is_motion(line):
            fastest = max(fastest, to["F"] / 60 * (to["E"] - at["E"]) / way)
        at = to
    return fastest
