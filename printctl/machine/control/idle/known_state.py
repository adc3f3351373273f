"""Track printer state unknown to the firmware: mounted parts, homed axes, plunger travel used."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, ProfileError, Syringe, load
from printctl.checks.gate import Bounds, Limit, PrinterSituation
from printctl.machine.control.idle.station_status import Place
from printctl.machine.errors import Refused
from printctl.machine.job.syringes import usable_mm
from printctl.machine.records.mounting import (
    PARTS,
    MountedParts,
    Mounting,
    refuse_impossible,
)


@dataclass(frozen=True)
class MountedProfiles:
    """Profiles of what is mounted; None for nothing there, or unknown."""

    needle: Needle | None = None
    syringe: Syringe | None = None
    ink: Ink | None = None
    dish: Dish | None = None
    bath: Bath | None = None

    @property
    def ul_per_mm(self) -> float | None:
        """Ink that a mm of plunger travel moves, µL."""
        return self.syringe.area_mm2 if self.syringe else None


def read_mounted_profiles(mounted: MountedParts) -> MountedProfiles:
    """Load the profiles of what is mounted; Refused when one isn't there or is wrong."""
    try:
        return MountedProfiles(
            needle=load(Needle, mounted.needle) if mounted.needle else None,
            syringe=load(Syringe, mounted.syringe) if mounted.syringe else None,
            ink=load(Ink, mounted.ink) if mounted.ink else None,
            dish=load(Dish, mounted.dish) if mounted.dish else None,
            bath=load(Bath, mounted.bath) if mounted.bath else None,
        )
    except ProfileError as exc:
        raise Refused(str(exc)) from exc


def heat_limits(profiles: MountedProfiles, part_in_dish: bool) -> dict[str, Limit]:
    """Hottest targets that what is mounted bears, by heater."""
    limits = {}
    if profiles.ink is not None:
        limits["nozzle"] = Limit(
            profiles.ink.temperature_c.high, f"temperature_c of {profiles.ink.name}"
        )
    bath = profiles.bath
    if bath is None:
        return limits
    if part_in_dish and bath.melt_out_c is not None:
        hottest = Limit(max(bath.melt_out_c, bath.max_printing_c), f"melt_out_c of {bath.name}")
    else:
        why = f"max_printing_c of {bath.name}, as long as nothing is printed"
        hottest = Limit(bath.max_printing_c, why)
    return {**limits, "bed": hottest, "chamber": hottest}


MAX_MM: Final = 1e6
"""Beyond it a length is none of a printer's; a whole number may be too large for a float."""
_UNKNOWN: Final = (False, False, False)


