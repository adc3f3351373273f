"""Calibrations on the page: same results as the command line."""

import math
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, Syringe, load
from printctl.errors import UsageError
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
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


def test_level_and_offset_and_backlash_tell_what_was_put_in(idle: PrinterService) -> None:
    places = [(0.0, 0.0), (20.0, 0.0), (0.0, 20.0), (20.0, 20.0), (10.0, 10.0)]
    rows = [
        (surface, f"{x}", f"{y}", f"{z + 0.002 * x:.3f}")
        for surface, z in (("bed", 1.0), ("bath", 9.0))
        for x, y in places
    ]
    level = idle.calibrating.fit("level", Read(rows=tuple(rows))).lines
    assert level["bed, rise along x"].value == pytest.approx(0.2, abs=1e-6)
    assert level["depth of the bath (bath_depth_mm)"].value == pytest.approx(8.0, abs=1e-6)

    touched = [
        (needle, f"{100 + dx}", "100.00", f"{5 + dz:.2f}")
        for needle, dx, dz in (("A", 0.0, 0.0), ("B", 0.3, -0.2))
        for _ in range(3)
    ]
    offset = idle.calibrating.fit("offset", Read(rows=tuple(touched))).lines
    assert offset["B less A, x"].value == pytest.approx(0.3)
    assert offset["B less A, z"].value == pytest.approx(-0.2)

    dial = [
        (f"{target}", f"{side}", f"{target - side * 0.03 + 0.001 * (i % 2):.3f}")
        for i, (target, side) in enumerate((t, s) for t in (2, 4, 6, 8) for s in (1, -1))
    ]
    lost = idle.calibrating.fit("backlash", Read(rows=tuple(dial))).lines["lost motion"]
    assert lost.value == pytest.approx(0.06, abs=0.005)


def test_readings_that_say_nothing_are_refused(idle: PrinterService) -> None:
    with pytest.raises(BadRequestError, match="not a number"):
        idle.calibrating.fit("weigh", Read(rows=(("1.0", "abc"),)))
    with pytest.raises(BadRequestError, match="2 columns"):
        idle.calibrating.fit("weigh", Read(rows=(("1.0", "2.0", "3.0"),)))
    with pytest.raises(BadRequestError, match="at most"):
        idle.calibrating.fit("weigh", Read(rows=(("1e30", "1e30"),) * 4))
    with pytest.raises(UsageError):
        idle.calibrating.fit("weigh", Read(rows=(("1.0", "2.0"),)))
    with pytest.raises(NotFoundError):
        idle.calibrating.fit("nothing", weighed(1.0))
    with pytest.raises(ConflictError, match="printctl calibrate lag"):
        idle.calibrating.fit("lag", weighed(1.0))
