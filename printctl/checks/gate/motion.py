"""Allow or refuse a typed move, push or homing: by print phase, limits, and a mounted needle."""

from __future__ import annotations

import math
from typing import Final

from gcode.reading import GcodeLine
from printctl.checks.gate.inputs import (
    AllowedLine,
    LineAction,
    NotAllowed,
    Phase,
    Place,
    PrinterSituation,
    check_move,
    check_speed,
    speed_limit,
)

AXES: Final = "xyz"
DEFAULT_MM_S: Final = 5.0
"""Speed of a move whose speed nobody said."""
_TINY_MM: Final = 1e-6


def move(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Judge a straight move that a person typed.

    Raises
    ------
    NotAllowed
    """
    if known.phase is Phase.PRINTING:
        raise NotAllowed(
            "nothing moves by hand while a print goes on; pause it first (`printctl pause`)"
        )
    places = {axis: line.number(axis.upper()) for axis in AXES if axis.upper() in line.words}
    feed = line.number("F")
    speed = None if feed is None else feed / 60
    if "E" in line.words:
        return _push(line, known, speed, alone=not places)
    if not places:
        raise NotAllowed("no axis is named; write X, Y or Z and a number of mm")
    start = known.position
    if start is None:
        raise NotAllowed("the printer doesn't tell its position (M114); reconnect")
    if not known.bounds.trusted:
        raise NotAllowed(
            "the printer's count isn't known to be right, so no place can be gone to: home it "
            "without needle, or tell where the tip is (set_position); small steps (jog) are free"
        )
    mm = [start[k] if places.get(axis) is None else places[axis] for k, axis in enumerate(AXES)]
    target = (float(mm[0] or 0.0), float(mm[1] or 0.0), float(mm[2] or 0.0))
    if speed is None and known.phase is Phase.PAUSED:  # the job's own may be fast
        speed = min(DEFAULT_MM_S, speed_limit(known.bounds, start, target)[0])
        text = f"{line.text.decode('ascii')} F{speed * 60:g}"
    else:
        text = line.text.decode("ascii")
    check_step(known, start, target, speed)
    return AllowedLine(text, LineAction.MOVE, target=target, speed_mm_s=speed)


def check_step(
    known: PrinterSituation, start: Place, target: Place, speed_mm_s: float | None
) -> None:
    """Refuse a straight move of the tip beyond the limits.

    Raises
    ------
    NotAllowed
    """
    check_move(known.bounds, start, target)
    if speed_mm_s is not None and math.dist(start, target) > _TINY_MM:
        check_speed(known.bounds, start, target, speed_mm_s)


def _push(
    line: GcodeLine, known: PrinterSituation, speed: float | None, *, alone: bool
) -> AllowedLine:
    """The plunger, in a pause alone: standing, it is moved in µL and counted."""
    printer = known.printer
    if known.phase is not Phase.PAUSED or known.plunger_mm is None:
        raise NotAllowed("E moves the plunger without the syringe's limits; use plunger (µL)")
    if printer.pneumatic is not None:
        raise NotAllowed(f"{printer.name} has a valve and no plunger; only a print opens it")
    if not alone:
        raise NotAllowed("a person moves either the tip or the plunger; write two lines")
    to, travel = line.number("E"), printer.plunger_travel_mm or math.inf
    by = (to or 0.0) - known.plunger_mm
    if abs(by) > travel + _TINY_MM:
        raise NotAllowed(
            f"the plunger would travel {abs(by):.2f} mm, the drive's travel is {travel:g} mm "
            f"(plunger_travel_mm of {printer.name}); E is absolute, and stands at "
            f"{known.plunger_mm:.2f} mm"
        )
    limit = min(printer.max_speed_mm_s.e, known.plunger_mm_s)
    if speed is None or speed > limit * (1 + 1e-9):
        speed_text = "no F is given" if speed is None else f"{speed:g} mm/s of the plunger"
        raise NotAllowed(
            f"{speed_text}, at most {limit:g} mm/s (max_speed_mm_s.e of {printer.name}, "
            f"plunger_ul_s of the ink); write F{limit * 60:g} or less"
        )
    return AllowedLine(line.text.decode("ascii"))


def home(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Judge homing.

    Raises
    ------
    NotAllowed
    """
    if known.phase is not Phase.STANDING:
        raise NotAllowed("nothing is homed in a print: the needle would be driven into the dish")
    axes = tuple(axis for axis in AXES if axis.upper() in line.words) or tuple(AXES)
    check_homing(known)
    return AllowedLine(line.text.decode("ascii"), LineAction.HOME, axes=axes)


def check_homing(known: PrinterSituation) -> None:
    """Refuse homing with a needle mounted.

    Raises
    ------
    NotAllowed
    """
    needle, dish = known.bounds.needle, known.bounds.dish
    if needle is None or known.needle_off:
        return
    where = f" above the dish ({dish.name})" if dish is not None else ""
    raise NotAllowed(
        f"homing with the needle ({needle.name}) mounted{where} would drive it into what is below; "
        "take it off and say so (needle_off), or touch off instead of homing"
    )
