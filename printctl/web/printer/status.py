"""A station's status with what follows from its profile and mounted parts, as REST gives it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Final

from firmware_profiles import Dish, Ink, Printer, ProfileError, Syringe, load
from printctl.machine.station import StationState, StationStatus
from printctl.machine.station.idle_commands import UNNAMED_UL_S
from printctl.machine.station.status import MountedParts
from printctl.web.printer.choices import PARTS
from printctl.web.profile_store import ProfileStore

STATE_WORDS: Final = {
    StationState.CONNECTING: "connecting: opening the port, asking who is there",
    StationState.READY: "ready: connected, checked, standing by",
    StationState.BUSY: "busy: doing what it was asked to",
    StationState.PRINTING: "printing: see the Job page; by hand only what a print allows",
    StationState.HALTING: "halting: a halt was sent, the printer hasn't confirmed it yet",
    StationState.HALTED: "halted: the firmware stopped itself or was stopped; reset it, reconnect",
    StationState.LOST: "lost: the port went away or nothing answers; check the cable, reconnect",
    StationState.CLOSED: "not connected",
}


@dataclass(frozen=True)
class PrinterStatus(StationStatus):
    """A station's status, and what follows from it.

    Attributes
    ----------
    needs_touch_off : bool
        Whether a needle is above a dish whose floor it hasn't touched.
    printer : str
        The profile's name, without a path.
    parts : dict of str to str
        Names of the mounted needle, syringe, ink, dish and bath; empty for none.
    state_words, position_words : str
        State and trust of the position, for people.
    rim_mm : float or None, mm
        Height of the tip at the dish's rim; None where that isn't known.
    fastest_ul_s : float or None, µL/s
        Fastest plunger with the syringe and ink mounted; None without a syringe.
    full_ul : float or None, µL
        What the mounted syringe gives when it is full; None without one.
    """

    needs_touch_off: bool = False
    printer: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    state_words: str = ""
    position_words: str = ""
    rim_mm: float | None = None
    fastest_ul_s: float | None = None
    full_ul: float | None = None


def described(status: StationStatus) -> PrinterStatus:
    """Add to a station's status what follows from it."""
    try:
        rim, fastest, full = _limits(status.profile, status.mounted)
    except (ProfileError, OSError):  # a file that was removed meanwhile
        rim = fastest = full = None
    return PrinterStatus(
        **{one.name: getattr(status, one.name) for one in fields(StationStatus)},
        needs_touch_off=status.mounted.touch_off_due,
        printer=ProfileStore.name(status.profile),
        parts={sort: ProfileStore.name(getattr(status.mounted, sort)) for sort in PARTS},
        state_words=STATE_WORDS[status.state],
        position_words=_position_words(status),
        rim_mm=rim,
        fastest_ul_s=fastest,
        full_ul=full,
    )


def rim_mm(mounted: MountedParts) -> float | None:
    """Height of the tip at the rim of the dish mounted, mm; None where that isn't known."""
    if not mounted.dish or mounted.floor_mm is None:
        return None
    return mounted.floor_mm + load(Dish, mounted.dish).wall_mm


def fastest_ul_s(profile: str, mounted: MountedParts) -> float | None:
    """Fastest plunger, µL/s, with the syringe and the ink mounted; None where no syringe is."""
    if not mounted.syringe or not profile:
        return None
    area = load(Syringe, mounted.syringe).area_mm2
    bears = load(Ink, mounted.ink).plunger_ul_s if mounted.ink else UNNAMED_UL_S
    return min(area * load(Printer, profile).max_speed_mm_s.e, bears)


@lru_cache(maxsize=8)
def _limits(profile: str, mounted: MountedParts) -> tuple[float | None, float | None, float | None]:
    """Rim, fastest plunger, full syringe; a status comes four times a second, its parts rarely."""
    syringe = load(Syringe, mounted.syringe) if mounted.syringe else None
    full = None if syringe is None else syringe.volume_ul - syringe.dead_volume_ul
    return rim_mm(mounted), fastest_ul_s(profile, mounted), full


def _position_words(status: StationStatus) -> str:
    if not status.open:
        return "not connected"
    if status.position_trusted:
        return "position trusted, printer's frame"
    homed = [axis for axis, done in zip("XYZ", status.homed, strict=True) if done]
    return "position not trusted: small steps alone; " + (
        f"{', '.join(homed)} homed" if homed else "no axis homed"
    )
