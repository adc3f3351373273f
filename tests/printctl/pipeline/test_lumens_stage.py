"""Pipeline stage that checks lumens in the G-code."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from design.network import VesselNetwork
from firmware_profiles import Printer, load
from firmware_profiles.bead import BeadSection
from kernels.arrays import FloatArray, IntArray
from printctl.errors import SafetyError
from printctl.pipeline.stages import lumens
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
NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0.5], [10, 0, 0.5]]),
    np.array([[0, 1]]),
    np.array([0.2]),
    np.zeros(1),
    np.zeros(1),
)


def written(start: FloatArray, end: FloatArray, line: IntArray) -> Strands:
    return Strands.dosed(start, end, np.ones(len(line)), np.arange(len(line)), line)
