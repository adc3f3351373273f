"""Orders to print a job, as JSON between processes, and checks whether one may begin."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer
from gcode.reading import code_of
from printctl.machine.control.idle.station_status import Place
from printctl.machine.errors import Refused
from printctl.machine.families import link_facts
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import declared_start, last_of
from printctl.machine.job.job import Job
from printctl.machine.job.retreat import Retreat
from printctl.machine.records.actor import actor

ASIDE_MM: Final = 0.05
"""Most between the place where the tip stands and the one that the job declares."""


@dataclass(frozen=True)
class Order:
    """What is to be printed where.

    Attributes
    ----------
    job : Path
        G-code file.
    printer : str
        Profile, by name or path.
    port : str
        As the user named it.
    folder : Path
        For journal and record.
    baud : int, "auto" or None
        In place of the profile's.
    by : dict
        ``who`` orders it and ``from`` where: whoever makes the order.
    resume : bool
        Whether to go on with an interrupted print of the same file.
    once : bool
        Whether a print of the same file that is done in the folder counts as this one; of a
        simulated printer only where the record of its motion is whole.
    """

    job: Path
    printer: str
    port: str
    folder: Path
    retreat: Retreat = field(default_factory=Retreat)
    resume: bool = False
    once: bool = False
    care: Care = field(default_factory=Care)
    baud: int | str | None = None
    by: dict[str, str] = field(default_factory=actor)

    @property
    def sha256(self) -> str:
        """Hash of the job file."""
        return hashlib.sha256(self.job.read_bytes()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """As a JSON object, for a process with another working folder."""
        return {
            **asdict(self),
            "job": str(self.job.resolve()),
            "folder": str(self.folder.resolve()),
            "care": self.care.to_dict(),
        }

    @staticmethod
    def from_json(data: dict[str, Any]) -> Order:
        """Read `to_json`."""
        order = Order(**data)
        return replace(
            order,
            job=Path(data["job"]),
            folder=Path(data["folder"]),
            retreat=Retreat(**data["retreat"]),
            care=Care.from_dict(data["care"]),
        )


def check_homing(job: Job, needle: str) -> None:
    """Raise Refused for a job that homes with a needle mounted."""
    lines = zip(job.lines, job.file_lines, strict=True)
    homing = next((number for line, number in lines if code_of(line) == b"G28"), 0)
    if homing and needle:
        raise Refused(
            f"{job.name}, line {homing}, homes the printer with the needle {needle} mounted, which "
            "would drive the needle into what is below; remove the line, and touch off instead"
        )


def check_start(job: Job, at: Place | None, trusted: bool) -> Place | None:
    """Return the place of the tip that a job declares; Refused where it isn't there."""
    declared = declared_start(job)
    if declared is None or at is None or not trusted:
        return declared
    away = math.dist(declared, at)
    if away > ASIDE_MM:
        begins, stands = (
            " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
            for place in (declared, at)
        )
        raise Refused(
            f"{job.name} starts with the tip at {begins}, but it is at {stands}, {away:.2f} mm "
            f"away (maximum {ASIDE_MM:g}): the part would be printed that far off. Move there "
            "first, or set the tip position (set_position)"
        )
    return declared


def leaves_motors_on(job: Job, done: int, printer: Printer) -> bool:
    """Whether the motors have power after so many lines, so that the count keeps its meaning."""
    off = last_of(job.lines, done, (b"M84", b"M18"))
    return off is None or (b"S" in off and link_facts(printer).m84_sets_timeout)
