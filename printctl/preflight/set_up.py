"""All checks of a file and of what is mounted for it, as far as that was named."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Bath, Ink, Needle, Printer, Syringe
from printctl.preflight.check import Check
from printctl.preflight.dish_checks import Standing, dish_checks, floor_check, unknown_dish
from printctl.preflight.force_checks import force_checks
from printctl.preflight.gcode_checks import gcode_checks
from printctl.preflight.material_checks import bath_checks, chemistry_check, temperature_checks
from printctl.preflight.setup_checks import syringe_checks
from printctl.preflight.step_checks import step_checks
from printctl.preflight.viability_checks import PrintTime, budget_of, viability_checks
from sim.dryrun import DryRun


@dataclass(frozen=True)
class SetUp:
    """What is mounted and filled.

    Attributes
    ----------
    printer : Printer
    syringe : Syringe
    ink : Ink
    needle, bath : Needle, Bath or None
        None where nobody said it.
    standing : Standing or None
        The dish, where it stands and how high it is filled.
    """

    printer: Printer
    syringe: Syringe
    ink: Ink
    needle: Needle | None = None
    bath: Bath | None = None
    standing: Standing | None = None


def file_checks(run: DryRun, setup: SetUp) -> list[Check]:
    """Every check of a dry run, passed or not; what can't be looked at is a warning."""
    checks = [
        *gcode_checks(run, setup.printer),
        *syringe_checks(run, setup.printer, setup.syringe),
        *step_checks(run, setup.printer, setup.syringe),
        *viability_checks(PrintTime(run.duration_s), budget_of(setup.ink)),
    ]
    missing = [
        name for name, part in (("needle", setup.needle), ("bath", setup.bath)) if part is None
    ]
    if setup.needle is not None:
        checks += force_checks(run, setup.ink, setup.needle, setup.syringe, setup.printer)
    if setup.bath is not None:
        checks += [
            chemistry_check(setup.ink, setup.bath),
            *bath_checks(setup.bath),
            *temperature_checks(run, setup.ink, setup.bath),
            floor_check(run, setup.bath, setup.printer.z_mm.low),
        ]
    if setup.needle is not None and setup.standing is not None:
        checks += dish_checks(run, setup.standing, setup.needle)
    elif setup.standing is None:
        checks.append(unknown_dish())
    return checks + ([_unnamed(missing)] if missing else [])


def _unnamed(missing: list[str]) -> Check:
    what = {
        "needle": "force and walls (needle)",
        "bath": "chemistry, temperatures and the floor (bath)",
    }
    return Check(
        "set-up",
        0,
        0,
        "",
        False,
        " and ".join(missing),
        f"not named, so {' and '.join(what[name] for name in missing)} weren't looked at",
        "warns",
    )
