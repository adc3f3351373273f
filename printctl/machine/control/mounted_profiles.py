"""Load the profiles of the parts that are mounted on a station's printer."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Bath, Dish, Ink, Needle, ProfileError, Syringe, load
from printctl.machine.control.station_status import MountedParts
from printctl.machine.errors import Refused


@dataclass(frozen=True)
class MountedProfiles:
    """Profiles of what is mounted; None for nothing there, or nobody said.

    Attributes
    ----------
    needle, syringe, ink, dish, bath
        Profiles.
    """

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
    """Load the profiles of what is mounted.

    Raises
    ------
    Refused
        When one isn't there or is wrong.
    """
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
