"""Refuse a flow correction out of bounds, or one that drives the plunger too fast."""

from __future__ import annotations

import math
from typing import Final

from printctl.machine.errors import Refused
from printctl.machine.job.insert_check import InsertPlace
from printctl.machine.job.job import Job
from sim.gcode.reading.sent_line import LEAST, MOST

_PLACING: Final = (b"G0", b"G1", b"G92")
_WORDS: Final = b"XYZEF"


def check_flow(job: Job, grown: Job, place: InsertPlace, name: str) -> None:
    """Refuse a flow at which a move pushes faster than drive or ink bear.

    Moves that the file itself makes so fast pass.

    Parameters
    ----------
    job, grown : Job
        Without the insert, and with it as the last one.
    place : InsertPlace
    name : str
        What it is called in messages.

    Raises
    ------
    Refused
    """
    printer, after = place.printer, grown.inserts[-1].after
    limit = min(printer.max_speed_mm_s.e, place.plunger_mm_s)
    own, now = _fastest(job, place, after), _fastest(grown, place, after)
    if now > max(limit, own) * (1 + 1e-6):
        raise Refused(
            f"{name} isn't taken: at a flow of {grown.flow:g} the plunger would go {now:g} mm/s, "
            f"at most {limit:g} (max_speed_mm_s.e of {printer.name}, plunger_ul_s of the ink)"
        )
    longest, before = max(map(len, grown.lines)), max(map(len, job.lines))
    most = printer.max_line_bytes - len(b"N9999999 *255\n")
    if longest > max(most, before):
        raise Refused(f"{name} isn't taken: a line would have {longest} bytes (max_line_bytes)")


def check_factor(flow: float, place: InsertPlace, name: str) -> None:
    """Refuse a flow out of bounds, or where nothing is dosed by one plunger.

    Raises
    ------
    Refused
    """
    printer = place.printer
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


def _fastest(job: Job, place: InsertPlace, begin: int) -> float:
    """Fastest push of the job's moves across from a line on, mm/s."""
    at = dict.fromkeys("XYZEF", 0.0)
    known = zip("XYZEF", "xyzef", strict=True)
    at |= {word: float(getattr(place.at, name) or 0.0) for word, name in known}
    fastest = 0.0
    for line in job.lines[begin:]:
        code, *words = line.split(b" ")
        if code not in _PLACING:
            continue
        to = at | {
            chr(word[0]): float(word[1:]) for word in words if word[0] in _WORDS and word[1:]
        }
        if code != b"G92" and to["E"] > at["E"]:
            way = math.dist([at[axis] for axis in "XYZ"], [to[axis] for axis in "XYZ"])
            fastest = max(fastest, to["F"] / 60 * (to["E"] - at["E"]) / way if way else 0.0)
        at = to
    return fastest
