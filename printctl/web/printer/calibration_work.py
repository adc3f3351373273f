"""Write weighing or backlash tests, fit their readings, save the result as a profile copy."""

from __future__ import annotations

from pathlib import Path

from firmware_profiles import Printer, Syringe
from printctl.calibration.paths import backlash_test, weighing_test
from printctl.calibration.readings import Readings
from printctl.calibration.results import (
    Result,
    backlash_result,
    level_result,
    offset_result,
    weighing_result,
)
from printctl.calibration.writing import CalibrationOutput, Job, make_test
from printctl.web.printer.calibrations import CalibrationRequest, Mend, Read
from printctl.web.profile_store import ProfileStore


def write_test(
    name: str, asked: CalibrationRequest, printer: Printer, syringe: Syringe, path: Path
) -> tuple[list[list[str]], CalibrationOutput]:
    """Write the test; give the sheet's rows, their last column to be filled in."""
    if name == "weigh":
        doses = asked.doses_ul * asked.repeats
        test = weighing_test(doses, asked.flow_ul_s, asked.wait_s, syringe)
    else:
        test = backlash_test(
            asked.axis,
            asked.targets_mm,
            overshoot_mm=asked.overshoot_mm,
            speed_mm_s=asked.speed_mm_s,
            wait_s=min(asked.wait_s, 8.0),
            syringe=syringe,
        )
    made = make_test(Job(path, test, printer, syringe, asked.at_mm))
    return [[*row, ""] for row in test.rows], made


def fit_readings(
    name: str, data: Readings, read: Read, store: ProfileStore, mend: Mend = "printer"
) -> Result:
    """What the readings of a calibration say."""
    if name == "weigh":
        density = (read.density_g_cm3, read.density_error)
        mounted = store.load(Printer, read.printer), store.load(Syringe, read.syringe)
        return weighing_result(data, density, *mounted, "steps" if mend == "printer" else "bore")
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
    weighed = fit_readings("weigh", data, read, store, mend)
    return weighed.save(store.new_file(Printer if mend == "printer" else Syringe, copy))
