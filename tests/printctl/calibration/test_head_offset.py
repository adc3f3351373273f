"""`printctl calibrate offset --printer`: offset of a second head, with its sign."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from firmware_profiles import Printer, load
from printctl.cli.main import app
from printctl.errors import UsageError

SHEET = """needle,x_mm,y_mm,z_mm
left,100.00,80.00,12.00
left,100.02,80.01,12.01
left,99.98,79.99,11.99
right,60.10,80.50,12.30
right,60.12,80.51,12.31
right,60.08,80.49,12.29
"""
"""Where the carriage stands with each tip on one mark: the right tip stands out by +39.9 in x."""


def offset(folder: Path, *words: str) -> str:
    sheet = folder / "offset.csv"
    sheet.write_text(SHEET)
    command = ["calibrate", "offset", str(sheet), *words]
    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return str(done.output)


def test_the_tip_stands_as_much_farther_as_the_carriage_less_far(tmp_path: Path) -> None:
    mended = tmp_path / "mine.yaml"
    offset(tmp_path, "--printer", "two_syringe_marlin", "--write", str(mended))
    printer = load(Printer, str(mended))
    assert printer.heads[1].offset_mm.mm == pytest.approx((39.9, -0.5, -0.3), abs=1e-3)
    assert printer.heads[0].offset_mm.mm == (0, 0, 0)
    assert printer.heads[1].raises == "M280 P1 S90"
    assert "heads.1.offset_mm measured by printctl calibrate" in printer.source
    assert all(f"{axis} {value}" in printer.source for axis, value in (("x", 39.9), ("z", -0.3)))


def test_a_head_that_isn_t_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="has no head 2"):
        offset(tmp_path, "--printer", "two_syringe_marlin", "--head", "2")
    with pytest.raises(UsageError, match="has no head 1"):
        offset(tmp_path, "--printer", "generic_marlin")
    with pytest.raises(UsageError, match="give --printer"):
        offset(tmp_path, "--write", "x.yaml")
