"""Highest permitted heater targets for the mounted ink and bath."""

from __future__ import annotations

from printctl.checks.gate import Limit
from printctl.machine.station.mounted_profiles import MountedProfiles


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
