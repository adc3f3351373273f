"""1D flow: recipe section `flow.one_d` and `printctl flow --one-d`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.printctl.analysis.flow.test_flow import FORK, SINE
from tests.system.cli import called as printctl

GEL = ("--wall-young-kpa", "10")


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(FORK)
    return tmp_path


def test_waves_leave_tables_and_the_case_for_another_solver(fork: Path) -> None:
    done = printctl(
        "flow", "fork.csv", "--unit", "mm", *SINE, *GEL, "--one-d", "--svoned", "case.in",
        "--wall-viscosity-pa-s", "0", "--json", cwd=fork,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    waves, lumped = found["one_d"], found["pulsatile"]
    assert waves["inlet_flow_amplitude_ml_min"] == pytest.approx(0.1, rel=1e-3)
    # Short channels under slow pulses: the lumped model is right, but for what inertia weighs.
    assert waves["inlet_pulse_mmhg"] == pytest.approx(lumped["inlet_pulse_mmhg"], rel=0.03)
    assert waves["mass_imbalance"] < 1e-9
    with (fork / "flow" / "flow_1d.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert float(rows[1]["flow_mean_ml_min"]) == pytest.approx(0.125, rel=1e-4)
    # √(E/(2 ϱ (1 + ν))), whatever the radius.
    assert float(rows[2]["wave_speed_mm_s"]) == pytest.approx(1773, rel=1e-3)
    assert len((fork / "flow" / "flow_1d_waves.csv").read_text().splitlines()) == 101
    assert (fork / "case.in").read_text().startswith("MODEL case_\n")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--one-d",), "--one-d follows a pulse"),
        ((*SINE, "--one-d"), "--wall-young-kpa"),
        ((*SINE, *GEL, "--cell-mm", "1"), "--cell-mm is for --one-d"),
        ((*SINE, *GEL, "--one-d", "--cell-mm", "-1"), "--cell-mm: must be above"),
        (("--svoned", "x.in"), "--svoned writes a pulsatile problem"),
        ((*SINE, *GEL, "--svoned", "x.in", "--one-d", "--wall-viscosity-pa-s", "5"), "no viscous"),
    ],
)
def test_mistakes_end_in_one_message(fork: Path, options: tuple[str, ...], words: str) -> None:
    done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=fork)
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stdout == ""
