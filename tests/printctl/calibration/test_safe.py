"""`printctl calibrate` writes no constant of another machine, syringe or unit unasked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from firmware_profiles import Printer, Syringe, load
from firmware_profiles.load import shipped_text
from printctl.errors import SafetyError, UsageError
from tests.printctl.calibration.test_commands import called, filled, read_readings_of

FIVE = load(Syringe, "hamilton_5ml")


def own_printer(folder: Path, name: str = "Ours", steps: float = 1280.0) -> Path:
    data = yaml.safe_load(shipped_text(Printer, "generic_marlin"))
    data["name"], data["steps_per_mm"]["e"] = name, steps
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def weighed(folder: Path, printer: Path, scale: float = 1.0) -> Path:
    """A filled sheet of the test, printed with the 5 mL syringe."""
    job = folder / "weigh.gcode"
    words = (
        "--printer",
        printer,
        "--syringe",
        "hamilton_5ml",
        "--doses",
        "100,200,400",
        "--flow",
        "10",
    )
    assert called("weigh", "--gcode", job, *words).exit_code == 0
    travel = read_readings_of(folder / "weigh.csv", "travel_mm")
    noise = np.random.default_rng(3).normal(0, 0.05, len(travel))
    return filled(folder / "weigh.csv", scale * FIVE.area_mm2 * travel * 0.998 + noise)


def test_only_the_machine_that_was_measured_is_written(tmp_path: Path) -> None:
    ours = own_printer(tmp_path)
    sheet, before = weighed(tmp_path, ours), ours.read_bytes()
    with pytest.raises(UsageError, match="--printer is missing"):
        called("weigh", sheet, "--write", ours)
    with pytest.raises(UsageError, match=r"syringe unknown: neither named nor.*printctl mount"):
        called("weigh", sheet, "--printer", ours, "--write", ours)
    with pytest.raises(SafetyError, match=r"syringe that the job was made for.*Hamilton 5 mL"):
        called("weigh", sheet, "--printer", ours, "--syringe", "hamilton_1ml", "--write", ours)
    other = ("--printer", "generic_marlin", "--syringe", "hamilton_5ml", "--write", ours)
    with pytest.raises(SafetyError, match=r"printer that the job was made for.*Generic Marlin"):
        called("weigh", sheet, *other)
    sheet.write_text("\n".join(s for s in sheet.read_text().splitlines() if s[0] != "#"))
    with pytest.raises(SafetyError, match=r"is 'Ours' with other values than the printer"):
        called("weigh", sheet, *other, "--accept-change", "--for-mounted")
    mine = ("--printer", ours, "--syringe", "hamilton_5ml", "--write", ours)
    with pytest.raises(SafetyError, match=r"weigh\.csv doesn't record.*Hamilton 5 mL.*--for-moun"):
        called("weigh", sheet, *mine)
    assert ours.read_bytes() == before
    called("weigh", sheet, *mine, "--for-mounted")
    assert load(Printer, str(ours)).name == "Ours"
    assert load(Printer, str(ours)).steps_per_mm.e == pytest.approx(1280.0, rel=2e-3)


def test_a_change_above_a_fifth_is_accepted_by_name(tmp_path: Path) -> None:
    ours = own_printer(tmp_path)
    sheet = weighed(tmp_path, ours, 0.5)
    words = ("weigh", sheet, "--printer", ours, "--syringe", "hamilton_5ml", "--write", ours)
    with pytest.raises(
        SafetyError, match=r"steps_per_mm\.e would change from 1280 to 2\d+.* \(\+100%\), limit 20%"
    ):
        called(*words)
    assert load(Printer, str(ours)).steps_per_mm.e == 1280.0
    assert called(*words, "--accept-change").exit_code == 0
    assert load(Printer, str(ours)).steps_per_mm.e == pytest.approx(2560.0, rel=2e-3)


def test_what_is_mounted_is_what_is_measured(tmp_path: Path) -> None:
    ours = own_printer(tmp_path)
    mounted = ("--printer", ours, "--syringe", "hamilton_5ml")
    assert called(*mounted, command="mount").exit_code == 0
    sheet = weighed(tmp_path, ours)
    copy = tmp_path / "copy.yaml"
    assert called("weigh", sheet, "--printer", ours, "--write", copy).exit_code == 0
    assert load(Printer, str(copy)).steps_per_mm.e == pytest.approx(1280.0, rel=2e-3)


def test_a_pattern_read_after_its_profile_was_changed_writes_nothing(tmp_path: Path) -> None:
    ours, job = own_printer(tmp_path), tmp_path / "p.gcode"
    words = ("--printer", ours, "--syringe", "hamilton_1ml", "--ink", "collagen_fresh")
    done = called("pattern", "lines", *words, "--needle", "25g", "--round", "-o", job)
    assert done.exit_code == 0, done.output
    rows = [s for s in job.with_suffix(".csv").read_text().splitlines() if s[0] != "#"][1:]
    widths = np.array([float(row.split(",")[-2]) for row in rows])
    sheet = filled(job.with_suffix(".csv"), 1.01 * widths)
    with pytest.raises(SafetyError, match=r"ink that the job was made for.*gelatin"):
        called("widths", sheet, "--ink", "gelatin_sacrificial", "--write", tmp_path / "i.yaml")
    assert called("widths", sheet, "--write", tmp_path / "i.yaml").exit_code == 0
    own_printer(tmp_path, steps=1400.0)
    with pytest.raises(SafetyError, match="'Ours' was changed after the job was made"):
        called("widths", sheet, "--write", tmp_path / "j.yaml")
    assert not (tmp_path / "j.yaml").exists()
