"""Read print orders sent to the station's socket, and check that each may begin."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.control.station_status import Place
from printctl.machine.errors import Refused
from printctl.machine.families import link_facts
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import declared_start, last_of
from printctl.machine.job.job import Job
from printctl.machine.job.retreat import Retreat
from printctl.machine.process.open_connection import Socket
from printctl.machine.process.process import Order as LinkOrder
from sim.gcode.reading import code_of

ASIDE_MM: Final = 0.05
"""Most between the place where the tip stands and the one that the job declares."""


def read_order(request: dict[str, Any], socket: Socket) -> LinkOrder:
    """Read what `printctl.machine.process.station_client` made.

    Raises
    ------
    Refused
        For another printer than the one that is connected.
    """
    try:
        asked = load(Printer, str(request["printer"]))
    except ProfileError as exc:
        raise Refused(str(exc)) from exc
    if asked != socket.printer:
        raise Refused(
            f"the job is for {asked.name} ({request['printer']}), connected is "
            f"{socket.printer.name} ({socket.profile}); connect with the "
            "profile that the job was made for"
        )
    return LinkOrder(
        job=Path(request["job"]),
        profile=str(request["printer"]),
        port=socket.port,
        folder=Path(request["folder"]),
        retreat=Retreat(**request["retreat"]),
        care=Care.from_dict(request["care"]),
    )


def check_homing(job: Job, needle: str) -> None:
    """Refuse a job that homes with a needle mounted.

    Raises
    ------
    Refused
    """
    homing = homing_line(job)
    if homing and needle:
        raise Refused(
            f"{job.name}, line {homing}, homes the machine with the needle "
            f"{needle} mounted, which would be driven into what is below; take the line out, and "
            "touch off instead"
        )


def homing_line(job: Job) -> int:
    """Line of the file that homes the machine; 0 for none."""
    lines = zip(job.lines, job.file_lines, strict=True)
    return next((number for line, number in lines if code_of(line) == b"G28"), 0)


def check_start(job: Job, at: Place | None, trusted: bool) -> Place | None:
    """Refuse a job that declares the tip to be where it isn't; give the place that it declares.

    Raises
    ------
    LinkError
    """
    declared = declared_start(job)
    if declared is None or at is None or not trusted:
        return declared
    away = math.dist(declared, at)
    if away > ASIDE_MM:
        places = (
            " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
            for place in (declared, at)
        )
        begins, stands = places
        raise Refused(
            f"{job.name} begins with the tip at {begins}, it stands at {stands}, {away:.2f} mm "
            f"away (at most {ASIDE_MM:g}): the part would be written as far beside its place. Move "
            "there first, or say that the tip is there (set_position)"
        )
    return declared


def leaves_motors_on(job: Job, done: int, printer: Printer) -> bool:
    """Whether the motors have power after so many lines, so that the count keeps its meaning."""
    off = last_of(job.lines, done, (b"M84", b"M18"))
    return off is None or (b"S" in off and link_facts(printer).m84_sets_timeout)
