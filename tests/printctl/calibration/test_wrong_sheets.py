"""Sheets of calibrations that were filled in wrongly: no wrong constant is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from firmware_profiles import Ink, Printer, load
from printctl.errors import PrintctlError
from tests.printctl.calibration.test_commands import called, filled
from tests.printctl.calibration.test_safe import own_printer, weighed

Rows = list[list[str]]
Mistake = Callable[[Rows], Rows]
"""Header and rows of a sheet, and what a person makes of them."""


def last(change: Callable[[int, str], str]) -> Mistake:
    """Something else is typed into the last column."""
    return lambda rows: [
        rows[0],
        *([*row[:-1], change(k, row[-1])] for k, row in enumerate(rows[1:])),
    ]


def scaled(factor: float) -> Mistake:
    """The readings are in another unit."""
    return last(lambda _, text: f"{float(text) * factor:.6g}")


def at_row(number: int, change: Callable[[str], str]) -> Mistake:
    """One reading is wrong."""
    return last(lambda k, text: change(text) if k == number else text)


def reordered(order: Callable[[int, int], int]) -> Mistake:
    """Readings are in other rows: that of row ``order(k, count)`` in row k."""

    def work(rows: Rows) -> Rows:
        typed = [row[-1] for row in rows[1:]]
        moved = [typed[order(k, len(typed))] for k in range(len(typed))]
        return [rows[0], *([*row[:-1], one] for row, one in zip(rows[1:], moved, strict=True))]

    return work


def columns_swapped(rows: Rows) -> Rows:
    return [rows[0], *([*row[:-2], row[-1], row[-2]] for row in rows[1:])]


def header_swapped(rows: Rows) -> Rows:
    return [[*rows[0][:-2], rows[0][-1], rows[0][-2]], *rows[1:]]


def not_tared(rows: Rows) -> Rows:
    total = np.cumsum([float(row[-1]) for row in rows[1:]])
    return [rows[0], *([*row[:-1], f"{one:.3f}"] for row, one in zip(rows[1:], total, strict=True))]


def doubled_travel(rows: Rows) -> Rows:
    return [rows[0], *([f"{2 * float(row[0]):g}", *row[1:]] for row in rows[1:])]


READINGS: Final[dict[str, Mistake]] = {
    "negative": last(lambda _, text: f"-{text}"),
    "zero": last(lambda _, text: "0"),
    "one negative": at_row(3, lambda text: f"-{text}"),
    "nan": at_row(2, lambda text: "nan"),
    "infinite": at_row(2, lambda text: "inf"),
    "with its unit": last(lambda _, text: f"{text} mg"),
    "decimal comma": last(lambda _, text: text.replace(".", ",")),
    "empty": last(lambda _, text: ""),
    "thousand times too small": scaled(1e-3),
    "thousand times too large": scaled(1e3),
    "columns swapped": columns_swapped,
    "header swapped": header_swapped,
    "order reversed": reordered(lambda k, count: count - 1 - k),
    "one reading for all": reordered(lambda k, count: 0),
    "only one row": lambda rows: rows[:2],
    "out of thin air": last(lambda k, text: f"{float(text) * (0.3 + k * 37 % 11 / 4):.4g}"),
}
OF_WEIGHTS: Final[dict[str, Mistake]] = {
    **READINGS,
    "shifted by a row": reordered(lambda k, count: (k + 1) % count),
    "two rows swapped": reordered(lambda k, count: {0: 2, 2: 0}.get(k, k)),
    "one ten times too large": at_row(5, lambda text: f"{10 * float(text):g}"),
    "not tared": not_tared,
    "another travel": doubled_travel,
}
OF_WIDTHS: Final[dict[str, Mistake]] = {
    **READINGS,
    "radius for width": scaled(0.5),
    "cm": scaled(0.1),
    "pixels": scaled(100),
}


def make(sheet: Path, mistake: Mistake) -> None:
    """Make a mistake in a sheet."""
    lines = sheet.read_text().splitlines()
    notes = [line for line in lines if line[0] == "#"]
    rows = mistake([line.split(",") for line in lines[len(notes) :]])
    sheet.write_text("\n".join([*notes, *map(",".join, rows)]) + "\n")


def refused(*words: str | Path) -> None:
    """Assert that a calibration ends with a message."""
    with pytest.raises(PrintctlError):
        called(*words)


@pytest.mark.parametrize("mistake", OF_WEIGHTS)
def test_wrong_weights_write_no_steps(mistake: str, tmp_path: Path) -> None:
    ours = own_printer(tmp_path)
    sheet, before = weighed(tmp_path, ours), ours.read_bytes()
    make(sheet, OF_WEIGHTS[mistake])
    refused("weigh", sheet, "--printer", ours, "--syringe", "hamilton_5ml", "--write", ours)
    assert ours.read_bytes() == before


def lines_sheet(folder: Path, needle: str = "25g") -> Path:
    """A filled sheet of printed lines, 1 % wider than commanded."""
    folder.mkdir(exist_ok=True)
    job = folder / "p.gcode"
    words = ("--printer", own_printer(folder), "--syringe", "hamilton_1ml")
    ink = ("--ink", "collagen_fresh", "--needle", needle, "--round", "-o", job)
    assert called("pattern", "lines", *words, *ink).exit_code == 0
    rows = [s for s in job.with_suffix(".csv").read_text().splitlines() if s[0] != "#"][1:]
    widths = 1.01 * np.array([float(row.split(",")[-2]) for row in rows])
    noise = np.random.default_rng(1).normal(0, 0.003, len(widths))
    return filled(job.with_suffix(".csv"), widths + noise)


def test_the_sound_sheets_write_what_was_measured(tmp_path: Path) -> None:
    assert called("widths", lines_sheet(tmp_path), "--write", tmp_path / "i.yaml").exit_code == 0
    factor = load(Ink, str(tmp_path / "i.yaml")).flow_factor
    assert factor == pytest.approx(1.01**2, rel=0.01)
    ours = own_printer(tmp_path)
    words = ("--printer", ours, "--syringe", "hamilton_5ml", "--write", ours)
    assert called("weigh", weighed(tmp_path, ours), *words).exit_code == 0
    assert load(Printer, str(ours)).steps_per_mm.e == pytest.approx(1280, rel=2e-3)


@pytest.mark.parametrize("mistake", OF_WIDTHS)
def test_wrong_widths_write_no_ink(mistake: str, tmp_path: Path) -> None:
    sheet = lines_sheet(tmp_path)
    make(sheet, OF_WIDTHS[mistake])
    refused("widths", sheet, "--write", tmp_path / "i.yaml")
    assert not (tmp_path / "i.yaml").exists()


def test_the_sheet_of_another_needle_writes_no_ink(tmp_path: Path) -> None:
    sheet, other = lines_sheet(tmp_path), lines_sheet(tmp_path / "other", "22g")
    sheet.write_text(other.read_text())
    refused("widths", sheet, "--write", tmp_path / "i.yaml")
    assert not (tmp_path / "i.yaml").exists()


@pytest.mark.parametrize(
    "other",
    [
        ("--needle", "22g"),
        ("--ink", "gelatin_sacrificial"),
        ("--syringe", "hamilton_5ml"),
        ("--printer", "generic_marlin"),
    ],
    ids=lambda words: words[0],
)
def test_a_lag_measured_with_other_parts_is_not_written(
    other: tuple[str, str], tmp_path: Path
) -> None:
    parts = {"--printer": str(own_printer(tmp_path)), "--syringe": "hamilton_1ml"}
    parts |= {"--ink": "collagen_fresh", "--needle": "25g"}
    words = [word for pair in parts.items() for word in pair]
    job = tmp_path / "lag.gcode"
    assert called("lag", "--gcode", job, *words).exit_code == 0
    sheet = job.with_suffix(".csv")
    count = sum(line[0] != "#" for line in sheet.read_text().splitlines()) - 1
    filled(sheet, np.full(count, 0.4))
    wrong = [word for pair in (parts | dict([other])).items() for word in pair]
    refused("lag", sheet, *wrong, "--write", tmp_path / "i.yaml")
    assert not (tmp_path / "i.yaml").exists()
