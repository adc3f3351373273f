"""Move the tip to a job's start: straight up, across, straight down."""

from __future__ import annotations

from firmware_profiles import Dish, load
from printctl.checks.gate import RIM_MARGIN_MM
from printctl.errors import SafetyError
from printctl.machine.station import Station, StationStatus

Place = tuple[float, float, float]


def places_to(tip: Place, start: Place, over_mm: float | None) -> list[Place]:
    """The places that a tip goes to, one after the other, the last being the start.

    Parameters
    ----------
    tip, start : (3,), mm
    over_mm : float or None, mm
        Height at which the tip clears the dish's rim; None where no dish is known.
    """
    high = max(tip[2], start[2], *(() if over_mm is None else (over_mm,)))
    return [(tip[0], tip[1], high), (start[0], start[1], high), start]


def go_to(station: Station, start: Place) -> StationStatus:
    """Bring the tip to a place; the station refuses what its soft limits forbid.

    Raises
    ------
    SafetyError
        When nobody knows where the tip stands.
    LinkError
        What the station refuses; the tip then stands where the way so far has led.
    """
    status = station.status
    tip = status.position_mm
    if tip is None or not status.position_trusted:
        raise SafetyError(
            "nobody knows where the tip stands; home it without the needle, or say where it is "
            "(page Printer), then it can be moved to the start"
        )
    for x, y, z in places_to(tip, start, _over(status)):
        status = station.move_to(x, y, z)
    return status


def _over(status: StationStatus) -> float | None:
    mounted = status.mounted
    if not mounted.dish or mounted.floor_mm is None:
        return None
    return mounted.floor_mm + load(Dish, mounted.dish).wall_mm + RIM_MARGIN_MM
