"""Oxygen: recipe section `oxygen` and `printctl oxygen`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from design.solids import Solid, write_stl
from design.tissue import block
from report.pages.registration import report_html
from tests.system.cli import called as printctl

FORK = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,3,3,0,3,3,2,0.4,0.4,artery,0\n"
    "1,1,2,3,3,2,4,5,5,0.2,0.2,artery,0\n"
    "2,1,3,3,3,2,2,1,5,0.2,0.2,artery,0\n"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Solved once, and looked at from several sides."""
    found = tmp_path_factory.mktemp("fork")
    (found / "fork.csv").write_text(FORK)
    surface = block((6.0, 6.0, 6.0))
    write_stl(found / "cube.stl", Solid(surface.vertices, surface.faces))
    done = printctl(
        "oxygen", "fork.csv", "--unit", "mm", "--tissue", "cube.stl", "--tissue-unit", "mm",
        "--cells-per-ml", "3e6", "--grid-cells", "8000", "--inlet-flow-ml-min", "0.01", "--json",
        cwd=found,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (found / "said.json").write_text(done.stdout)
    return found


def test_the_command_leaves_numbers_table_field_and_picture(folder: Path) -> None:
    found = json.loads((folder / "said.json").read_text())
    assert found == json.loads((folder / "oxygen" / "oxygen.json").read_text())
    assert found["imbalance"] < 1e-6
    assert 0.0 < found["hypoxic_percent"] < 100.0
    assert found["cells_fed_at_most"] == pytest.approx(0.01 / 0.06 * 0.2 / 5e-8, rel=1e-6)
    with (folder / "oxygen" / "oxygen.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert float(rows[0]["oxygen_in_millimolar"]) == pytest.approx(0.2)
    # Equal branches in a symmetric cube, and mixed alike.
    assert rows[1]["oxygen_in_millimolar"] == rows[2]["oxygen_in_millimolar"]
    assert float(rows[1]["oxygen_out_millimolar"]) < float(rows[0]["oxygen_out_millimolar"])
    for name in ("oxygen.vti", "oxygen.svg"):
        assert (folder / "oxygen" / name).stat().st_size > 1000


def test_the_report_says_what_it_rests_on(folder: Path) -> None:
    found = json.loads((folder / "said.json").read_text())
    picture = (folder / "oxygen" / "oxygen.svg").read_bytes()
    page = report_html({"oxygen": found}, [], None, {"oxygen/Slice": picture})
    assert 'id="oxygen"' in page
    assert "given by the user" in page
    assert "Buchwald 2009" in page
    assert "Share of the tissue by its oxygen" in page
    assert "oxygen" not in report_html({"flow": {"inflow_ml_min": 1.0}}, [], None, {}).lower()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cells-per-ml", "-1"), "--cells-per-ml"),
        (("--spacing-um", "1"), "raise the spacing"),
        (("--tissue", "none.stl"), "none.stl"),
        (("--spacing-um", "200", "--grid-cells", "2000"), "--spacing-um or --grid-cells"),
    ],
)
def test_what_makes_no_sense_is_refused(folder: Path, options: tuple[str, ...], words: str) -> None:
    given = {"--tissue": "cube.stl", "--tissue-unit": "mm"}
    given |= dict(zip(options[::2], options[1::2], strict=True))
    flat = [word for pair in given.items() for word in pair]
    done = printctl("oxygen", "fork.csv", "--unit", "mm", *flat, cwd=folder)
    assert done.returncode != 0
    assert words in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


# --- `printctl dye --predict`, from the command line
DYED_FORK = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,0,0,0,10,0,0,0.3,0.3,artery,0\n"
    "1,1,2,10,0,0,20,5,0,0.2,0.2,artery,0\n"
    "2,1,3,10,0,0,20,-5,0,0.2,0.2,artery,0\n"
)
PREDICT = ("dye", "--predict", "--model", "fork.csv", "--unit", "mm", "--out", "dye")


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(DYED_FORK)
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
def test_what_dye_can_t_be_foreseen_of_is_refused(
    fork: Path, options: tuple[str, ...], words: str
) -> None:
    done = printctl(*PREDICT, *options, cwd=fork)
    assert done.returncode != 0
    assert words in " ".join(done.stderr.split())


def test_without_a_film_and_predict_the_way_out_is_named(fork: Path) -> None:
    done = printctl("dye", "--model", "fork.csv", "--out", "dye", cwd=fork)
    assert done.returncode != 0
    assert "--predict to foresee" in " ".join(done.stderr.split())
