"""Checks of mounted parts: consistent profiles, needle length, chemistry, syringe volume."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np

from firmware_profiles import (
    Bath,
    Facts,
    Ink,
    Needle,
    Printer,
    Syringe,
    load,
    profile_doubts,
    shipped,
    supported_diameter_mm,
)
from firmware_profiles.materials.inks_and_baths import BathRole
from gcode.deposit.lay import Style
from gcode.dry_run.run import DryRun
from printctl.checks.kinds import Kind
from printctl.checks.preflight.firmware import widest_push_check
from printctl.checks.set_up import Check, Weight, finding, none_of
from printctl.run_folder.manifest import Manifest


def profile_checks(*profiles: Facts) -> list[Check]:
    """A refusal for each grave doubt about a profile; nothing for one that is in order."""
    return [
        finding(
            Kind.PROFILE,
            f"profile {facts.name}",
            doubt.key,
            f"{doubt.text}; `printctl profiles check` lists all its problems",
        )
        for facts in profiles
        for doubt in profile_doubts(facts)
        if doubt.grave
    ]


_WORDS: Final = {
    "neutral_ph": "a buffer of neutral pH",
    "calcium": "calcium",
    "thrombin": "thrombin",
}


def needle_check(part_height_mm: float, needle: Needle) -> Check:
    """Whether the needle reaches the part's bottom before its hub dips into the bath."""
    return Check(
        Kind.NEEDLE_LENGTH,
        "part depth vs. needle length",
        part_height_mm,
        needle.length_mm,
        "mm",
        part_height_mm <= needle.length_mm,
        "needle: length_mm",
        f"the hub of {needle.name} would dip into the bath; "
        f"{longer_needle(needle, part_height_mm)}, or print a flatter part",
    )


def longer_needle(needle: Needle, reach_mm: float) -> str:
    """Say which needle reaches so deep, mm: a shipped one of the same bore, if there is one."""
    for name in shipped(Needle):
        other = load(Needle, name)
        if other.inner_mm == needle.inner_mm and other.length_mm >= reach_mm:
            return f"use a longer needle of the same bore (needle: {name})"
    return f"use a needle at least {reach_mm:.1f} mm long (no shipped one has this bore)"


def chemistry_check(ink: Ink, bath: Bath) -> Check:
    """Whether the bath has what sets the ink; without it the print runs away."""
    missing = [trigger for trigger in ink.gelled_by if trigger not in bath.provides]
    needs = " and ".join(_WORDS[trigger] for trigger in missing)
    return none_of(
        Kind.CHEMISTRY,
        "gelation triggers missing in the bath",
        len(missing),
        "bath: provides",
        f"{ink.name} gels by {needs}, which {bath.name} doesn't provide (gelled_by, provides); use "
        "another bath, or add it to the bath profile",
    )


def role_checks(inks: Sequence[Ink], bath: Bath, writes: Writes) -> list[Check]:
    """Whether inks and bath suit what is written; a warning for roles that nobody set.

    Layers need an ink that stays and a bath that is removed. Vessels are what a sacrificial ink
    leaves in a bath that stays. Cords are an ink that stays, in any bath. Of several heads that
    write layers one may hold a sacrificial ink.
    """
    unknown = {one.name: "ink" for one in inks if one.role is None}
    unknown |= {bath.name: "bath"} if bath.role is None else {}
    checks = [
        _role_check(
            f"role of {name}",
            f"not set, so its suitability for this print wasn't checked; set role in the {kind} "
            f"profile ({_ROLES[kind]})",
            "warns",
        )
        for name, kind in unknown.items()
    ]
    gone = {one.name for one in inks if one.role == "sacrificial"}
    stays = {one.name for one in inks if one.role in STAYING}
    if writes == "vessels" and stays:
        checks.append(
            _role_check(
                f"ink for {writes}",
                f"{' and '.join(sorted(stays))} isn't removed, so the filaments would become solid "
                f"cords, not open vessels; use a sacrificial ink ({_fitting_inks(False, bath)}), "
                "or, if you want solid cords, set toolpath.writes: cords",
            )
        )
    if writes != "vessels" and gone and not stays:
        checks.append(
            _role_check(
                f"ink for {writes}",
                f"{' and '.join(sorted(gone))} is sacrificial, so nothing of the {writes} would "
                f"remain after removal; use a structural ink ({_fitting_inks(True, bath)})",
            )
        )
    if writes == "layers" and bath.role == "matrix":
        checks.append(
            _role_check(
                f"bath for {writes}",
                f"{bath.name} is permanent, so the part couldn't be removed from it; use a support "
                f"bath ({_fitting_baths('support', inks)})",
            )
        )
    if writes == "vessels" and bath.role == "support":
        checks.append(
            _role_check(
                f"bath for {writes}",
                f"{bath.name} is removed after printing, so no gel would remain around the "
                f"vessels; use a matrix bath ({_fitting_baths('matrix', inks)})",
            )
        )
    return checks


