"""Checks of mounted parts: consistent profiles, needle length, chemistry, syringe volume."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from firmware_profiles import (
    Bath,
    Facts,
    Ink,
    Needle,
    Printer,
    ProfileError,
    Syringe,
    load,
    profile_doubts,
    supported_diameter_mm,
)
from printctl.checks.preflight.firmware import widest_push_check
from printctl.checks.set_up import Check
from printctl.run_folder.manifest import Manifest
from sim.gcode.dry_run.run import DryRun


def profile_checks(*profiles: Facts) -> list[Check]:
    """A refusal for each grave doubt about a profile; nothing for one that is in order."""
    return [
        Check(
            f"profile {facts.name}",
            0,
            0,
            "",
            False,
            doubt.key,
            f"{doubt.text}; `printctl profiles check` tells all that is wrong with it",
        )
        for facts in profiles
        for doubt in profile_doubts(facts)
        if doubt.grave
    ]


SAME_AREA: Final = 0.02
"""Relative difference of two syringes' cross-sections that is no other amount of ink."""


def made_for_checks(folder: Path, printer: Printer, syringes: Sequence[Syringe]) -> list[Check]:
    """Whether each head's syringe lays the ink that a run's G-code was made for.

    Plunger moves are lengths: a wider syringe lays more ink by the same moves. Nothing for a folder
    that isn't a run's, or where no plunger moves.
    """
    recipe = Manifest.load(folder).facts.get("recipe")
    if printer.pneumatic or not isinstance(recipe, dict):
        return []
    part = recipe.get("printer", {})
    names = [head.get("syringe") for head in part.get("heads") or ()] or [part.get("syringe")]
    checks = []
    for name, syringe in zip(names, syringes, strict=False):
        if not name:
            continue
        try:
            made_for = load(Syringe, name)
        except ProfileError:  # of a file that has gone; the run itself tells its name
            continue
        ratio = syringe.area_mm2 / made_for.area_mm2
        checks.append(
            Check(
                "ink laid, of what the job was made for",
                ratio,
                1.0,
                "times",
                abs(ratio - 1.0) <= SAME_AREA,
                "syringe: inner_mm",
                f"the job's plunger moves are for {name} ({made_for.inner_mm:g} mm inside), and "
                f"{syringe.name} has {syringe.inner_mm:g} mm; take that syringe, or make the "
                "design with this one",
            )
        )
    return checks


# Check needle length, ink and bath chemistry, and filament support, without G-code.

_WORDS: Final = {
    "neutral_ph": "a buffer of neutral pH",
    "calcium": "calcium",
    "thrombin": "thrombin",
}


def needle_check(part_height_mm: float, needle: Needle) -> Check:
    """Whether the needle reaches the part's bottom before its hub dips into the bath."""
    return Check(
        "depth of the part against the needle's length",
        part_height_mm,
        needle.length_mm,
        "mm",
        part_height_mm <= needle.length_mm,
        "needle: length_mm",
        f"the hub of {needle.name} would dip in; use a longer needle or a flatter part",
    )


def chemistry_check(ink: Ink, bath: Bath) -> Check:
    """Whether the bath has what sets the ink; without it the print runs away."""
    missing = [trigger for trigger in ink.gelled_by if trigger not in bath.provides]
    needs = " and ".join(_WORDS[trigger] for trigger in missing)
    return Check(
        "what sets the ink and the bath lacks",
        len(missing),
        0,
        "",
        not missing,
        "bath: provides",
        f"{ink.name} sets by {needs}, which {bath.name} doesn't have (gelled_by, provides); take "
        "another bath, or say in its profile that it is in it",
    )


def bath_checks(bath: Bath) -> list[Check]:
    """Whether the bath holds while printing and still melts out; whether its profile is whole."""
    others = [check for check in profile_checks(bath) if check.place != "max_printing_c"]
    if bath.melt_out_c is None:
        return others
    return [
        Check(
            "printing temperature of the bath, below its melt-out",
            bath.max_printing_c,
            bath.melt_out_c,
            "°C",
            bath.max_printing_c < bath.melt_out_c,
            "bath: max_printing_c",
            f"mend the profile of {bath.name}: it would melt while it is printed in",
        ),
        *others,
    ]


def held_check(widest_mm: float, ink: Ink, bath: Bath) -> Check:
    """The thickest filament written, against what the bath's yield stress holds up."""
    held = supported_diameter_mm(bath, ink)
    # Where densities are equal nothing sinks; a limit must be a number all the same.
    limit = held if math.isfinite(held) else widest_mm
    return Check(
        "thickest filament in the bath",
        widest_mm,
        limit,
        "mm",
        widest_mm <= limit,
        "bath: yield_stress_pa, density_g_cm3",
        f"{ink.name} would sink or float in {bath.name}; write it thinner, or take a bath with "
        "more yield stress or nearer in density",
        "refuses" if bath.calibrated and ink.calibrated else "warns",
    )


# Check that the syringe holds a job's ink, and the push per length the firmware must allow.


def syringe_check(run: DryRun, syringe: Syringe) -> Check:
    """Ink pushed at the farthest point, with what stays in the needle, against the filling."""
    area = syringe.area_mm2
    needed = run.plunger_max_mm * area + syringe.dead_volume_ul
    over = np.flatnonzero(run.program.plunger * area + syringe.dead_volume_ul > syringe.volume_ul)
    line = f"line {int(run.program.line[over[0]])}, " if len(over) else ""
    return Check(
        f"ink, with {syringe.dead_volume_ul:g} µL dead volume",
        needed,
        syringe.volume_ul,
        "µL",
        needed <= syringe.volume_ul,
        f"{line}syringe: volume_ul",
        f"more than {syringe.name} holds; use a larger syringe or a smaller part",
    )


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
