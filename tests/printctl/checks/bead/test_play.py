"""Playback page of a predicted print, as `printctl simulate --out` writes it."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.printctl.checks.bead.parts import LAG_S, write_job
from tests.printctl.checks.bead.test_simulate import SET_UP, facts, simulate
from tests.registration.report.columns import unpacked_table


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
