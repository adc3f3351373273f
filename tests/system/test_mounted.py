"""`printctl mount` and what `print` does with it, on a printer behind a port."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from firmware_profiles.load import shipped_text
from printctl.checks.made_for import named
from printctl.errors import SafetyError
from printctl.machine.prints.mounted import refuse_remounted
from printctl.machine.records.record import ContactRecord
from tests.printctl.machine.link.layered import layered
from tests.sim_process import printer_process
from tests.system.cli import called, recipe_file

AREA = load(Syringe, "hamilton_1ml").area_mm2
PRINTER = ("--printer", "generic_marlin")
PARTS = ("--needle", "30g_50mm", "--bath", "gelatin_support", "--dish", "box_80mm")
FILLED = ("--syringe", "hamilton_1ml", "--ink", "collagen_fresh", "--fill-ul", "80")
NOWHERE = ("--port", "/dev/ttyNONE9", "--yes")


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))


def job(folder: Path, *last: str, pushed_mm: float = 2.0) -> Path:
    """Lines of ink that push the plunger so far; no file of ours."""
    lines = ["G21", "G90", "M82", "M302 P1", "G92 X100 Y100 Z5 E0"]
    lines += [
        f"G1 X{100 + 5 * (k % 2)} Y{100 + 0.2 * k:.2f} E{pushed_mm * k / 40:.4f} F600"
        for k in range(1, 41)
    ]
    path = folder / "job.gcode"
    path.write_text("\n".join([*lines, *last]) + "\n")
    return path


LIFT = "G0 Z40 F300"


def left_ul(folder: Path) -> float | None:
    found = json.loads(called("mount", "--json", cwd=folder).stdout)["mounted"]
    return found[0]["left_ul"]


def refused(code: int, *words: str | Path, cwd: Path) -> str:
    done = called(*words, cwd=cwd)
    assert done.returncode == code, done.stderr
    return done.stderr


def test_prints_use_what_is_mounted_and_take_it_off(tmp_path: Path) -> None:
    file = job(tmp_path, LIFT)
    assert called("mount", *PRINTER, *FILLED, *PARTS, cwd=tmp_path).returncode == 0
    before = left_ul(tmp_path)
    assert before == pytest.approx(80 - load(Syringe, "hamilton_1ml").dead_volume_ul)
    words = ("print", file, *PRINTER, "--yes")
    foreign = refused(3, *words, *NOWHERE[:2], cwd=tmp_path)
    assert "doesn't record the set-up it was made for" in foreign
    assert "syringe Hamilton 1 mL" in foreign
    assert "--for-mounted" in foreign
    with printer_process(tmp_path, "--exit-on-hangup") as port:
        done = called(*words, "--port", port, "--for-mounted", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    after = left_ul(tmp_path)
    assert after == pytest.approx(before - 2.0 * AREA, abs=0.01)
    # Asked once for this file and set-up; the second print finds less ink than it takes.
    again = refused(3, *words, *NOWHERE[:2], cwd=tmp_path)
    assert "ink that the job takes, of what is in the syringe" in again
    assert f"limit {after:g}" in again
    assert called("mount", "--fill-ul", "880", cwd=tmp_path).returncode == 0
    assert "ttyNONE9" in refused(4, *words, *NOWHERE[:2], cwd=tmp_path)
    assert left_ul(tmp_path) == pytest.approx(before + 800)  # nothing was pushed


def test_a_part_that_contradicts_what_is_mounted_is_refused(tmp_path: Path) -> None:
    file = job(tmp_path, LIFT)
    called("mount", *PRINTER, *FILLED, *PARTS, cwd=tmp_path)
    words = ("print", file, *PRINTER, *NOWHERE, "--for-mounted")
    told = refused(3, *words, "--syringe", "hamilton_5ml", cwd=tmp_path)
    assert "--syringe is 'hamilton_5ml', and 'hamilton_1ml' is mounted on generic_marlin" in told
    assert "'30g_50mm' is mounted" in refused(3, *words, "--needle", "none", cwd=tmp_path)
    # A rehearsal is no machine.
    words = ("print", file, *PRINTER, "--port", "simulated", "--syringe", "bd_1ml")
    assert called(*words, cwd=tmp_path).returncode == 0
    assert left_ul(tmp_path) == pytest.approx(60)
    changed = called("mount", "--syringe", "hamilton_5ml", cwd=tmp_path)
    assert "hamilton_5ml, ink left not known" in changed.stdout


def test_nothing_is_assumed_on_a_real_port(tmp_path: Path) -> None:
    file = job(tmp_path, LIFT)
    told = refused(3, "print", file, *PRINTER, *NOWHERE, *PARTS, cwd=tmp_path)
    assert "syringe: neither named nor mounted on generic_marlin" in told
    assert "ink: neither named nor mounted on generic_marlin" in told
    assert "printctl mount --printer generic_marlin --syringe PROFILE" in told
    done = called("print", file, *PRINTER, "--port", "simulated", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "note: assumed syringe hamilton_1ml, ink collagen_fresh" in done.stderr


def test_a_needle_left_in_the_print_is_refused_on_a_real_port(tmp_path: Path) -> None:
    file = job(tmp_path)
    named = (*FILLED[:4], *PARTS, "--for-mounted")
    told = refused(3, "print", file, *PRINTER, *NOWHERE, *named, cwd=tmp_path)
    assert "the needle would stay in the print; add a lift at the end" in told


def test_changes_of_syringe_count_in_the_cells_time(tmp_path: Path) -> None:
    ink, file = tmp_path / "ink.yaml", tmp_path / "long.gcode"
    text = shipped_text(Ink, "collagen_fresh").replace("calibrated: false", "calibrated: true")
    ink.write_text(f"{text}\nviability_min: 90\nviability_source: our protocol\n")
    file.write_bytes(layered(30, 700))  # three quarters of an hour, and a second syringe
    words = ("print", file, *PRINTER, "--port", "simulated", "--ink", ink, "--start", "50,50,10")
    told = refused(3, *words, "--reload", "--reload-min", "60", cwd=tmp_path)
    assert "print time with 1 syringe changes vs. cell viability limit" in told
    assert "limit 90" in told


def test_a_profile_of_ones_own_is_one_printer_by_any_path(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(shipped_text(Printer, "generic_marlin"))
    called("mount", "--printer", "mine.yaml", *FILLED, cwd=tmp_path)
    (tmp_path / "data/mounted/broken.json").write_text("{")
    shown = called("mount", "--printer", tmp_path / "mine.yaml", cwd=tmp_path / "data")
    assert "hamilton_1ml, 60 µL left" in shown.stdout
    assert shown.stdout == called("mount", cwd=tmp_path).stdout
    assert sorted(one.name for one in tmp_path.iterdir()) == ["data", "mine.yaml"]


def test_a_run_on_a_real_port_keeps_to_what_is_mounted(tmp_path: Path) -> None:
    coarse = {"=": "replace", "method": "fresh", "needle": "22g", "layer_um": 150, "line_um": 400}
    part = {"port": "/dev/ttyNONE9"}
    scan = {"=": "replace", "file": "later.tif", "voxel_um": [10, 10, 10]}
    recipe = recipe_file(tmp_path, "planar_fresh", toolpath=coarse, printer=part, scan=scan)
    words = ("run", recipe, "--until", "print", "--yes", "--out", tmp_path / "run")
    called("mount", *PRINTER, "--syringe", "hamilton_5ml", cwd=tmp_path)
    told = refused(3, *words, cwd=tmp_path)
    assert "syringe in the recipe is 'hamilton_1ml', and 'hamilton_5ml' is mounted" in told
    called("mount", "--syringe", "none", cwd=tmp_path)
    assert "ttyNONE9" in refused(4, *words, cwd=tmp_path)
    data = yaml.safe_load(recipe.read_text())
    del data["printer"]["syringe"]
    recipe.write_text(yaml.safe_dump(data))
    told = refused(3, *words, cwd=tmp_path)
    assert "note: assumed syringe hamilton_1ml, as the recipe names no other" in told
    assert "neither named nor mounted on generic_marlin; name it (syringe in the recipe)" in told


def test_a_print_isnt_continued_with_another_needle_than_its_file_names(tmp_path: Path) -> None:
    needle = named(load(Needle, "30g_50mm"))
    file = job(tmp_path, LIFT)
    file.write_text(f"; printctl needle: {needle.name} #{needle.hash}\n" + file.read_text())
    record = ContactRecord(
        job=str(file), profile="generic_marlin", port="/dev/ttyNONE9", started=0.0,
        pid=1, address="", token="",
    )  # fmt: skip
    record.save(tmp_path)
    assert called("mount", *PRINTER, *FILLED, *PARTS, cwd=tmp_path).returncode == 0
    refuse_remounted(tmp_path)
    assert called("mount", *PRINTER, "--needle", "22g", cwd=tmp_path).returncode == 0
    with pytest.raises(SafetyError, match=r"needle .* made for '30G.*', and '22G, .*' is mounted"):
        refuse_remounted(tmp_path)
