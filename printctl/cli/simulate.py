"""`printctl simulate`: dry-run and check a G-code file; optionally predict the ink in the bath."""

from __future__ import annotations

from pathlib import Path

from design.units import LengthUnit
from firmware_profiles import Printer, load
from firmware_profiles.tools import THINNEST_BORE
from printctl.checks.preflight import file_checks, placed_failures, warnings
from printctl.checks.preflight.shaft import file_shaft
from printctl.checks.set_up import ProfileNames, refusal_of, set_up
from printctl.cli import simulate_options as options
from printctl.cli.declare import command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import (
    BathDepthOption,
    BathOption,
    DishCentreOption,
    DishOption,
    JsonFlag,
    NeedleOption,
    PrinterOption,
    StartOption,
    SyringeOption,
    ThinnestBoreOption,
    folder_to_write,
    messages,
    print_json,
    print_lines,
    read_gcode_file,
)
from printctl.cli.start_position import read_start_position
from printctl.failures import error_facts
from printctl.settings import arg, opt
from sim.gcode.dry_run.run import dry_run


@command
def simulate(
    file: Path = arg("The G-code file."),
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    ink: str = opt("Ink profile.", "collagen_fresh"),
    needle: NeedleOption = None,
    thinnest_bore: ThinnestBoreOption = THINNEST_BORE,
    bath: BathOption = None,
    dish: DishOption = None,
    dish_centre: DishCentreOption = None,
    bath_depth: BathDepthOption = None,
    start: StartOption = None,
    out: Path | None = opt(
        "Folder for what will lie in the bath: tables, a time line, voxels.",
        callback=folder_to_write,
    ),
    lag_s: float | None = opt("τ of the ink's flow, instead of its profile's.", min=0.0, max=100),
    network: Path | None = opt(
        "The designed vessels, for the diameter of each: a file or a run folder."
    ),
    unit: LengthUnit | None = opt("Of the network's file, if it doesn't say."),
    place: str | None = opt(
        "The part's origin in the printer's frame, mm; found from what is written if not.",
        metavar="X,Y,Z",
    ),
    voxel_um: float | None = opt("Write voxels (NRRD) and a surface (PLY).", min=1, max=2000),
    window_s: str | None = opt("Of the time line; the whole job if not.", metavar="FROM,TO"),
    as_json: JsonFlag = False,
) -> None:
    """Run a G-code file through the planner without a printer: time, limits, ink.

    With --out, --lag-s or --network it predicts what will lie in the bath, too. Ends with exit
    code 3 when a check fails; the line and the reason are named.
    """
    have_kernels("simulate")
    profile = load(Printer, printer)
    tip = read_start_position(file, profile, start)
    given = ProfileNames(needle, bath, dish, dish_centre, bath_depth, thinnest_bore)
    mounted = set_up(profile, syringe, ink, tip, given)
    gcode = read_gcode_file(file)
    run = dry_run(gcode, profile, tip)
    shaft = file_shaft(file, run, mounted)
    checks = [*file_checks(run, mounted, file.with_suffix(".map.npz")), *shaft.checks]
    choices = options.BeadChoices(out, lag_s, network, unit, place, voxel_um, window_s)
    bead = None
    if choices.asks:
        # What measures and draws the bead takes seconds to load; the dry run needs none of it.
        from printctl.cli.simulate_bead import print_predictions, write_predictions

        bead = write_predictions(file, gcode, run, mounted, choices, placed_failures(checks))
    refusal = refusal_of(checks)
    if as_json:
        print_json(
            {
                "file": str(file),
                "printer": profile.name,
                "duration_s": run.duration_s,
                "blocks": len(run.executed),
                "merged_moves": run.merged_moves,
                "passed": not any(check.refuses for check in checks),
                "checks": [check.as_dict() for check in checks],
                **({} if bead is None else {"predicted": bead}),
                **shaft.facts(),
                **(error_facts(refusal, str(refusal), refusal.exit_code) if refusal else {}),
            }
        )
    else:
        print_lines(
            f"{run.duration_s:.2f} s on {profile.name}, {len(run.executed)} blocks, "
            f"{run.merged_moves} moves merged by the firmware",
            *shaft.lines(),
            *(check.row() for check in checks),
        )
        for text in warnings(checks):
            messages().print(f"note: {text}", markup=False)
        if bead is not None:
            print_predictions(bead)
    if refusal:
        raise refusal
