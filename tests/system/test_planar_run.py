"""Planar recipe end to end: contents of its report."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pypdf import PdfReader

from tests.printctl.web.shell.browsers import CHROMIUM
from tests.system.cli import printctl


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
