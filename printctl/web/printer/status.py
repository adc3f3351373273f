"""A station's status with what follows from its profile and mounted parts, as REST gives it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from firmware_profiles import Dish, Ink, Printer, ProfileError, Syringe, load
from printctl.machine.control.idle.idle_commands import UNNAMED_UL_S
from printctl.machine.control.idle.station_status import StationState, StationStatus, unknown_values
from printctl.machine.records.mounting import MountedParts
from printctl.web.errors import ConflictError
from printctl.web.profile_store import PARTS, ProfileStore

STATE_WORDS: Final = {
    StationState.CONNECTING: "connecting: opening the port, asking who is there",
    StationState.READY: "ready: connected, checked, standing by",
    StationState.BUSY: "busy: doing what it was asked to",
    StationState.PRINTING: "printing: see the Job page; by hand only what a print allows",
    StationState.HALTING: "halting: a halt was sent, the printer hasn't confirmed it yet",
    StationState.HALTED: "halted by an emergency stop or by its firmware; reset it, reconnect",
    StationState.LOST: "lost: the port went away or nothing answers; check the cable, reconnect",
    StationState.CLOSED: "not connected",
}
CLEAR_MM: Final = 5.0
"""So far above the dish's rim is out of the bath."""
BLIND_LIFT_MM: Final = 20.0
"""How far up where the rim's height is unknown; a controlled stop lifts as far."""


@dataclass(frozen=True)
class PrinterStatus(StationStatus):
    """A station's status, and what follows from it.

    ``printer`` and ``parts`` are names without a path, empty for none. ``rim_mm`` is the height of
    the tip at the dish's rim, ``fastest_ul_s`` the fastest plunger with the syringe and ink
    mounted, ``full_ul`` what that syringe gives when it is full; None where that isn't known.
    ``unknown`` has the reasons of `unknown_values`.
    """

    needs_touch_off: bool = False
    printer: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    state_words: str = ""
    position_words: str = ""
    rim_mm: float | None = None
    fastest_ul_s: float | None = None
    full_ul: float | None = None
    unknown: dict[str, str] = field(default_factory=dict)


def described(status: StationStatus) -> PrinterStatus:
    """Add to a station's status what follows from it."""
    try:
        rim, fastest, full = _limits(status.profile, status.mounted)
    except (ProfileError, OSError):  # a file that was removed meanwhile
        rim = fastest = full = None
    return PrinterStatus(
        **vars(status),
        needs_touch_off=status.mounted.touch_off_due,
        printer=ProfileStore.name(status.profile),
        parts={sort: ProfileStore.name(getattr(status.mounted, sort)) for sort in PARTS},
        state_words=STATE_WORDS[status.state],
        position_words=_position_words(status),
        rim_mm=rim,
        fastest_ul_s=fastest,
        full_ul=full,
        unknown=unknown_values(status),
    )


@lru_cache(maxsize=8)
def _limits(profile: str, mounted: MountedParts) -> tuple[float | None, float | None, float | None]:
    """Rim, fastest plunger, full syringe; a status comes four times a second, its parts rarely."""
    rim = fastest = full = None
    if mounted.dish and mounted.floor_mm is not None:
        rim = mounted.floor_mm + load(Dish, mounted.dish).wall_mm
    if mounted.syringe:
        syringe = load(Syringe, mounted.syringe)
        full = syringe.volume_ul - syringe.dead_volume_ul
        if profile:
            bears = load(Ink, mounted.ink).plunger_ul_s if mounted.ink else UNNAMED_UL_S
            fastest = min(syringe.area_mm2 * load(Printer, profile).max_speed_mm_s.e, bears)
    return rim, fastest, full


def way_out_mm(status: StationStatus) -> float:
    """Return how far up the tip is out of the bath and above the dish's rim, mm.

    ConflictError when it is there already, or the axis ends below.
    """
    if status.position_mm is None:
        raise ConflictError("the printer hasn't told where it stands; home it, or jog Z up")
    z = status.position_mm[2]
    rim = described(status).rim_mm
    top = load(Printer, status.profile).z_mm.high if status.position_trusted else math.inf
    way = min(BLIND_LIFT_MM if rim is None else rim + CLEAR_MM - z, top - z)
    if way <= 0:
        raise ConflictError(
            f"the tip is at Z {z:.2f} mm already"
            + (", the end of the axis" if rim is None else f", the rim at {rim:.2f} mm")
        )
    return way


def _position_words(status: StationStatus) -> str:
    if not status.open:
        return "not connected"
    if status.position_trusted:
        return "position trusted, printer's frame"
    homed = [axis for axis, done in zip("XYZ", status.homed, strict=True) if done]
    return "position not trusted: small steps alone; " + (
        f"{', '.join(homed)} homed" if homed else "no axis homed"
    )
