"""Layer pictures drawn from the G-code."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from lxml import etree
from PIL import Image
from rich.console import Console

from design.geometry.surface import Surface
from design.hemodynamics import FlowConditions
from design.network_files.csv_format import write_network_csv
from gcode.deposit.written import Strands
from kernels.arrays import FloatArray, IntArray
from printctl.analysis.flow import ONE_D, ONE_D_WAVES, TABLE, steady_conditions
from printctl.analysis.flow.conditions import Driven
from printctl.machine.job.job import Insert
from printctl.machine.records.journal import encode
from printctl.machine.records.record import JOURNAL
from printctl.observe.records import LookRecord, look_folder, save_look
from printctl.pipeline.judging.look_rows import look_rows
from printctl.pipeline.judging.tracing import Job, by_layer, made_by
from printctl.pipeline.judging.written_in_scan import looks_and_scan, save_written, written_places
from printctl.pipeline.running.run import toolpath_recipe
from printctl.pipeline.stages.perfusion import fidelities
from printctl.pipeline.stages.perfusion.flow import work
from printctl.recipe import parse_recipe
from printctl.recipe.parts import FlowPart
from printctl.recipe.sections.solid import SolidPart
from report.figures.look_figure import look_figures
from tests.design.hemodynamics.networks import network_of
from tests.printctl.networks import vessels
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
    assert look_figures(look_rows(tmp_path)) == {}
    job = {"t": "job", "sha256": "0" * 64, "lines": 30, "started": 50.0}
    insert = {"t": "insert", "reload_at": [], **Insert(2, 20, (b"G1 X1", b"G4 P0")).to_record()}
    (tmp_path / JOURNAL).write_bytes(encode(job) + encode(insert))
    old = LookRecord(4, 9, 9, "of an earlier print", 10.0, "stop", "why")
    for one in (record(1), record(2, "mend", 0.8), record(3, "pause", None), old):
        save_look(tmp_path, one)
    Image.new("RGB", (300, 200), "#8090a0").save(look_folder(tmp_path, 1) / "seen.png")
    Image.new("L", (200, 300), 90).save(look_folder(tmp_path, 2) / "picture.png")
    (look_folder(tmp_path, 3) / "seen.png").write_bytes(b"torn")
    found = look_figures(look_rows(tmp_path))
    curve, strip = found.values()
    assert [name.startswith("print/") for name in found] == [True, True]
    assert "3 looks in their order" in list(found)[1]
    assert {"mended", "paused or cancelled"} <= set(etree.fromstring(curve).itertext())
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


# --- trace from a place of the print to its G-code lines
NO_FACES = np.empty((0, 3), dtype=np.int64)

NETWORK = vessels([[0, 0, 0.5], [10, 0, 0.5]])


def written(start: FloatArray, end: FloatArray, line: IntArray) -> Strands:
    return Strands.dosed(start, end, np.ones(len(line)), np.arange(len(line)), line)


def traced_job(of_vessels: bool = False) -> Job:
    """Ten layers of 0.1 mm; in each a line on either side of the vessel, at y = ±0.3."""
    start, end, line, source = [], [], [], []
    for layer in range(10):
        z = 0.1 * (layer + 1)
        for side in (-0.3, 0.3):
            start.append((0.0, side, z))
            end.append((10.0, side, z))
            line.append(10 * layer + (3 if side < 0 else 6))
            source.append(layer)
    first = 10 * np.arange(10) + 1
    return Job(
        written(np.array(start), np.array(end), np.array(line)),
        np.array(source), of_vessels, first, first + 9,
    )  # fmt: skip


def defect(kind: str = "stenosis", **more: object) -> dict[str, object]:
    return {"kind": kind, "vessel": 0, "from_mm": 4.0, "to_mm": 5.0, **more}


def test_lines_beside_a_stenosis_are_those_of_its_layers() -> None:
    found = made_by(defect(), traced_job(), NETWORK, 0.1)
    # Within 0.2 + 0.15 mm of the axis at z = 0.5: the walls at 0.3 mm, 0.18 mm up and down.
    assert found["layers"] == [3, 4, 5]
    assert (found["first_line"], found["last_line"], found["line_count"]) == (33, 56, 6)


def test_a_vessels_own_line_is_named_in_an_embedded_print() -> None:
    one = Job(
        written(
            np.array([[0.0, 0, 0.5], [0, 5, 0.5]]), np.array([[10.0, 0, 0.5], [10, 5, 0.5]]),
            np.array([7, 9]),
        ), np.array([0, 1]), True, np.array([6, 8]), np.array([7, 9]),
    )  # fmt: skip
    found = made_by(defect("occlusion"), one, NETWORK, 0.0)
    assert found == {"vessels": [0], "first_line": 7, "last_line": 7, "line_count": 1}


def test_layers_of_different_heights_take_what_lies_in_them() -> None:
    """Two of 0.1 mm, the next without lines, then thinner ones; the first primes higher up."""
    tops = np.array([0.1, 0.1, 0.5, 0.2, 0.24, 0.26])
    end = np.column_stack([np.ones(6), np.zeros(6), tops])
    source = np.array([0, 0, 0, 1, 3, 4])
    lines = np.arange(1, 7)
    one = Job(written(end - [1, 0, 0], end, lines), source, False, np.arange(5), np.arange(5))
    report = SimpleNamespace(
        transform_scan_to_part=np.eye(4),
        scaled_scan_to_part=np.eye(4),
        surface=Surface(
            np.array([[0, 0, z] for z in (0.05, 0.15, 0.21, 0.23, 0.25, 0.4)]), NO_FACES
        ),
        seen=np.ones(6, dtype=bool),
        scaled_deviation_um=np.array([1.0, 2.0, 3.0, 4.0, 5.0, 7.0]),
    )
    rows = by_layer(report, one)  # type: ignore[arg-type]
    assert [row["mean_um"] for row in rows] == [1.0, 2.0, 3.0, 4.0, 6.0]
    assert [row["z_mm"] for row in rows] == pytest.approx([0.1, 0.2, 0.22, 0.24, 0.26])


# --- pipeline stage of flow: 1D waves on request, at the print's size
def test_a_run_writes_the_problems_that_its_recipe_names(tmp_path: Path) -> None:
    flow = FlowPart.model_validate({"exports": ["svzerod", "svmultiphysics"]})
    network = network_of([[0, 0, 0], [6, 0, 0]], [(0, 1)], 0.8)
    context: Any = SimpleNamespace(
        recipe=SimpleNamespace(flow=flow, print_scale=2.0, solid=SolidPart()),
        recipe_folder=Path(),
        folder=tmp_path,
        network=network,
        conditions=Driven(flow, print_scale=2.0).steady(network),
        bars=SimpleNamespace(remark=lambda *_: None),
    )
    summary, files = work(context, cast(Any, lambda *_: None))
    case = json.loads((tmp_path / "svzerod.json").read_text())
    flow_cm3_s = case["boundary_conditions"][0]["bc_values"]["Q"]
    assert flow_cm3_s == pytest.approx([8 * 0.25 / 60] * len(flow_cm3_s))
    assert summary["inflow_ml_min"] == pytest.approx(8 * 0.25)
    assert {"svzerod.json", "svmultiphysics/solver.xml"} < set(files)
    assert 0.9 < summary["svmultiphysics"]["volume_share"] < 0.95
    assert all((tmp_path / name).is_file() for name in files)


def test_a_print_twice_the_size_carries_eight_times_the_flow(tmp_path: Path) -> None:
    flow = FlowPart.model_validate(
        {
            "pulse": {"amplitude_ml_min": 0.1, "period_s": 1, "wall_young_kpa": 10, "steps": 20},
            "one_d": {},
        }
    )
    told: list[tuple[float, str]] = []
    context: Any = SimpleNamespace(
        recipe=SimpleNamespace(flow=flow, print_scale=2.0),
        recipe_folder=Path(),
        folder=tmp_path,
        network=network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 0.8),
        conditions=steady_conditions(flow),
        bars=SimpleNamespace(remark=lambda *_: None),
    )
    summary, files = work(context, cast(Any, lambda *said: told.append(said)))
    found = summary["one_d"]
    assert files[0] == TABLE
    assert found["inlet_flow_mean_ml_min"] == pytest.approx(8 * 0.25)
    assert (tmp_path / ONE_D).is_file()
    # Twenty samples and the columns' names.
    assert len((tmp_path / ONE_D_WAVES).read_text().splitlines()) == 21
    shares = [share for share, _ in told]
    assert len(told) == found["cycles"]
    assert np.all((np.array(shares) >= 0.0) & (np.array(shares) <= 1.0))


# --- pipeline stage of 3D flow: runs on request, reruns when its inputs change
WAVES_NETWORK = network_of([[0, 0, 0], [0, 0, 4.0]], [(0, 1)], 0.5)


def _context(folder: Path, fillet_ratio: float = 0.5, **flow: Any) -> Any:
    return SimpleNamespace(
        recipe=SimpleNamespace(
            flow=FlowPart(**flow), solid=SimpleNamespace(fillet_ratio=fillet_ratio), print_scale=1.0
        ),
        recipe_folder=folder,
        folder=folder,
        network=WAVES_NETWORK,
        conditions=FlowConditions(1e-3, inlet_flow_ul_s=4.0),
    )


def test_a_straight_lumen_has_poiseuilles_pressure(tmp_path: Path) -> None:
    pytest.importorskip("ngsolve")
    context = _context(tmp_path, three_d={"edge_ratio": 0.8}, compare={"points": 3})
    told: list[str] = []
    summary, files = fidelities.work(context, lambda share, doing: told.append(doing))
    assert summary["comparison"]["3D"]["pressure_off_percent_of_inlet"] < 1.0
    assert summary["comparison"]["3D"]["flow_off_percent_of_inlet"] < 1e-6
    exact = 8.0 * 1e-3 * 4.0 * 4.0 / (np.pi * 0.5**4) / 133.322
    assert summary["three_d"]["pressure_drop_mmhg"] == pytest.approx(exact, rel=5e-3)
    assert all((tmp_path / name).stat().st_size for name in files)
    assert "meshing" in told
