"""Idle needles against bath, ink and wall; timely raising and lowering of heads."""

from __future__ import annotations

from dataclasses import replace

import pytest

from firmware_profiles import Bath, Dish, Ink, Needle, load
from printctl.checks.preflight import (
    HeadLoading,
    PlacedDish,
    SetUp,
    check_each_head,
    file_checks,
    gcode_checks,
    head_checks,
    syringe_checks,
)
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.two_heads import DATA, QUICK, START, SYRINGES

NEEDLE = load(Needle, "30g")
PETRI = load(Dish, "petri_60mm")
STANDING = PlacedDish(PETRI, (62.0, 72.0), 0.0, 10.0)


def found(data=DATA, printer=QUICK, standing=STANDING):
    run = dry_run(data, printer, START)
    checks = head_checks(run, printer, standing, (NEEDLE, NEEDLE))
    return {check.check: check for check in checks}


def refused(**given):
    return sorted(name for name, check in found(**given).items() if check.refuses)


def head_with(number, **changes):
    heads = list(QUICK.heads)
    heads[number] = heads[number].model_copy(update=changes)
    return QUICK.model_copy(update={"heads": tuple(heads)})


def test_a_job_of_the_writer_passes():
    assert refused() == []
    run = dry_run(DATA, QUICK, START)
    assert not [check.check for check in gcode_checks(run, QUICK) if check.refuses]


def test_a_needle_that_is_raised_too_little_drags_through_gel():
    checks = found(printer=head_with(0, raised_mm=3.0))
    drags = checks["lowest tip that doesn't write, above the bath's surface"]
    assert drags.refuses
    assert drags.value == pytest.approx(6.0 + 3.0)
    assert drags.limit == 10.0
    assert "left" in drags.remedy


def test_without_a_known_bath_what_is_written_is_the_limit():
    fixed = head_with(1, raised_mm=0.0, raises=None, lowers=None)
    checks = found(printer=fixed, standing=None)
    assert checks["lowest tip that doesn't write, above all that is written"].refuses is False
    deeper = fixed.heads[1].offset_mm.model_copy(update={"z": -1.0})
    lower = QUICK.model_copy(
        update={"heads": (fixed.heads[0], fixed.heads[1].model_copy(update={"offset_mm": deeper}))}
    )
    checks = found(printer=lower, standing=None)
    assert checks["lowest tip that doesn't write, above all that is written"].refuses


def test_a_needle_that_swings_over_the_wall_below_its_top_is_found():
    wall = "needle that doesn't write, to the dish's wall"
    shallow = replace(STANDING, bath_mm=9.0)
    assert refused(printer=head_with(0, raised_mm=5.5), standing=shallow) == [wall]
    assert refused(printer=head_with(0, raised_mm=6.5), standing=shallow) == []


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        (b"M280 P1 S90\n", b"M105\n", "moves before every head is said to be raised or lowered"),
        (b"M280 P1 S10\n", b"M105\n", "plunger moves of a raised head"),
        (
            b"M400\nM280 P0 S90\nG4 P50\n",
            b"M280 P0 S90\nM105\n",
            "heads raised or lowered while the carriage may still move",
        ),
    ],
)
def test_what_is_left_out_is_found(old, new, name):
    assert old in DATA
    assert name in refused(data=DATA.replace(old, new, 1))


def test_a_head_lowered_into_the_print_is_found():
    low = DATA.replace(b"G0 Z20", b"G0 Z5.5")
    assert low != DATA
    assert "lowest tip where a head is lowered, above all that is written" in refused(data=low)


def test_a_swing_that_isn_t_waited_for_is_told():
    hasty = found(data=DATA.replace(b"G4 P50\n", b""))
    check = hasty["heads raised or lowered without their time waited for"]
    assert not check.passed
    assert check.weight == "warns"


def test_each_head_is_held_against_its_own_syringe():
    run = dry_run(DATA, QUICK, START)
    tiny = SYRINGES[1].model_copy(update={"volume_ul": 2.0, "dead_volume_ul": 0.0})
    loads = (SYRINGES[0], tiny)
    checks = check_each_head(run, QUICK, lambda k, view, one: syringe_checks(view, one, loads[k]))
    failed = [check.check for check in checks if check.refuses and "profile" not in check.check]
    assert failed == ["head 1 (right): ink, with 0 µL dead volume"]


def test_all_checks_of_a_file_know_what_each_head_holds():
    ink = load(Ink, "gelatin_sacrificial")
    loads = tuple(HeadLoading(syringe, ink, NEEDLE) for syringe in SYRINGES)
    setup = SetUp(QUICK, SYRINGES[0], ink, NEEDLE, load(Bath, "cell_matrix"), STANDING, heads=loads)
    checks = file_checks(dry_run(DATA, QUICK, START), setup)
    assert not [check.check for check in checks if check.refuses]
    names = [check.check for check in checks]
    for head in ("head 0 (left): ", "head 1 (right): "):
        assert f"{head}needle to the dish's wall" in names
        assert f"{head}plunger travel" in names


def test_findings_of_heads_refuse_by_their_names():
    data = DATA.replace(b"M218 T1 X0 Y0 Z0", b"M218 T1 X40 Y0 Z0")
    run = dry_run(data, QUICK, START)
    failed = [check for check in gcode_checks(run, QUICK) if check.refuses]
    assert "offsets of a head that would count twice" in [check.check for check in failed]
