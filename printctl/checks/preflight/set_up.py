"""Run all preflight checks of a G-code file with its mounted profiles."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from firmware_profiles import Printer, ProfileError
from gcode.deposit.lay import Style
from gcode.dry_run.run import DryRun
from printctl.checks.gcode_view.line_map import mapped_style
from printctl.checks.kinds import Kind
from printctl.checks.made_for import read_made_for, set_up_checks
from printctl.checks.preflight.bore import drop_checks, line_checks
from printctl.checks.preflight.dish import dish_checks, floor_check, unknown_dish
from printctl.checks.preflight.force import force_checks
from printctl.checks.preflight.gcode import gcode_checks
from printctl.checks.preflight.heads import check_each_head, head_checks
from printctl.checks.preflight.ink import (
    temperature_checks,
    volumes,
    written_ul,
)
from printctl.checks.preflight.mounted import (
    Writes,
    bath_checks,
    chemistry_check,
    held_check,
    needle_check,
    role_checks,
    syringe_checks,
    writes_of_job,
)
from printctl.checks.preflight.steps import step_checks
from printctl.checks.preflight.wells import Wells, read_wells, well_checks
from printctl.checks.set_up import Check, HeadLoading, SetUp, finding
from printctl.errors import UsageError


@dataclass(frozen=True)
class Designed:
    """What a recipe knows of the part, besides its G-code.

    Attributes
    ----------
    depth_mm : float, mm
        Of the whole part.
    widest_mm : sequence of float, mm
        Thickest filament or line of each head.
    writes : "layers", "vessels" or "cords"
    well_factor : mapping of str to float
        By well of a plate, its ink over what the G-code pushes at the set-up's flow factor.
    """

    depth_mm: float
    widest_mm: Sequence[float]
    writes: Writes
    well_factor: Mapping[str, float] = field(default_factory=dict)


def file_checks(
    run: DryRun,
    setup: SetUp,
    map_path: Path | None = None,
    *,
    real: bool = False,
    designed: Designed | None = None,
) -> list[Check]:
    """Every check of a dry run, passed or not, but for shaft, syringe changes and viability.

    What isn't named can't be checked: a warning, or before a ``real`` print a refusal. Of a plate's
    job the map says where wells are. `printctl.pipeline.checked_order` adds the rest.
    """
    checks = gcode_checks(run, setup.printer, setup.keys.place)
    checks += set_up_checks(read_made_for(run.opening), setup)
    loads = setup.loads
    ink_ul = written_ul(run, setup.printer, loads)
    wells = None if map_path is None else read_map_wells(run, setup, map_path)
    style = None if map_path is None else mapped_style(map_path)

    def of_head(number: int, view: DryRun, printer: Printer) -> list[Check]:
        own = _of_head(view, printer, setup, loads[number], ink_ul, style)
        return own + ([] if designed is None else _of_part(designed, number, setup))

    if setup.printer.heads:
        checks += check_each_head(run, setup.printer, of_head)
        checks += head_checks(run, setup.printer, setup.standing, [one.needle for one in loads])
    else:
        checks += of_head(0, run, setup.printer)
    if setup.bath is not None:
        checks += bath_checks(setup.bath)
        writes = designed.writes if designed is not None else None
        if writes is None and map_path is not None:
            writes = writes_of_job(map_path.parent, style)
        if writes is not None:
            checks += role_checks([one.ink for one in loads], setup.bath, writes)
    if wells is not None and setup.needle is not None:
        factor = {} if designed is None else designed.well_factor
        true_ul = {name: ul * factor.get(name, 1.0) for name, ul in wells.ink_ul.items()}
        checks += well_checks(run, replace(wells, ink_ul=true_ul), setup.needle)
    missing = [
        name for name, part in (("needle", setup.needle), ("bath", setup.bath)) if part is None
    ]
    if setup.standing is None and wells is None:
        option = setup.keys.part.format("dish")
        checks.append(unknown_dish(option, real=real and "dish" not in setup.absent))
    if missing:
        checks.append(_unnamed(missing, setup, real and not set(missing) <= set(setup.absent)))
    return checks


def read_map_wells(run: DryRun, setup: SetUp, map_path: Path) -> Wells | None:
    """Return the wells of a plate's job by its map; None for another job.

    Raises
    ------
    UsageError
        For a map that can't be read.
    """
    try:
        return read_wells(map_path, run.program.line, volumes(run, setup.printer, setup.loads))
    except ProfileError:  # a pressure that moves no ink is said by a check of its own
        return None
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as exc:
        raise UsageError(
            f"{map_path} can't be read ({exc}); generate the G-code and its map again, or move the "
            "map away"
        ) from exc


def _of_part(designed: Designed, number: int, setup: SetUp) -> list[Check]:
    """What the part asks of a head's needle and of the bath."""
    held, bath = setup.load_of(number), setup.bath
    return [
        *([] if held.needle is None else [needle_check(designed.depth_mm, held.needle)]),
        *([] if bath is None else [held_check(designed.widest_mm[number], held.ink, bath)]),
    ]


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
            floor_check(run, setup.bath, printer.z_mm.low, setup.keys.place),
        ]
    if load.needle is not None and setup.standing is not None:
        checks += dish_checks(run, setup.standing, load.needle, ink_ul)
    return checks


def _unnamed(missing: list[str], setup: SetUp, real: bool) -> Check:
    what = {
        "needle": "plunger force and dish walls",
        "bath": "gelation, temperatures and floor clearance",
    }
    return finding(
        Kind.UNKNOWN_PART,
        "set-up",
        ", ".join(map(setup.keys.part.format, missing)),
        f"{' and '.join(missing)} not set, so {' and '.join(what[name] for name in missing)} "
        "weren't checked; specify what is mounted (none for nothing)",
        "refuses" if real else "warns",
    )
