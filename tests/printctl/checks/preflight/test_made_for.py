"""Another syringe than the one a run's G-code was made for."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_profiles import Printer, Syringe, load
from printctl.checks.preflight.mounted import made_for_checks
from printctl.run_folder.manifest import Manifest


@pytest.mark.parametrize(
    ("mounted", "ratio", "passed"),
    [("hamilton_1ml", 1.0, True), ("bd_3ml", 3.47, False), ("hamilton_2_5ml", 2.5, False)],
)
def test_plunger_moves_for_another_syringe_are_refused(
    tmp_path: Path, mounted: str, ratio: float, passed: bool
) -> None:
    Manifest(tmp_path, {"recipe": {"printer": {"syringe": "hamilton_1ml"}}}, {}).save()
    [check] = made_for_checks(tmp_path, load(Printer, "generic_marlin"), [load(Syringe, mounted)])
    assert check.passed is passed
    assert check.refuses is not passed
    assert check.value == pytest.approx(ratio, rel=0.02)


def test_a_folder_that_is_no_run_asks_nothing(tmp_path: Path) -> None:
    syringes = [load(Syringe, "bd_3ml")]
    assert made_for_checks(tmp_path, load(Printer, "generic_marlin"), syringes) == []
