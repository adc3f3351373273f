"""Plate job end to end: read back independently, and refusals."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from copy import deepcopy
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pypdf import PdfReader
from rich.console import Console

from design.network_files.csv_format import write_network_csv
from firmware_profiles import Bath, Ink, Needle, Plate, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.preflight import SetUp, file_checks
from printctl.errors import RecipeError, SafetyError
from printctl.pipeline.plate_plan import assigned
from printctl.pipeline.running.run import toolpath_recipe
from printctl.recipe import load_recipe, parse_recipe
from tests.printctl.web.shell.browsers import CHROMIUM
from tests.system.cli import ROOT, called, printctl
from tests.system.forks import FORK

RECIPE: dict[str, Any] = {
    "schema": 1,
    "name": "forks",
    "tissue": {"shape": "block", "size_mm": [6, 6, 4]},
    "vasculature": {"network": "fork.csv", "unit": "mm"},
    "toolpath": {"method": "embedded", "needle": "30g_50mm"},
    "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    "plate": {
        "profile": "corning_24",
        "wells": ["B2..B3", "C2..C3"],
        "bath_depth_mm": 6,
        "sweep": {"ink.flow_factor": [1.0, 0.8]},
        "scanned": ["B3"],
    },
    "scan": {"simulated": "microct", "voxel_um": [100, 100, 100], "seed": 3},
    "registration": {"diameter_tolerance_percent": 50, "tolerance_um": 500},
}
# Middle of the plate at (100, 100); Corning: A1 at 17.46, 13.78 mm, pitch 19.3 mm, 127.76 by 85.47.
B2 = (100 - 127.76 / 2 + 17.46 + 19.3, 100 + 85.47 / 2 - 13.78 - 19.3)
CENTRES = {
    f"{row}{column}": (B2[0] + 19.3 * (column - 2), B2[1] - 19.3 * "BC".index(row))
    for row in "BC"
    for column in (2, 3)
}
WELL_MM, RIM_MM, NEEDLE_MM = 15.62, 20.27, 0.31
MOVE = re.compile(r"([XYZE])(-?[\d.]+)")


def recipe(**changes: dict[str, Any]) -> dict[str, Any]:
    data = deepcopy(RECIPE)
    for section, said in changes.items():
        data[section] |= said
    return data


def run(folder: Path, data: dict[str, Any]) -> dict[str, Any]:
    """As far as the checked job."""
    write_network_csv(folder / "fork.csv", FORK)
    recipe = parse_recipe(data, "test.yaml")
    return toolpath_recipe(recipe, folder, folder / "run", Console(quiet=True))


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole recipe, run once."""
    folder = tmp_path_factory.mktemp("plate")
    write_network_csv(folder / "fork.csv", FORK)
    (folder / "forks.yaml").write_text(yaml.safe_dump(RECIPE))
    done = called("run", "forks.yaml", "--out", "run", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "run"


def moves(text: str) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Well named last before each move, and where the move begins and ends; X, Y, Z and E."""
    at, well, found = np.full(4, np.nan), "", []
    for line in text.splitlines():
        if line.startswith(";WELL:"):
            well = line[6:].split()[0]
        if line.startswith(";WELL_END:"):
            assert line[10:] == well
            well = ""
        if not line.startswith(("G0", "G1", "G92")):
            continue
        to = at.copy()
        for letter, number in MOVE.findall(line):
            to["XYZE".index(letter)] = float(number)
        if not line.startswith("G92"):
            found.append((well, at, to))
        at = to
    return found


def nearest(place: np.ndarray) -> tuple[str, float]:
    found = {name: hypot(place[0] - x, place[1] - y) for name, (x, y) in CENTRES.items()}
    name = min(found, key=lambda one: found[one])
    return name, found[name]


def test_below_the_rims_the_needle_stays_inside_one_well(printed: Path) -> None:
    rows = moves((printed / "part.gcode").read_text())
    below = [row for row in rows if min(row[1][2], row[2][2]) < RIM_MM]
    assert len(below) > 30
    for well, begin, end in below:
        (one, off), (other, away) = nearest(begin), nearest(end)
        assert one == other
        assert well in ("", one)
        assert max(off, away) + NEEDLE_MM / 2 + 1 <= WELL_MM / 2


def test_every_well_gets_the_same_part_in_its_middle(printed: Path) -> None:
    rows = moves((printed / "part.gcode").read_text())
    want = np.array([FORK.points[:, :2].min(axis=0), FORK.points[:, :2].max(axis=0)]) - [3, 3]
    for name, centre in CENTRES.items():
        places = [at[:2] for well, begin, end in rows if well == name for at in (begin, end)]
        ends = np.array(places) - centre
        bounds = np.array([ends.min(axis=0), ends.max(axis=0)])
        np.testing.assert_allclose(bounds, want, atol=0.5)


def test_a_way_lowered_by_hand_and_a_short_needle_are_found_in_the_file(printed: Path) -> None:
    text = (printed / "part.gcode").read_text()
    setup = SetUp(
        load(Printer, "generic_marlin"),
        load(Syringe, "hamilton_1ml"),
        load(Ink, "gelatin_sacrificial"),
        load(Needle, "30g_50mm"),
        load(Bath, "cell_matrix"),
    )

    def failed(data: str, set_for: SetUp = setup) -> list[str]:
        declared = dict(MOVE.findall(next(x for x in data.splitlines() if x.startswith("G92"))))
        start = (float(declared["X"]), float(declared["Y"]), float(declared["Z"]))
        done = dry_run(data.encode(), set_for.printer, start)
        checks = file_checks(done, set_for, printed / "part.map.npz")
        return [f"{one.check}: {one.place}" for one in checks if one.refuses]

    assert failed(text) == []
    lines = text.splitlines()
    row = lines.index(";WELL_END:B2") + 2
    assert lines[row].startswith("G0 Z22.27")
    lines[row] = lines[row].replace("22.27", "19")
    found = failed("\n".join(lines) + "\n")
    assert any(one.startswith("travel between wells vs. plate rim: line") for one in found)
    assert any(one.startswith("needle to well wall: well B2, line") for one in found)
    short = SetUp(setup.printer, setup.syringe, setup.ink, load(Needle, "30g"), setup.bath)
    assert any(one.startswith("needle that the job was made for") for one in failed(text, short))
    text = "".join(
        line for line in text.splitlines(keepends=True) if not line.startswith("; printctl ")
    )
    assert {one.split(":")[0] for one in failed(text, short)} == {"needle hub to well wall"}
    slim = short.needle and short.needle.model_copy(update={"hub_outer_mm": 4.5})
    assert failed(text, SetUp(setup.printer, setup.syringe, setup.ink, slim, setup.bath)) == []


ONE = {"sweep": {}, "wells": ["C3"], "scanned": None}


def test_a_well_that_runs_over_is_refused_by_name(printed: Path, tmp_path: Path) -> None:
    """191.6 mm² and 17.4 mm deep: 3 µL of ink are more than a bath of 17.39 mm leaves room for."""
    shutil.copytree(printed, tmp_path / "run")  # with its design, which doesn't change
    with pytest.raises(SafetyError, match=r"well B2 \(flow factor 1\).*\n.*would overflow"):
        run(tmp_path, recipe(plate={"bath_depth_mm": 17.39}))


def test_the_shipped_example_fills_six_wells() -> None:
    example = load_recipe(ROOT / "examples" / "wells_sweep.yaml")
    assert example.plate is not None
    wells = assigned(example.plate, load(Plate, example.plate.profile))
    assert [well.name for well in wells] == ["A1", "A2", "A3", "B1", "B2", "B3"]
    assert wells[-1].label == "flow factor 0.9, write speed 8 mm/s"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plate": {"sweep": {"toolpath.colour": [1, 2]}}}, "toolpath.colour: is no key here"),
        ({"plate": {"sweep": {"toolpath.write_speed_mm_s": [1, -2]}}}, "must be above 0"),
        ({"plate": {"sweep": {"ink.flow_factor": [1, 9]}}}, "ink.flow_factor: must be at most 5"),
        ({"plate": {**ONE, "a1_mm": [190, 100]}}, "middle of well C3 is at x 228.6 mm"),
        ({"printer": {"profile": "two_syringe_marlin"}}, "has 2 heads"),
        ({"printer": {"dish": "petri_60mm"}}, "printer.dish is of one dish"),
        ({"toolpath": {"compensate_lag": True}}, "isn't driven ahead of the lag"),
        (
            {"printer": {"profile": "pneumatic_marlin", "ink": "fibrinogen_fresh"}},
            "does nothing on",
        ),
    ],
)
def test_what_can_t_be_is_refused_before_it_is_planned(tmp_path, changes, words):
    with pytest.raises(RecipeError, match=words):
        run(tmp_path, recipe(**changes))
    assert not (tmp_path / "run" / "part.gcode").exists()


# --- planar recipe end to end: contents of its report
def test_every_vessel_is_open_and_as_wide_as_designed(planar_report: dict[str, Any]) -> None:
    vessels = planar_report["registration"]["vessels"]
    assert len(vessels) == 14
    assert all(row["open"] for row in vessels)
    assert max(abs(row["error_percent"]) for row in vessels) < 10


def test_deviation_is_given_for_rigid_and_scaled_fit(planar_report: dict[str, Any]) -> None:
    found = planar_report["registration"]
    assert 0 < found["scaled"]["rms_um"] < found["rigid"]["rms_um"] < 100


def test_pose_is_that_of_the_scanner_within_30_um(planar_report: dict[str, Any]) -> None:
    assert planar_report["truth_check"]["pose_error_um"] < 30


def test_verdict_passes_with_reasons(planar_report: dict[str, Any]) -> None:
    assert planar_report["verdict"]["passed"]
    assert planar_report["verdict"]["reasons"]


def test_solids_are_watertight_with_the_genus_of_the_graph(planar_report: dict[str, Any]) -> None:
    solid = planar_report["solid"]
    assert solid["genus"] == solid["genus_expected"] == 4
    assert all(found["watertight"] and found["manifold"] for found in solid["files"].values())


def test_printer_did_every_line_in_the_time_of_the_dry_run(planar_report: dict[str, Any]) -> None:
    done, planned = planar_report["print"], planar_report["dry_run"]
    assert done["state"] == "done"
    assert done["lines"] == planar_report["toolpath"]["lines"]
    np.testing.assert_allclose(done["duration_s"], planned["duration_s"], rtol=1e-3)


def test_report_opens_offline(planar_run: Path) -> None:
    page = (planar_run / "report.html").read_text()
    assert 'src="http' not in page
    assert 'href="http' not in page


def test_manifest_holds_versions_frames_and_hashes(planar_run: Path) -> None:
    manifest = json.loads((planar_run / "manifest.json").read_text())
    assert {"versions", "seed", "profiles", "frames", "recipe"} <= set(manifest["facts"])
    digest = hashlib.sha256((planar_run / "part.gcode").read_bytes()).hexdigest()
    assert manifest["stages"]["toolpath"]["outputs"]["part.gcode"] == digest


@pytest.mark.slow
def test_second_run_does_nothing_again(planar_run: Path, planar_recipe: Path) -> None:
    before = (planar_run / "part.gcode").stat().st_mtime_ns
    pdf = ["--pdf"] if CHROMIUM else []
    done = printctl("run", planar_recipe, "--out", planar_run, *pdf, "--json", cwd=planar_run)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    if pdf:
        first = " ".join(PdfReader(planar_run / "report.pdf").pages[0].extract_text().split())
        assert all(reason in first for reason in report["verdict"]["reasons"])
    assert all(stage["reused"] for stage in report["timings"].values())
    assert (planar_run / "part.gcode").stat().st_mtime_ns == before


def test_same_recipe_gives_the_same_bytes(planar_run, planar_recipe, tmp_path):
    """In another process, which orders its sets in another way."""
    until = ("--until", "toolpath")
    done = printctl("run", planar_recipe, "--out", "again", *until, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for name in ("part.gcode", "network.csv", "lumen.stl"):
        assert (tmp_path / "again" / name).read_bytes() == (planar_run / name).read_bytes()


@pytest.mark.slow
def test_registering_the_scan_again_gives_the_same_numbers(planar_run, planar_report, tmp_path):
    (planar_run / "scan_truth.json").rename(tmp_path / "hidden.json")
    pdf = ["--pdf"] if CHROMIUM else []
    try:
        done = printctl(
            "register", planar_run / "scan.tif", "--model", planar_run, "--out", "again", *pdf,
            "--json", cwd=tmp_path,
        )  # fmt: skip
    finally:
        (tmp_path / "hidden.json").rename(planar_run / "scan_truth.json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["registration"]
    assert found["scaled"] == planar_report["registration"]["scaled"]
    if pdf:
        pages = PdfReader(tmp_path / "again/report.pdf").pages
        text = "".join("".join(page.extract_text() for page in pages).split())
        digest = hashlib.sha256((planar_run / "scan.tif").read_bytes()).hexdigest()
        assert digest in text
        assert "SHA-256ofG-code" in text


def test_folder_holds_everything_promised(planar_run: Path) -> None:
    promised = {
        "network.csv", "network.vtp", "flow.csv", "lumen.stl", "solid.stl", "solid.3mf",
        "part.gcode", "part.map.npz", "scan.tif", "deviation.ply", "report.html", "report.json",
        "manifest.json",
    }  # fmt: skip
    assert promised <= {path.name for path in planar_run.iterdir()}
    assert not [path for path in planar_run.rglob("*") if ".part" in path.suffixes]
