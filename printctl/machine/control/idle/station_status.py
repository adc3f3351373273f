"""Data classes of a station's status, as sent to clients."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, Final

from printctl.machine.control.board.heat import Temperature
from printctl.machine.records.mounting import MountedParts

Place = tuple[float, float, float]


class StationState(StrEnum):
    """Where a station stands. What may be asked in each is in ``docs/station.md``."""

    CONNECTING = "connecting"
    READY = "ready"
    BUSY = "busy"
    PRINTING = "printing"
    HALTING = "halting"
    HALTED = "halted"
    LOST = "lost"
    CLOSED = "closed"


NO_PRINTER: Final = "no printer is connected; connect one first (Printer page)"
"""Told wherever something is asked of a station that isn't there."""
OPEN: Final = frozenset({StationState.READY, StationState.BUSY, StationState.PRINTING})
"""States in which the printer answers."""


@dataclass(frozen=True)
class StationStatus:
    """A station as its clients see it.

    Attributes
    ----------
    message : str
        What happened last, and what to do if something must be done.
    position_mm : (x, y, z) or None, mm
        As M114 reports it; None until then.
    position_trusted : bool
        Whether the printer's count means its frame: after homing X, Y and Z, after
        `set_position`, or at the end of a print that ended with a known position. Firmwares
        don't tell which axes were homed.
    homed : (x, y, z) of bool
        Axes that this station has homed, or was told the place of, since the motors last had no
        power or the board was reset.
    plunger_mm : float or None, mm
        Travel since `mount` said that a syringe was put in (0 then); None where nobody said.
    plunger_left_mm, ul_left : float or None, mm and µL
        Until the syringe (but for its dead volume) or the drive is at its end.
    readings : tuple of str
        Last readings of what the profile has watched, with their limits.
    print_folder : str
        Of the print that goes on, or was last; empty for none.
    soft_low_mm, soft_high_mm : (x, y, z), mm
        Box in which the tip may be moved from where it is; empty tuples where the position isn't
        trusted.
    error : str
        Name of the error's class (`printctl.machine.errors`) that led to ``lost`` or
        ``halted``.
    """

    state: StationState
    message: str = ""
    profile: str = ""
    port: str = ""
    firmware: str = ""
    position_mm: Place | None = None
    position_trusted: bool = False
    homed: tuple[bool, bool, bool] = (False, False, False)
    plunger_mm: float | None = None
    plunger_left_mm: float | None = None
    ul_left: float | None = None
    temperatures: tuple[Temperature, ...] = ()
    readings: tuple[str, ...] = ()
    print_folder: str = ""
    soft_low_mm: tuple[float, ...] = ()
    soft_high_mm: tuple[float, ...] = ()
    mounted: MountedParts = field(default_factory=MountedParts)
    error: str = ""

    @property
    def open(self) -> bool:
        """Whether the printer answers."""
        return self.state in OPEN

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object, with `unknown_values`."""
        return {**asdict(self), "unknown": unknown_values(self)}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> StationStatus:
        """Read `to_dict`; keys of later versions are ignored."""
        known = {name: data[name] for name in StationStatus.__dataclass_fields__ if name in data}
        known["state"] = StationState(known["state"])
        for name in ("homed", "readings", "soft_low_mm", "soft_high_mm"):
            if name in known:
                known[name] = tuple(known[name])
        if known.get("position_mm") is not None:
            known["position_mm"] = tuple(known["position_mm"])
        known["temperatures"] = tuple(Temperature(**one) for one in known.get("temperatures", ()))
        known["mounted"] = MountedParts.from_dict(known.get("mounted", {}))
        return StationStatus(**known)


_SILENT: Final = {
    StationState.CONNECTING: "the printer is being connected",
    StationState.HALTING: "an emergency stop was sent; motors may lose steps",
    StationState.HALTED: "the printer was halted; motors may have lost steps",
    StationState.LOST: "the connection to the printer was lost",
    StationState.CLOSED: "no printer is connected",
}
_OF_PRINT: Final = "a print is running; see its status"


def unknown_values(status: StationStatus) -> dict[str, str]:
    """Return why ``position``, ``ink`` or ``temperatures`` isn't known; a known one has no entry.

    The one judgement of this: where a value is unknown, an old or uncertain number of it may be
    shown only as such.
    """
    reasons = {
        "position": _unknown_position(status),
        "ink": _unknown_ink(status),
        "temperatures": _SILENT.get(status.state, "")
        or (
            "" if status.temperatures else "the printer hasn't reported any since it was connected"
        ),
    }
    return {name: reason for name, reason in reasons.items() if reason}


def _unknown_position(status: StationStatus) -> str:
    if status.state is StationState.PRINTING:
        return _OF_PRINT
    if status.state in _SILENT:
        return _SILENT[status.state]
    if status.position_mm is None:
        return "the printer hasn't reported it since it was connected; home it"
    if status.position_trusted:
        return ""
    axes = [axis for axis, homed in zip("XYZ", status.homed, strict=True) if not homed]
    return (
        f"{', '.join(axes)} not homed since the printer was connected, reset or stopped; home "
        "without a needle, or set the tip position"
    )


def _unknown_ink(status: StationStatus) -> str:
    if status.state is StationState.PRINTING:
        return _OF_PRINT
    if status.ul_left is not None:
        return ""
    if not status.mounted.syringe:
        return "no syringe is specified as mounted"
    return "the syringe's fill level wasn't set, or the end of a print is unknown"
