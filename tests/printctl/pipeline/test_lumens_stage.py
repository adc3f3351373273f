"""Pipeline stage that checks lumens in the G-code."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from design.geometry.surface import Surface
from design.network import VesselNetwork
from firmware_profiles import Printer, load
from firmware_profiles.bead import BeadSection
from kernels.arrays import FloatArray, IntArray
from printctl.errors import SafetyError
from printctl.pipeline.stages import lumens
from printctl.pipeline.tracing import Job, by_layer, made_by
from printctl.recipe.making import Embedded, Fresh
from sim.gcode.deposit.strands import Strands
from tests.printctl.checks.lumens.small_gcode import BORE_MM, LAYER_MM, Strokes, gcode, tube

LAYERS = 8
NONE = np.zeros(1, dtype=np.int64)


def context(folder: Path, layers: list[Strokes], part: Fresh | Embedded) -> Any:
    (folder / "part.gcode").write_bytes(gcode(layers))
    ends = np.array([[0, 0, 0], [0, 0, LAYERS * LAYER_MM]], dtype=float)
    return SimpleNamespace(
        folder=folder,
        recipe=SimpleNamespace(toolpath=part),
        printer=load(Printer, "generic_marlin"),
        syringe=SimpleNamespace(inner_mm=BORE_MM),
        ink=SimpleNamespace(
            name="ink", flow_factor=1.0, smallest_gap_mm=None, bead_section=BeadSection()
        ),
        place_mm=np.array([20.0, 30.0, 0.0]),
        start_mm=np.zeros(3),
        flow_ul_s=None,
        written_network=VesselNetwork.from_segments(
            ends, np.array([[0, 1]]), np.array([0.3]), NONE, NONE
        ),
        bars=SimpleNamespace(remark=lambda *_: None),
        manifest=SimpleNamespace(stages={}),
    )  # fmt: skip


def work(folder: Path, layers: list[Strokes], part: Fresh | Embedded) -> tuple[dict[str, Any], Any]:
    return lumens.work(context(folder, layers, part), lambda *_: None)


def fresh() -> Fresh:
    return Fresh(method="fresh", layer_um=1e3 * LAYER_MM)


def test_open_lumens_pass_and_are_written_down(tmp_path: Path) -> None:
    summary, files = work(tmp_path, [tube(0.3, centre=(20, 30))] * LAYERS, fresh())
    assert summary["checked"]
    assert summary["passed"]
    assert files == ["lumens.json"]
    written = json.loads((tmp_path / "lumens.json").read_text())
    assert written["lumens"][0]["narrowest_mm"] == pytest.approx(0.6, abs=2e-3)


def test_a_closed_lumen_is_refused(tmp_path: Path) -> None:
    plug = [np.array([[19.6, y], [20.4, y]]) for y in 30 + 0.1 * np.arange(-3, 4)]
    walls = tube(0.3, centre=(20, 30))
    layers = [[*walls, *(plug if k == 4 else [])] for k in range(LAYERS)]
    with pytest.raises(SafetyError, match=r"closed: lumen 0 \(1 of 1\)"):
        work(tmp_path, layers, fresh())
    assert json.loads((tmp_path / "lumens.json").read_text())["passed"] is False


def test_an_embedded_print_that_writes_beside_its_vessels_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SafetyError, match=r"not written through: vessel 0 \(1 of 1\)"):
        work(tmp_path, [tube(0.3)] * 2, Embedded(method="embedded"))
    assert json.loads((tmp_path / "lumens.json").read_text())["method"] == "filaments"


def test_a_vessel_left_out_by_the_plan_is_told_with_its_place_and_not_refused(
    tmp_path: Path,
) -> None:
    said = context(tmp_path, [tube(0.3)] * 2, Embedded(method="embedded", leave_out=True))
    left = {"vessel": 0, "other": 7, "place_mm": [1.0, 2.0, 3.5], "apart_mm": 0.1, "needle_mm": 0.0}
    plan = {"left_out": [left], "cut_off": [5, 6]}
    said.manifest.stages["toolpath"] = SimpleNamespace(summary={"plan": plan})
    found, _ = lumens.work(said, lambda *_: None)
    assert found["passed"]
    note = next(text for text in found["notes"] if "leave_out" in text)
    assert "vessel 0 (too near to vessel 7 at (1.00, 2.00, 3.50) mm)" in note
    assert "without supply: 5, 6" in note


# --- trace from a place of the print to its G-code lines


NO_FACES = np.empty((0, 3), dtype=np.int64)

NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0.5], [10, 0, 0.5]]),
    np.array([[0, 1]]),
    np.array([0.2]),
    np.zeros(1),
    np.zeros(1),
)


def written(start: FloatArray, end: FloatArray, line: IntArray) -> Strands:
    return Strands.dosed(start, end, np.ones(len(line)), np.arange(len(line)), line)


def defect(kind: str = "stenosis", **more: object) -> dict[str, object]:
    return {"kind": kind, "vessel": 0, "from_mm": 4.0, "to_mm": 5.0, **more}


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
