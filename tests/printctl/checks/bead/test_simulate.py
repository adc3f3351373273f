"""`printctl simulate --out`: files, figures, and messages for wrong options."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path
from typing import Any

import nrrd
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.toolpath.added_moves import compensate_lag
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import GcodeOptions, save_gcode, stream_gcode
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.checks.preflight import written_arrays
from printctl.cli.main import app
from tests.report.columns import unpacked_table

LAG_S = 0.3
PLACE = (50.0, 50.0, 50.0)
START = (50.0, 50.0, 80.0)


def tapered() -> VesselNetwork:
    x = np.linspace(0, 20, 41)
    points = np.column_stack([x, np.zeros((len(x), 2))])
    return VesselNetwork(
        points[[0, -1]], np.array([[0, 1]]), np.array([0]), np.array([0]),
        np.array([0, len(x)]), points, np.linspace(0.5, 0.15, len(x)),
    )  # fmt: skip


def write_job(folder: Path, lag_s: float = 0.0, printer: str = "generic_marlin") -> Path:
    """Network, G-code and map in a folder; ahead of a lag where it is above 0."""
    network, profile, syringe = tapered(), load(Printer, printer), load(Syringe, "hamilton_1ml")
    write_network_csv(folder / "network.csv", network)
    path = plan_embedded(network, EmbeddedOptions(retract_ul=0.0)).toolpath
    if lag_s > 0:
        rate = 0.5 * profile.max_speed_mm_s.e * math.pi / 4 * syringe.inner_mm**2
        path = compensate_lag(path, lag_s, rate).toolpath
    options = GcodeOptions(start_mm=START, relieve_ul=0.0)
    job = stream_gcode([path], profile, syringe, PLACE, options, 1.0)
    beside = written_arrays(network, np.array(PLACE), 0.5, 0.05, [(0.31, 0.31, 0.0)])
    if lag_s > 0:
        beside["lag_s"] = np.array(lag_s)
    save_gcode(folder / "job.gcode", folder / "job.map.npz", job, beside)
    return folder / "job.gcode"


SET_UP = ("--start", "50,50,80", "--ink", "gelatin_sacrificial", "--needle", "30g")


def simulate(*words: object) -> Any:
    return CliRunner().invoke(app, ["simulate", *map(str, words)])


def facts(
    job: Path, *words: object, ink: object = "gelatin_sacrificial", needle: str = "30g"
) -> dict[str, Any]:
    set_up = ("--start", "50,50,80", "--ink", ink, "--needle", needle)
    told = (job, *set_up, "--network", job.parent / "network.csv", "--unit", "mm")
    result = simulate(*told, *words, "--json")
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)["predicted"][0]
    return found


def test_a_tapered_vessel_keeps_its_diameter_with_compensation_and_not_without(
    tmp_path: Path,
) -> None:
    found = {}
    for name, lag in (("plain", 0.0), ("ahead", LAG_S)):
        folder = tmp_path / name
        folder.mkdir()
        found[name] = facts(write_job(folder, lag), "--lag-s", LAG_S)["vessels"]
    assert abs(found["ahead"]["worst_percent"]) <= 5.0
    assert found["ahead"]["length_within_5_percent"] == 1.0
    assert found["plain"]["worst_percent"] < -50.0
    assert found["plain"]["length_within_5_percent"] < 0.6


def test_what_is_written_is_what_the_tables_and_voxels_hold(tmp_path: Path) -> None:
    job, out = write_job(tmp_path, LAG_S), tmp_path / "out"
    found = facts(job, "--lag-s", LAG_S, "--out", out, "--voxel-um", 60)
    with (out / "predicted_bead.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    laid = sum(float(row["laid_ul"]) for row in rows if row["kind"] == "writes")
    assert laid == pytest.approx(found["written_ul"], rel=1e-3)
    length = sum(float(row["length_mm"]) for row in rows if row["kind"] == "writes")
    assert length == pytest.approx(20.0, abs=0.05)
    # π/12 L (d₀² + d₀ d₁ + d₁²) of the designed frustum.
    design = np.pi / 12 * 20 * (1.0 + 0.3 + 0.09)
    assert found["written_ul"] == pytest.approx(design, rel=0.01)
    volume, header = nrrd.read(str(out / "predicted.nrrd"))
    ink = volume.sum(dtype=np.int64) / 255 * 0.06**3
    assert ink == pytest.approx(design + np.pi / 12 * (1.0 + 0.027), rel=0.04)
    assert np.all(np.abs(header["space origin"] - [49.5, 49.5, 49.5]) < 0.1)
    assert (out / "predicted.ply").read_bytes().startswith(b"ply")
    assert (out / "time_line.png").stat().st_size > 10_000
    with (out / "predicted_vessels.csv").open() as handle:
        assert [row["vessel"] for row in csv.DictReader(handle)] == ["0"]


def test_the_ink_s_own_lag_is_taken_with_the_needle_it_was_measured_with(tmp_path: Path) -> None:
    job, ink = write_job(tmp_path), load(Ink, "gelatin_sacrificial")
    data = ink.model_dump(mode="json", exclude_unset=True)
    data["lag"] = {"lag_s": 0.3, "needle": "30G, half an inch", "syringe": "Hamilton 1 mL gastight"}
    (tmp_path / "ink.yaml").write_text(yaml.safe_dump(data))
    own, out = tmp_path / "ink.yaml", tmp_path / "out"
    found = facts(job, "--out", out, ink=own)
    assert (found["lag"], found["lag_s"]) == ("measured", 0.3)
    other = facts(job, "--out", out, ink=own, needle="27g")
    assert (other["lag"], other["lag_s"]) == ("unknown", 0.0)
    assert "measured with Hamilton 1 mL" in other["warnings"][0]["text"]


def test_an_unmeasured_lag_is_told_and_nothing_is_predicted_unasked(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    found = facts(job)
    assert found["lag"] == "unknown"
    assert not found["warnings"][0]["calibrated"]
    assert "predicted" not in json.loads(simulate(job, *SET_UP, "--json").stdout)


def test_a_file_ahead_of_another_lag_is_told(tmp_path: Path) -> None:
    found = facts(write_job(tmp_path, LAG_S), "--lag-s", 0.1)
    assert any(one["sort"] == "advance" for one in found["warnings"])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--voxel-um", "50"), "--out"),
        (("--window-s", "3,1", "--out", "x"), "above it"),
        (("--window-s", "a", "--out", "x"), "FROM,TO"),
        (("--place", "0,0,0"), "--network"),
        (("--network", "nowhere.csv"), "nowhere.csv"),
        (("--lag-s", "0.1", "--printer", "pneumatic_marlin"), "opening_delay_s"),
    ],
)
def test_wrong_options_are_told(tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    job = write_job(tmp_path)
    if "pneumatic_marlin" in words:
        job.with_suffix(".map.npz").unlink()
        job.write_text(
            "M302 P1\nM106 P0 S0\nG21\nG90\nM106 P0 S255\nG1 X5 F300\nM106 P0 S0\nM400\n"
        )
    result = simulate(job, *SET_UP, *words)
    assert result.exit_code != 0
    assert says in result.output + str(result.exception)


def test_a_job_that_writes_nothing_is_told(tmp_path: Path) -> None:
    job = tmp_path / "empty.gcode"
    job.write_text("G21\nG90\nG1 X5 F300\n")
    result = simulate(job, *SET_UP, "--out", tmp_path / "out")
    assert result.exit_code != 0
    assert "pushes ink" in result.output + str(result.exception)


# --- playback page of a predicted print, as `printctl simulate --out` writes it
def page_of(path: Path) -> tuple[dict[str, Any], str]:
    text = path.read_text(encoding="utf-8")
    found = re.search(r'id="play-data">(.*?)</script>', text, re.S)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data, text


def test_the_page_plays_what_the_tables_say(tmp_path: Path) -> None:
    job, out = write_job(tmp_path), tmp_path / "out"
    found = facts(job, "--lag-s", LAG_S, "--out", out)
    data, text = page_of(out / "dry_run.html")
    columns = unpacked_table(data["rows"])
    time, width, wanted, x = (columns[name] for name in ("time", "width", "wanted", "x"))
    assert np.all(np.diff(time) >= 0)
    with (out / "predicted_bead.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    zero = float(rows[0]["time_s"])
    wrote = [row for row in rows if row["kind"] == "writes"]
    middle = np.array([float(r["time_s"]) + float(r["lasts_s"]) / 2 - zero for r in wrote])
    at = np.searchsorted(time, middle)
    # Widths that differ by less than a hundredth of the usual are told as one.
    predicted = np.array([float(row["width_mm"]) for row in wrote])
    laid = predicted > 0
    assert np.abs(width[at] - predicted)[laid].max() < 0.0105
    ends = np.array([float(r["time_s"]) + float(r["lasts_s"]) - zero for r in wrote])
    place = np.interp(ends, time, x)
    assert np.abs(place - [float(row["x_mm"]) for row in wrote]).max() < 0.03
    # The vessel goes from 1.0 to 0.3 mm over 20 mm from x = 50 mm.
    held = (wanted[at] < 60) & laid
    assert held.mean() > 0.8
    design = 1.0 - 0.7 * (np.interp(middle, time, x) - 50) / 20
    assert np.abs(wanted[at] - design)[held].max() < 0.02
    assert columns["laid"][-1] == pytest.approx(
        found["written_ul"] + found["oozed_ul"] + found["dropped_ul"], rel=1e-3
    )
    placed = {w["line"] for w in found["warnings"] if w["line"]}
    assert {"thin", "drop"} & {w["sort"] for w in found["warnings"]}
    assert placed <= set(map(int, re.findall(r'class="go"[^>]*>[\d:.]+, line (\d+)<', text)))
    for warning in found["warnings"]:
        assert warning["text"].split("(")[0].replace("'", "&#39;") in text


def test_where_no_ink_comes_there_is_no_page(tmp_path: Path) -> None:
    # Without M302 the firmware refuses to push a cold ink.
    lines = ["G92 X50 Y50 Z80 E0", "G1 X60 E1 F600", "G1 Y60 E2", "G1 Z79 E3"]
    (tmp_path / "cold.gcode").write_text("\n".join(lines) + "\n")
    result = simulate(tmp_path / "cold.gcode", *SET_UP, "--lag-s", 0.1, "--out", tmp_path / "out")
    assert "cold extrusion" in str(result.exception)
    assert (tmp_path / "out" / "predicted_bead.csv").is_file()
    assert not (tmp_path / "out" / "dry_run.html").exists()
