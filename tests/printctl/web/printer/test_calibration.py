"""Calibrations on the page: same results as the command line."""

import math
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, Syringe, load
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.printer.calibration_requests import CalibrationRequest, Read
from printctl.web.printer.service import PrinterService
from tests.printctl.web.printer.conftest import ME

AT = (100.0, 100.0, 50.0)


def weighed(share: float) -> Read:
    """Doses of a plunger whose steps give ``share`` of what they should."""
    syringe = load(Syringe, "hamilton_1ml")
    area = math.pi / 4 * syringe.inner_mm**2
    rng = np.random.default_rng(1)
    rows = []
    for ul in (20.0, 40.0, 60.0) * 4:
        mass = 0.998 * ul * share + rng.normal(0, 0.02)
        rows.append((f"{ul / area:.5f}", f"{mass:.2f}"))
    return Read(rows=tuple(rows), printer="generic_marlin", syringe="hamilton_1ml")


def test_a_test_lies_among_the_jobs_with_its_sheet(idle: PrinterService) -> None:
    made = idle.calibrating.make(
        ME, "weigh", CalibrationRequest(printer="generic_marlin", at_mm=AT)
    )
    job = idle.core.workspace.job_file(made.job)
    assert made.job in idle.core.workspace.jobs()
    assert len(made.rows) == 12
    assert all(row[-1] == "" for row in made.rows)
    assert job.with_suffix(".csv").read_text().startswith("travel_mm,mass_mg\n")
    assert made.lines > 24


def test_a_test_that_preflight_refuses_is_not_written(idle: PrinterService) -> None:
    outside = CalibrationRequest(printer="generic_marlin", at_mm=(199.0, 100.0, 50.0), axis="x")
    with pytest.raises(Exception, match=r"(?i)outside|exceed|x_mm"):
        idle.calibrating.make(ME, "backlash", outside)
    assert idle.core.workspace.jobs() == []


def test_weighing_finds_the_steps_and_writes_a_copy_that_can_be_connected(
    idle: PrinterService,
) -> None:
    read = weighed(0.9)
    found = idle.calibrating.fit("weigh", read).lines["steps per travel, if the bore is right"]
    steps = load(Printer, "generic_marlin").steps_per_mm.e
    assert found.holds(steps / 0.9)
    idle.calibrating.save(ME, read, "printer", "bench_1")
    assert "bench_1" in idle.store.printers()
    copy = idle.store.load(Printer, "bench_1")
    assert copy.steps_per_mm.e == pytest.approx(steps / 0.9, rel=0.01)
    assert "measured by printctl calibrate" in copy.source
    idle.calibrating.save(ME, read, "syringe", "syringe_1")
    bore = idle.store.load(Syringe, "syringe_1").inner_mm
    assert bore == pytest.approx(load(Syringe, "hamilton_1ml").inner_mm * math.sqrt(0.9), rel=0.01)


def test_a_copy_does_not_take_a_shipped_name_or_leave_its_folder(
    idle: PrinterService, tmp_path: Path
) -> None:
    before = sorted(tmp_path.rglob("*.yaml"))
    with pytest.raises(ConflictError, match="another"):
        idle.calibrating.save(ME, weighed(0.9), "printer", "generic_marlin")
    with pytest.raises(BadRequestError):
        idle.calibrating.save(ME, weighed(0.9), "printer", "../evil")
    assert sorted(tmp_path.rglob("*.yaml")) == before
