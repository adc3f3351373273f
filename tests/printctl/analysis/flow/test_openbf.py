"""`printctl flow case.yaml`: openBF's networks as waves."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.system.cli import called as printctl

CASE = """\
project_name: tube
blood: {rho: 1060.0, mu: 4.0e-3}
solver: {Ccfl: 0.9, cycles: 10, jump: 20, convergence_tolerance: 1.0}
write_results: [P, Q]
output_directory: results
network:
  - {label: tube, sn: 1, tn: 2, L: 0.1, E: 4.0e+5, R0: 3.0e-3, R1: 2.0e+8, R2: 2.0e+9, Cc: 1.5e-10}
"""


@pytest.fixture
def case(tmp_path: Path) -> Path:
    (tmp_path / "tube.yaml").write_text(CASE)
    (tmp_path / "tube_inlet.dat").write_text("0 5e-6\n0.4 9e-6\n1 5e-6\n")
    return tmp_path


def test_waves_are_written_as_the_file_asks(case: Path) -> None:
    done = printctl("flow", "tube.yaml", "--cell-mm", "20", "--json", cwd=case)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["project"], found["vessels"], found["cells"]) == ("tube", 1, 5)
    with (case / "results" / "openbf.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == 20
    flow = np.array([float(line["Q_1"]) for line in rows])
    assert flow.mean() == pytest.approx(7e-6, rel=1e-3)
    pressure = np.array([float(line["P_5"]) for line in rows])
    assert pressure.mean() == pytest.approx(2.2e9 * 7e-6, rel=5e-3)
    printctl("flow", "tube.yaml", "--cell-mm", "20", "--results", "npz", "--out", "o", cwd=case)
    with np.load(case / "o" / "openbf.npz") as arrays:
        assert sorted(arrays.files) == ["P", "Q", "label", "time_s"]
        assert arrays["Q"].shape == (1, 5, 20)
        assert arrays["Q"][0, 0] == pytest.approx(flow, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (CASE.replace("Cc", "beta profile"), (), "beta profile"),
        (CASE, ("--one-d",), "a case of openBF says all"),
        (CASE + "inlet_file: other.dat\n", (), "other.dat isn't beside it"),
        ("flow: {}\n", (), "no network, blood and solver"),
        (CASE + "blood: {}\n", (), "stands twice"),
        pytest.param(
            CASE.replace("R1: 2.0e+8, R2: 2.0e+9, Cc: 1.5e-10", "Rt: 1.0"),
            ("--cell-mm", "20"),
            "no periodic state",
            marks=pytest.mark.slow,  # what flows in stays: the tube stiffens, steps get short
        ),
    ],
)
def test_mistakes_end_in_one_message(
    case: Path, text: str, options: tuple[str, ...], words: str
) -> None:
    (case / "tube.yaml").write_text(text)
    done = printctl("flow", "tube.yaml", *options, cwd=case)
    assert done.returncode in (1, 2)
    assert words in done.stderr.replace("\n", " ")
    assert "Traceback" not in done.stderr
