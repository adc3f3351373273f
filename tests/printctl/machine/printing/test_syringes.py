"""Job needing several syringes: refused with an offer, or planned with changes."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, Syringe, load
from printctl.checks.preflight import Check, gcode_checks, refuse_failed, syringe_checks
from printctl.errors import SafetyError
from printctl.machine.link.job import Job
from printctl.machine.printing import capacity_mm, usable_mm, with_reloads
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import START, layered

PRINTER = load(Printer, "generic_marlin").model_copy(update={"plunger_travel_mm": 0.5})
SYRINGE = load(Syringe, "hamilton_1ml")
DATA = layered(6, 60)


def checks() -> list[Check]:
    run = dry_run(DATA, PRINTER, START)
    return [*gcode_checks(run, PRINTER), *syringe_checks(run, PRINTER, SYRINGE)]


def job() -> Job:
    return parse_job(DATA, "test.gcode")


def test_drive_or_syringe_limits_whichever_is_shorter():
    assert capacity_mm(SYRINGE) == pytest.approx(58.71, abs=0.01)
    assert usable_mm(SYRINGE, PRINTER) == 0.5
    assert usable_mm(SYRINGE, load(Printer, "generic_marlin")) == capacity_mm(SYRINGE)


def test_job_that_needs_more_is_refused_with_the_lines_of_a_change():
    told, reload_at = with_reloads(checks(), job(), 0.5, wanted=False)
    assert reload_at == ()
    with pytest.raises(SafetyError, match=r"give --reload: the syringe is then changed before l"):
        refuse_failed(told)


def test_change_that_is_agreed_to_satisfies_the_checks_it_concerns_and_no_other():
    told, reload_at = with_reloads(checks(), job(), 0.5, wanted=True)
    refuse_failed(told)
    points = [mark.index for mark in job().marks.all]
    assert len(reload_at) >= 2
    assert set(reload_at) <= set(points)
    wrong = Check("x, highest", 300.0, 200.0, "mm", False)
    with pytest.raises(SafetyError, match="x, highest"):
        refuse_failed(with_reloads([wrong, *checks()], job(), 0.5, wanted=True)[0])
