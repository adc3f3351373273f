"""`printctl dye --predict`, from the command line."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from printctl.analysis.dye import VesselPlace, volume_share
from tests.design.hemodynamics.networks import network_of
from tests.system.cli import called as printctl

FORK = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,0,0,0,10,0,0,0.3,0.3,artery,0\n"
    "1,1,2,10,0,0,20,5,0,0.2,0.2,artery,0\n"
    "2,1,3,10,0,0,20,-5,0,0.2,0.2,artery,0\n"
)
PREDICT = ("dye", "--predict", "--model", "fork.csv", "--unit", "mm", "--out", "dye")


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(FORK)
    return tmp_path


def test_a_front_is_foreseen_without_a_film(fork: Path) -> None:
    done = printctl(
        *PREDICT, "--flow-ml-min", "0.25", "--frames-per-s", "5", "--at", "1:0.5", "--json",
        cwd=fork,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    trunk = np.pi * 0.3**2 * 10 / (0.25 / 0.06)
    branch = np.pi * 0.2**2 * np.hypot(10, 5) / (0.125 / 0.06)
    assert found["tip_leaves_last_s"] == pytest.approx((trunk + branch) / 2, rel=1e-6)
    assert found["mean_leaves_last_s"] == pytest.approx(trunk + branch, rel=1e-6)
    assert "too far apart" in done.stderr
    with (fork / "dye" / "dye_front.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert float(rows[2]["tip_enters_s"]) == pytest.approx(trunk / 2)
    with (fork / "dye" / "dye_curves.csv").open() as handle:
        curves = list(csv.DictReader(handle))
    seen = np.array([float(row["vessel_1_at_0.5"]) for row in curves])
    time = np.array([float(row["time_s"]) for row in curves])
    # Nothing before the tip, and dye soon after.
    tip = trunk / 2 + branch / 4
    assert seen[time < 0.97 * tip].max() < 0.01
    assert seen[time > 1.1 * tip].min() > 0.02
    assert (fork / "dye" / "dye_front.svg").read_bytes().lstrip().startswith(b"<?xml")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--at", "9:0.5"), "--at 9:0.5 isn't a place"),
        (("--as-printed",), "register a scan first"),
        (("--marks", "marks.yaml"), "--predict takes no film"),
    ],
)
def test_what_makes_no_sense_is_refused(fork: Path, options: tuple[str, ...], words: str) -> None:
    done = printctl(*PREDICT, *options, cwd=fork)
    assert done.returncode != 0
    assert words in " ".join(done.stderr.split())


def test_without_a_film_and_predict_the_way_out_is_named(fork: Path) -> None:
    done = printctl("dye", "--model", "fork.csv", "--out", "dye", cwd=fork)
    assert done.returncode != 0
    assert "--predict to foresee" in " ".join(done.stderr.split())


def test_half_of_a_cone_s_length_isn_t_half_of_its_volume() -> None:
    network = network_of([[0, 0, 0], [4, 0, 0]], [(0, 1)], 1.0)
    network.radius[1] = 2.0
    expected = (1 + 1.5 + 2.25) / (1 + 2 + 4) / 2
    assert volume_share(network, [VesselPlace(0, 0.5)])[0] == pytest.approx(expected, rel=1e-4)
