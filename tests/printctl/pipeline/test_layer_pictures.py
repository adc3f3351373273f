"""Layer pictures drawn from the G-code."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from PIL import Image
from rich.console import Console

from design.network_files.csv_format import write_network_csv
from printctl.machine.link.inserts import Insert
from printctl.machine.link.journal import encode
from printctl.machine.link.record import JOURNAL
from printctl.observe.records import LookRecord, look_folder, save_look
from printctl.pipeline.look_pictures import look_pictures
from printctl.pipeline.run import toolpath_recipe
from printctl.pipeline.tracing import Job
from printctl.pipeline.written_in_scan import looks_and_scan, save_written, written_places
from printctl.recipe import parse_recipe
from sim.gcode.deposit.strands import Strands
from tests.printctl.pipeline.test_heads import SIZE_MM, TUBE, WHOLE_UL, recipe


def heights(svg: bytes) -> list[float]:
    """Heights of the filled outlines in the drawing, in its own unit."""
    found = []
    for path in etree.fromstring(svg).iter("{http://www.w3.org/2000/svg}path"):
        numbers = [
            float(v) for v in path.get("d", "").replace("z", "").split() if v[0] in "-.0123456789"
        ]
        if "L" in path.get("d", "") and len(numbers) > 40:
            found.append(max(numbers[1::2]) - min(numbers[1::2]))
    return found


# --- adaptive layer heights, from recipe to checked G-code
def test_a_recipe_s_layers_are_thinner_round_a_lying_lumen(tmp_path: Path) -> None:
    """Heights as its G-code says them; both checks take each layer by its own."""
    write_network_csv(tmp_path / "tube.csv", TUBE)
    said = recipe([], [])
    said["toolpath"] |= {"layer_um": 60, "thinnest_layer_um": 20, "stair_um": 15}
    said["printer"] |= {"profile": "generic_marlin", "heads": []}
    made = parse_recipe(said, "thin.yaml")
    summary = toolpath_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    text = (tmp_path / "run" / "part.gcode").read_text()
    heights = np.array([float(found) for found in re.findall(r";HEIGHT:([\d.]+)", text)])
    assert heights.sum() == pytest.approx(SIZE_MM[2], abs=1e-6)
    assert (heights.min(), heights.max()) == pytest.approx((0.02, 0.06), abs=0.006)
    top = np.cumsum(heights)
    assert heights[top < 0.45] == pytest.approx(0.06, abs=0.006)
    assert heights[np.abs(top - 1.0) < 0.02].max() < 0.03
    assert summary["toolpath"]["written_ul"] == pytest.approx(WHOLE_UL, rel=0.02)
    found = json.loads((tmp_path / "run" / "lumens.json").read_text())
    assert found["passed"]
    # Its floor and ceiling stand on whole layers: 41 um are lost with layers of 60 um all alike.
    assert -20 < found["lumens"][0]["diameter_error_median_um"] < 5
    assert found["line_um"] == pytest.approx(150, abs=5)


# --- strip and curve of the looks at a print, for the report
def record(number: int, decision: str = "go_on", coverage: float | None = 1.0) -> LookRecord:
    found = {"coverage": coverage, "seen_share": None if coverage is None else 0.9}
    return LookRecord(number, 9, 9, "end of layer 1", 100.0, decision, "why", found=found)


def test_strip_and_curve_of_a_print_folder(tmp_path: Path) -> None:
    assert look_pictures(tmp_path) == {}
    job = {"t": "job", "sha256": "0" * 64, "lines": 30, "started": 50.0}
    insert = {"t": "insert", "reload_at": [], **Insert(2, 20, (b"G1 X1", b"G4 P0")).to_record()}
    (tmp_path / JOURNAL).write_bytes(encode(job) + encode(insert))
    old = LookRecord(4, 9, 9, "of an earlier print", 10.0, "stop", "why")
    for one in (record(1), record(2, "mend", 0.8), record(3, "pause", None), old):
        save_look(tmp_path, one)
    Image.new("RGB", (300, 200), "#8090a0").save(look_folder(tmp_path, 1) / "seen.png")
    Image.new("L", (200, 300), 90).save(look_folder(tmp_path, 2) / "picture.png")
    (look_folder(tmp_path, 3) / "seen.png").write_bytes(b"torn")
    found = look_pictures(tmp_path)
    curve, strip = found.values()
    assert [name.startswith("print/") for name in found] == [True, True]
    assert "3 looks in their order" in list(found)[1]
    assert {"mended", "paused or stopped"} <= set(etree.fromstring(curve).itertext())
    with Image.open(io.BytesIO(strip)) as picture:
        assert picture.width == 3 * picture.height
        edges = [picture.convert("RGB").getpixel((k * picture.height + 1, 100)) for k in range(3)]
    greys, blue, red = edges
    assert max(greys) - min(greys) < 30
    assert blue[2] > blue[0] + 60
    assert red[0] > red[2] + 60


# --- looks held against the final scan: where lines should lie, what is missing, who disagrees
LENGTH = 10.0


@pytest.fixture
def job() -> Job:
    """Two layers of two lines of 10 mm each, 0.1 mm high; the G-code's lines 11 to 14."""
    y, z = np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.1, 0.1, 0.2, 0.2])
    start = np.stack([np.zeros(4), y, z], axis=1)
    end = start + [LENGTH, 0, 0]
    number = np.arange(4)
    moves = Strands.dosed(start, end, np.ones(4), number, number + 11)
    return Job(moves, number // 2, False, np.array([11, 13]), np.array([12, 14]))


def look(number: int, line: int, seen=1.0, ink=1.0, decision="go_on", gaps=()) -> LookRecord:
    found = {"seen_share": seen, "coverage": ink, "gaps": list(gaps)}
    mark = f"end of layer {number - 1}, reload point"
    return LookRecord(number, line, line, mark, 0.0, decision, "", found=found)


def compared(tmp_path, job, scan, looks, inserts=()):
    """Rows for a scan given by what it has at a place (x, y, z)."""
    places = written_places(job, layered=True)
    ink = np.array([scan(*at) for at in places.at_mm], dtype=float)
    path = tmp_path / "written.npz"
    save_written(path, places, ink)
    return looks_and_scan(path, looks, inserts, [one.job_line for one in looks], 0.2)


def whole(x, y, z):
    return 1.0


def hole(x, y, z):
    """3 mm of the first layer's second line."""
    return 0.0 if y == 1.0 and z < 0.1 and 4 < x < 7 else 1.0


TWO = [look(1, 12), look(2, 14)]


def test_a_whole_print_agrees(tmp_path, job):
    rows = compared(tmp_path, job, whole, TWO)
    assert [row["agree"] for row in rows] == [True, True]
    assert [row["way_mm"] for row in rows] == [20.0, 20.0]
    assert [row["scan_ink"] for row in rows] == [1.0, 1.0]
    assert rows[0]["mark"] == "end of layer 0"


def test_what_a_look_called_whole_and_the_scan_misses_is_a_disagreement(tmp_path, job):
    first, second = compared(tmp_path, job, hole, TWO)
    assert first["agree"] is False
    assert first["words"] == "look: whole; scan: missing"
    assert first["scan_ink"] == pytest.approx(0.85)
    assert second["agree"] is True


def test_so_is_a_mend_that_the_scan_does_not_find(tmp_path, job):
    mend = Insert(1, 12, (b"G1 X1",), "a gap", 1.0)
    gaps = [{"from_mm": 4.0, "to_mm": 7.0}]
    looks = [look(1, 12, ink=0.85, decision="mend", gaps=gaps), TWO[1]]
    first, _ = compared(tmp_path, job, hole, looks, [mend])
    assert (first["agree"], first["mended"]) == (False, True)
    assert first["words"] == "look: mended; scan: missing"
