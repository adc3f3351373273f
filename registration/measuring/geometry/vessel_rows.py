"""Table rows of one vessel's geometric characteristics (ISO 1101)."""

from __future__ import annotations

from dataclasses import dataclass

from registration.measuring.geometry.characteristic import Characteristic, Name, Zone
from registration.measuring.geometry.line import Line
from registration.measuring.geometry.lumen import Lumen

POSITION = "position of the axis"
LINE_PROFILE = "profile of a line, axis"
PORT = "position of the mouth"
CYLINDRICITY = "cylindricity of the lumen"
SURFACE = "profile of a surface"


@dataclass(frozen=True)
class Case:
    """One vessel, its frame and sections.

    Attributes
    ----------
    vessel : int
    line : Line
    lumen : Lumen or None
        None where too few whole sections were measured.
    gauged : float
        Share of its length with a section.
    """

    vessel: int
    line: Line
    lumen: Lumen | None
    gauged: float


def row(case: Case, name: Name, words: str, zone: Zone) -> Characteristic:
    """Return the row of a measured zone."""
    low, high = zone.interval()
    return Characteristic(
        name, f"vessel {case.vessel}", words, case.vessel, 1e3 * zone.width, 1e3 * low, 1e3 * high,
        case.gauged,
    )  # fmt: skip


def unmeasured_row(case: Case, name: Name, words: str, note: str) -> Characteristic:
    """Return the row of what wasn't measured, and why."""
    return Characteristic(name, f"vessel {case.vessel}", words, case.vessel, note=note)


def without_mouth(case: Case, last: bool, note: str) -> Characteristic:
    """Return the row of a mouth that wasn't measured, and why."""
    return Characteristic("port", mouth_name(case, last), PORT, case.vessel, note=note)


def no_cylinder(case: Case) -> Characteristic | None:
    """Say where a design is no cylinder; None where it is one."""
    if case.line.straight and case.line.even:
        return None
    shape = "tapered" if case.line.straight else "curved"
    return unmeasured_row(case, "cylindricity", CYLINDRICITY, f"not defined: the design is {shape}")


def mouth_name(case: Case, last: bool) -> str:
    """Return the name of a mouth as datums have it."""
    return f"{'outlet' if last else 'inlet'} {case.vessel}"
