"""Run all preflight checks of a G-code file with its mounted profiles."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from firmware_profiles import Printer, ProfileError
from gcode.deposit.lay import Style
from gcode.dry_run.run import DryRun
from printctl.checks.gcode_view.line_map import mapped_style
from printctl.checks.made_for import read_made_for, set_up_checks
from printctl.checks.preflight.bore import drop_checks, line_checks
from printctl.checks.preflight.dish import PLACE_OPTION, dish_checks, floor_check, unknown_dish
from printctl.checks.preflight.force import force_checks
from printctl.checks.preflight.gcode import LEFT_DOWN, gcode_checks
from printctl.checks.preflight.heads import check_each_head, head_checks
from printctl.checks.preflight.ink import (
    temperature_checks,
    volumes,
    written_ul,
)
from printctl.checks.preflight.mounted import (
    bath_checks,
    chemistry_check,
    role_checks,
    syringe_checks,
    writes_of_job,
)
from printctl.checks.preflight.steps import step_checks
from printctl.checks.preflight.wells import Wells, read_wells, well_checks
from printctl.checks.set_up import Check, HeadLoading, SetUp
from printctl.errors import UsageError


def file_checks(
    run: DryRun,
    setup: SetUp,
    map_path: Path | None = None,
    *,
    real: bool = False,
    lifted: bool = False,
) -> list[Check]:
    """Every check of a dry run, passed or not, but for the print time's (`plan_syringes`).

    What isn't named can't be checked: a warning, or before a ``real`` print a refusal. A file that
    leaves the needle in the print is refused where it must be ``lifted``, as before a real print.
    Of a plate's job the map says where wells are.
    """
    checks = gcode_checks(run, setup.printer, PLACE_OPTION)
    if real or lifted:
        checks = [
            replace(one, weight="refuses") if one.check == LEFT_DOWN else one for one in checks
        ]
    checks += set_up_checks(read_made_for(run.opening), setup)
    loads = [setup.load_of(k) for k in range(setup.printer.head_count)]
    ink_ul = written_ul(run, setup.printer, loads)
    wells = None if map_path is None else _wells(run, setup, loads, map_path)
    style = None if map_path is None else mapped_style(map_path)
    missing = [
        name for name, part in (("needle", setup.needle), ("bath", setup.bath)) if part is None
    ]
    if setup.printer.heads:
        checks += check_each_head(
            run,
            setup.printer,
            lambda k, view, one: _of_head(view, one, setup, loads[k], ink_ul, style),
        )
        checks += head_checks(run, setup.printer, setup.standing, [one.needle for one in loads])
    else:
        checks += _of_head(run, setup.printer, setup, loads[0], ink_ul, style)
    if setup.bath is not None:
        checks += bath_checks(setup.bath)
        writes = None if map_path is None else writes_of_job(map_path.parent, style)
        if writes is not None:
            checks += role_checks([one.ink for one in loads], setup.bath, writes)
    if wells is not None and setup.needle is not None:
        checks += well_checks(run, wells, setup.needle)
    if setup.standing is None and wells is None:
        checks.append(unknown_dish("--dish", real=real and "dish" not in setup.absent))
    if missing:
        checks.append(_unnamed(missing, real and not set(missing) <= set(setup.absent)))
    return checks


def _wells(run: DryRun, setup: SetUp, loads: Sequence[HeadLoading], map_path: Path) -> Wells | None:
    try:
        return read_wells(map_path, run.program.line, volumes(run, setup.printer, loads))
    except ProfileError:  # a pressure that moves no ink is said by a check of its own
        return None
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as exc:
        raise UsageError(
            f"{map_path} can't be read ({exc}); generate the G-code and its map again, or move the "
            "map away"
        ) from exc


def _of_head(
    run: DryRun,
    printer: Printer,
    setup: SetUp,
    load: HeadLoading,
    ink_ul: float,
    style: Style | None,
) -> list[Check]:
    """Checks of what one head holds, and of its needle's way; all heads write ``ink_ul``."""
    checks = [
        *syringe_checks(run, printer, load.syringe),
        *step_checks(run, printer, load.syringe),
        *temperature_checks(run, load.ink, setup.bath),
    ]
    if load.needle is not None:
        checks += force_checks(run, load.ink, load.needle, load.syringe, printer)
        checks += line_checks(run, printer, load, setup.thinnest_bore, style)
    if setup.bath is not None:
        checks += drop_checks(run, printer, load)
        checks += [
            chemistry_check(load.ink, setup.bath),
            floor_check(run, setup.bath, printer.z_mm.low, PLACE_OPTION),
        ]
    if load.needle is not None and setup.standing is not None:
        checks += dish_checks(run, setup.standing, load.needle, ink_ul)
    return checks


def _unnamed(missing: list[str], real: bool) -> Check:
    what = {
        "needle": "plunger force and dish walls",
        "bath": "gelation, temperatures and floor clearance",
    }
    return Check(
        "set-up",
        0,
        0,
        "",
        False,
        ", ".join(f"--{name}" for name in missing),
        f"{' and '.join(missing)} not set, so {' and '.join(what[name] for name in missing)} "
        "weren't checked; specify what is mounted (none for nothing)",
        "refuses" if real else "warns",
    )