@dataclass
class Knowledge:
    """Given by the user, or known from what was done.

    Attributes
    ----------
    homed : (x, y, z) of bool
        Axes whose count means the printer's frame.
    plunger_mm : float or None, mm
        Travel of the syringe in use that is used up; None where unknown.
    part_in_dish : bool
        Whether something was printed into the dish.
    needle_known : bool
        Whether it was given which needle is on, or that none is.
    """

    printer: Printer
    mounted: MountedParts = field(default_factory=MountedParts)
    homed: tuple[bool, bool, bool] = _UNKNOWN
    plunger_mm: float | None = None
    part_in_dish: bool = False
    needle_known: bool = False
    profiles: MountedProfiles = field(default_factory=MountedProfiles)

    def __post_init__(self) -> None:
        self.profiles = read_mounted_profiles(self.mounted)
        self.needle_known = bool(self.mounted.needle)

    @property
    def trusted(self) -> bool:
        """Whether the printer's count of all axes means its frame."""
        return all(self.homed)

    @property
    def bounds(self) -> Bounds:
        """What moves are judged by."""
        mounted = self.mounted
        return Bounds(
            self.printer,
            trusted=self.trusted,
            needle=self.profiles.needle,
            dish=self.profiles.dish,
            centre_mm=mounted.dish_centre_mm,
            floor_mm=mounted.floor_mm,
            bath_level_mm=mounted.bath_level_mm,
            part_in_dish=self.part_in_dish,
        )

    @property
    def limits(self) -> PrinterSituation:
        """What the gate judges by, but for the moment."""
        per_mm, ink = self.profiles.ul_per_mm, self.profiles.ink
        bears = math.inf if ink is None or per_mm is None else ink.plunger_ul_s / per_mm
        heat = heat_limits(self.profiles, self.part_in_dish)
        return PrinterSituation(self.bounds, heat=heat, plunger_mm_s=bears)

    @property
    def plunger_left_mm(self) -> float | None:
        """Travel until the syringe or the drive is at its end."""
        if self.plunger_mm is None or self.profiles.syringe is None:
            return None
        return max(0.0, usable_mm(self.profiles.syringe, self.printer) - self.plunger_mm)

    @property
    def ul_left(self) -> float | None:
        """Ink until then."""
        left, per_mm = self.plunger_left_mm, self.profiles.ul_per_mm
        return None if left is None or per_mm is None else left * per_mm

    def lose_position(self) -> None:
        """Forget what hung on the printer's count."""
        self.homed = _UNKNOWN
        self.mounted = replace(self.mounted, floor_mm=None, bath_level_mm=None)

    def home(self, axes: set[str]) -> None:
        """Record that axes were homed, with the needle off."""
        mounted = replace(self.mounted, needle="", floor_mm=None)
        if "z" in axes and not self.homed[2]:
            mounted = replace(mounted, bath_level_mm=None)
        self.mounted, self.profiles = mounted, replace(self.profiles, needle=None)
        self.needle_known = True
        self._trust(axes)

    def _trust(self, axes: set[str]) -> None:
        x, y, z = (name in axes or old for name, old in zip("xyz", self.homed, strict=True))
        self.homed = x, y, z

    @property
    def mounting(self) -> Mounting:
        """What outlives the connection."""
        return Mounting("", self.mounted, self.plunger_mm, self.part_in_dish)

    def take_over(self, kept: Mounting) -> None:
        """Record what is kept, or what a print left behind."""
        if kept.parts != self.mounted:
            with suppress(Refused):  # a syringe's profile may have gone since the change
                self.profiles = read_mounted_profiles(kept.parts)
                self.mounted = kept.parts
        self.plunger_mm, self.part_in_dish = kept.plunger_mm, kept.part_in_dish

    def count_anew(self, old: Place, new: Place, axes: set[str]) -> None:
        """Record that the printer calls the tip's place ``new`` now, which it called ``old``.

        What was measured in the old count is moved along; where the dish stands was said in the
        printer's frame, and is moved only if the old count meant that.
        """
        mounted = self.mounted
        shift = [b - a for a, b in zip(old, new, strict=True)]
        floor, level, centre = mounted.floor_mm, mounted.bath_level_mm, mounted.dish_centre_mm
        if centre is not None and self.trusted:
            centre = (centre[0] + shift[0], centre[1] + shift[1])
        self.mounted = replace(
            mounted,
            floor_mm=None if floor is None else floor + shift[2],
            bath_level_mm=None if level is None else level + shift[2],
            dish_centre_mm=centre,
        )
        self._trust(axes)

    def mount(self, parts: dict[str, Any]) -> None:
        """Record what the user says is mounted.

        Another needle has another length: how high its tip is isn't known any more, and the floor
        must be touched off again. Another dish has another floor and no print in it. A syringe
        that is named is a full one, unless ``plunger_mm`` says otherwise. Refused for an unknown
        key or profile, or a number that is none.
        """
        parts, asked = dict(parts), set(parts)
        unknown = asked - {*MountedParts.__dataclass_fields__, "plunger_mm"}
        if unknown:
            raise Refused(
                f"{sorted(unknown)[0]!r} can't be mounted; possible: "
                f"{', '.join(MountedParts.__dataclass_fields__)}, plunger_mm"
            )
        used = _used(parts.pop("plunger_mm", 0.0 if parts.get("syringe") else self.plunger_mm))
        given: dict[str, Any] = {name: _name(name, parts[name]) for name in PARTS if name in parts}
        for name in ("floor_mm", "bath_level_mm", "bath_depth_mm"):
            if name in parts:
                given[name] = _mm(name, parts[name])
        if "dish_centre_mm" in parts:
            given["dish_centre_mm"] = _centre(parts["dish_centre_mm"])
        mounted = replace(self.mounted, **given)
        if {"needle", "dish"} & set(given) and "floor_mm" not in given:
            mounted = replace(mounted, floor_mm=None)
        if {"dish", "bath"} & set(given):
            level, depth = given.get("bath_level_mm"), given.get("bath_depth_mm")
            mounted = replace(mounted, bath_level_mm=level, bath_depth_mm=depth)
        profiles = read_mounted_profiles(mounted)
        refuse_impossible(self.printer, mounted, used, asked)
        self.profiles = profiles
        if mounted.needle and mounted.needle != self.mounted.needle and self.needle_known:
            self.homed = (self.homed[0], self.homed[1], False)
        self.needle_known = self.needle_known or "needle" in given
        self.mounted, self.plunger_mm = mounted, used
        self.part_in_dish = self.part_in_dish and "dish" not in given


def _name(what: str, value: object) -> str:
    if value is not None and not isinstance(value, str):
        raise Refused(f"{what} {value!r} isn't the name or path of a profile")
    return value or ""


def _mm(what: str, value: object) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < MAX_MM:
        raise Refused(f"{what} {value!r} isn't a number in mm")
    return float(value)


def _centre(value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise Refused(f"dish_centre_mm {value!r} isn't two numbers in mm, x and y")
    x, y = _mm("dish_centre_mm", value[0]), _mm("dish_centre_mm", value[1])
    if x is None or y is None:
        raise Refused(f"dish_centre_mm {value!r} isn't two numbers in mm, x and y")
    return x, y


def _used(value: object) -> float | None:
    used = _mm("plunger_mm", value)
    if used is not None and used < 0:
        raise Refused(f"plunger_mm {used:g} is negative; 0 is a full syringe")
    return used