Writes = Literal["layers", "vessels", "cords"]


def writes_of_job(folder: Path, style: Style | None) -> Writes | None:
    """Return what a mapped job writes; None where neither map nor the run's recipe says it."""
    if style != "embedded":
        return None if style is None else "layers"
    recipe = Manifest.load(folder).facts.get("recipe")
    if not isinstance(recipe, dict):
        return None
    return "cords" if recipe.get("toolpath", {}).get("writes") == "cords" else "vessels"


STAYING: Final = ("structural", "cell_laden")
_ROLES: Final = {"ink": "structural, cell_laden or sacrificial", "bath": "support or matrix"}


def _role_check(name: str, remedy: str, weight: Weight = "refuses") -> Check:
    return finding(Kind.ROLE, name, "role", remedy, weight)


def _fitting_inks(stay: bool, bath: Bath) -> str:
    """Shipped inks that stay, or don't; those that set in the bath where any does."""
    inks = {name: load(Ink, name) for name in shipped(Ink)}
    those = {name: ink for name, ink in inks.items() if (ink.role in STAYING) == stay}
    set_there = [name for name, ink in those.items() if chemistry_check(ink, bath).passed]
    return f"shipped: {', '.join(set_there or those)}"


def _fitting_baths(role: BathRole, inks: Sequence[Ink]) -> str:
    """Shipped baths of a role; those that set the inks where any does."""
    baths = {name: load(Bath, name) for name in shipped(Bath)}
    those = {name: bath for name, bath in baths.items() if bath.role == role}
    setting = [
        name
        for name, bath in those.items()
        if all(chemistry_check(ink, bath).passed for ink in inks)
    ]
    return f"shipped: {', '.join(setting or those)}"


def bath_checks(bath: Bath) -> list[Check]:
    """Whether the bath holds while printing and still melts out; whether its profile is whole."""
    others = [check for check in profile_checks(bath) if check.place != "max_printing_c"]
    if bath.melt_out_c is None:
        return others
    return [
        Check(
            Kind.MELT_OUT,
            "bath printing temperature vs. melt-out",
            bath.max_printing_c,
            bath.melt_out_c,
            "°C",
            bath.max_printing_c < bath.melt_out_c,
            "bath: max_printing_c",
            f"correct the profile of {bath.name}: the bath would melt during printing",
        ),
        *others,
    ]


def held_check(widest_mm: float, ink: Ink, bath: Bath) -> Check:
    """The thickest filament written, against what the bath's yield stress holds up."""
    held = supported_diameter_mm(bath, ink)
    # Where densities are equal nothing sinks; a limit must be a number all the same.
    limit = held if math.isfinite(held) else widest_mm
    return Check(
        Kind.FILAMENT_HELD,
        "thickest filament in the bath",
        widest_mm,
        limit,
        "mm",
        widest_mm <= limit,
        "bath: yield_stress_pa, density_g_cm3",
        f"{ink.name} would sink or float in {bath.name}; print thinner filaments, or use a bath "
        "with a higher yield stress or a closer density",
        "refuses" if bath.calibrated and ink.calibrated else "warns",
    )


def syringe_check(run: DryRun, syringe: Syringe) -> Check:
    """Ink pushed at the farthest point, with what stays in the needle, against the filling."""
    area = syringe.area_mm2
    needed = run.plunger_max_mm * area + syringe.dead_volume_ul
    over = np.flatnonzero(run.program.plunger * area + syringe.dead_volume_ul > syringe.volume_ul)
    line = f"line {int(run.program.line[over[0]])}, " if len(over) else ""
    return Check(
        Kind.SYRINGE_VOLUME,
        f"ink incl. {syringe.dead_volume_ul:g} µL dead volume",
        needed,
        syringe.volume_ul,
        "µL",
        needed <= syringe.volume_ul,
        f"{line}syringe: volume_ul",
        f"exceeds the volume of {syringe.name}; {larger_syringe(needed - syringe.dead_volume_ul)} "
        "or print a smaller part",
    )


def larger_syringe(pushed_ul: float) -> str:
    """Say which shipped syringe can push so much, µL: the smallest, if there is one."""
    syringes = {name: load(Syringe, name) for name in shipped(Syringe)}
    large = [n for n, one in syringes.items() if one.volume_ul - one.dead_volume_ul >= pushed_ul]
    least = min(large, key=lambda name: syringes[name].volume_ul, default="")
    return f"use a larger syringe (syringe: {least})" if least else "use a larger syringe"


def syringe_checks(run: DryRun, printer: Printer, syringe: Syringe) -> list[Check]:
    """What the syringe holds, and what the firmware must let it push.

    What a pneumatic head takes hangs on its flow, and so on ink and needle: `force_checks`.
    """
    if printer.pneumatic:
        return profile_checks(syringe)
    return [
        syringe_check(run, syringe),
        *widest_push_check(run, printer, syringe),
        *profile_checks(syringe),
    ]
