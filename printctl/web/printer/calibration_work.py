"""Write weighing or backlash tests, fit their readings, save the result as a profile copy."""

from __future__ import annotations

import math
from pathlib import Path

from firmware_profiles import Printer, Syringe
from printctl.calibration.paths import backlash_path, weighing_path
from printctl.calibration.readings import Readings
from printctl.calibration.results import (
    Result,
    backlash_result,
    level_result,
    offset_result,
    weighing_of,
    weighing_result,
)
from printctl.calibration.writing import (
    CalibrationOutput,
    Job,
    make_test,
    measured_key,
    save_measured,
)
from printctl.web.printer.calibration import BY_NAME, CalibrationRequest, Mend, Read
from printctl.web.profile_store import ProfileStore


def write_test(
    name: str, asked: CalibrationRequest, printer: Printer, syringe: Syringe, path: Path
) -> tuple[list[list[str]], CalibrationOutput]:
    """Write the test; give the sheet's rows, their last column to be filled in."""
    columns = BY_NAME[name].columns
    if name == "weigh":
        doses = list(asked.doses_ul) * asked.repeats
        per_ul = 4 / (math.pi * syringe.inner_mm**2)
        rows = [[f"{dose * per_ul:.5f}", ""] for dose in doses]
        toolpath = weighing_path(doses, asked.flow_ul_s, asked.wait_s)
    else:
        toolpath, places, sides = backlash_path(
            asked.axis,
            list(asked.targets_mm),
            overshoot_mm=asked.overshoot_mm,
            speed_mm_s=asked.speed_mm_s,
            wait_s=min(asked.wait_s, 8.0),
            syringe=syringe,
        )
        rows = [[f"{p:g}", f"{s:g}", ""] for p, s in zip(places, sides, strict=True)]
    job = Job(path, toolpath, printer, syringe, asked.at_mm)
    return rows, make_test(job, columns, rows, {})


def fit_readings(name: str, data: Readings, read: Read, store: ProfileStore) -> Result:
    """What the readings of a calibration say."""
    if name == "weigh":
        weighing = weighing_of(data, read.density_g_cm3, read.density_error)
        printer = store.load(Printer, read.printer)
        return weighing_result(weighing, printer, store.load(Syringe, read.syringe))
    if name == "level":
        return level_result(data, *read.part_mm)
    return offset_result(data) if name == "offset" else backlash_result(data)


def write_profile_copy(
    data: Readings,
    read: Read,
    mend: Mend,
    copy: str,
    store: ProfileStore,
) -> str:
    """Write what was weighed into a copy of a profile; say what changed."""
    weighing = weighing_of(data, read.density_g_cm3, read.density_error)
    printer = store.load(Printer, read.printer)
    syringe = store.load(Syringe, read.syringe)
    if mend == "printer":
        measured = measured_key(printer, "steps_per_mm.e", weighing.steps_per_mm(printer, syringe))
        return save_measured(store.new_file(Printer, copy), printer, measured)
    measured = measured_key(syringe, "inner_mm", weighing.bore_mm())
    return save_measured(store.new_file(Syringe, copy), syringe, measured)
