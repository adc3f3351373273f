"""Steps of a commissioning with the first part: print it, register its scan, correct."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from printctl.commissioning.bench import Bench
from printctl.commissioning.first_part import (
    RUN,
    SCAN,
    run_part,
    slice_first_part,
    write_first_part,
)
from printctl.commissioning.print_steps import mount_on, parts_of
from printctl.commissioning.state import CheckFailedError, Desk
from printctl.corrections.compensation import changes_line, save_compensation
from printctl.corrections.feedback.estimate import Choices, estimate
from printctl.corrections.feedback.evidence import read_print
from printctl.errors import PrintctlError
from printctl.pipeline.running.run import RunOptions
from printctl.run_folder.artefacts import JOURNAL_FOLDER
from registration.errors import RegistrationError

COMPENSATION: Final = "compensation.yaml"


def first_part(desk: Desk, bench: Bench) -> str:
    """Print the part through the station."""
    folder, parts = desk.commission.folder / "part", parts_of(desk)
    floor = bench.profile.z_mm.low

    def print_part() -> dict[str, Any]:
        station = bench.station()
        mount_on(
            station,
            parts,
            dish=parts.dish,
            bath=parts.bath,
            dish_centre_mm=parts.dish_centre_mm,
            bath_depth_mm=parts.depth_mm,
            floor_mm=floor,
        )
        bench.move_above(station, start)
        return bench.print(gcode, gcode.parent / JOURNAL_FOLDER, parts.syringe, parts.ink)

    if "printed" not in desk.record.facts:
        gcode, start = slice_first_part(folder, bench.printer, bench.port, parts)
        desk.once(
            "fresh_dish",
            lambda: True,
            "Lift the needle clear, and put a fresh dish with bath into the same holder, so that "
            "the floor is where it was touched off. Is it in place?",
        )
        desk.once(
            "printed", print_part, f"Print the first part ({gcode})? The needle moves and prints."
        )
    return f"{desk.record.facts['printed']['lines']} lines printed; the part stands in the dish"


def first_scan(desk: Desk, bench: Bench) -> str:
    """Register the scan of the part."""
    folder, parts = desk.commission.folder / "part", parts_of(desk)
    scan: dict[str, Any] = dict(SCAN)
    if not bench.simulated:
        file = desk.ask("scan", "File of the part's scan (OCT or micro-CT; .tif, .oct, .nii …)?")
        scan = {"file": str(Path(file).resolve())}
        text = "Voxel X,Y,Z in µm, or 'file' where the file says it?"
        if (voxel := desk.ask("voxel_um", text, "file")) != "file":
            scan["voxel_um"] = desk.numbers("voxel_um", text, 3, voxel)
    desk.say("registering the scan with the design; this takes some seconds")
    recipe = write_first_part(folder, bench.printer, bench.port, parts, scan)
    try:
        data = run_part(recipe, RunOptions(printed=True, assume_yes=True))
        read_print(folder / RUN)
    except (RegistrationError, PrintctlError) as exc:
        raise CheckFailedError(f"the scan can't be used: {exc}", *("scan", "voxel_um")) from exc
    verdict = data["verdict"]
    desk.record.facts |= {"report": str(folder / RUN / "report.html"), "passed": verdict["passed"]}
    for reason in verdict["reasons"]:
        desk.say(reason)
    judged = "passes" if verdict["passed"] else "doesn't pass yet"
    return f"the scan fits the design in one pose; the part {judged} ({verdict['reasons'][0]})"


def correction(desk: Desk, bench: Bench) -> str:
    """Derive the compensation, slice the part again with it."""
    folder, parts = desk.commission.folder / "part", parts_of(desk)
    made = estimate([read_print(folder / RUN)], Choices())
    save_compensation(folder / COMPENSATION, made)
    for note in made.notes:
        desk.say(note)
    again = desk.commission.folder / "corrected_part"
    save_compensation(again / COMPENSATION, made)
    recipe = write_first_part(
        again, bench.printer, bench.port, parts, SCAN, compensation=COMPENSATION
    )
    data = run_part(recipe, RunOptions(until="lumens"))
    desk.record.facts |= {"compensation": str(folder / COMPENSATION), "recipe": str(recipe)}
    desk.record.facts["print_time_s"] = data["dry_run"]["print_time_s"]
    bench.close()
    return (
        f"{changes_line(made)}; {folder / COMPENSATION} goes into a recipe's "
        f"toolpath.compensation, as in {recipe}"
    )
