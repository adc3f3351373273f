"""Recipes refused before any computation, for their profiles or given network."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from design.errors import SolidError, ToolpathError
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from firmware_profiles import Bath, Ink, Needle, Printer, load
from firmware_profiles.bead import BeadSection
from kernels.arrays import FloatArray, IntArray
from printctl.errors import SafetyError, UsageError
from printctl.pipeline.printability import printability
from printctl.pipeline.run import design_recipe, toolpath_recipe
from printctl.pipeline.stages import lumens
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.making import Embedded, Fresh
from sim.gcode.deposit.strands import Strands
from tests.printctl.checks.lumens.small_gcode import BORE_MM, LAYER_MM, Strokes, gcode, tube
from tests.printctl.corrections.feedback.small_run import TWO, recipe_of

EMBEDDED = {"method": "embedded", "needle": "30g_50mm"}
GELATIN = {"ink": "gelatin_sacrificial", "bath": "cell_matrix"}


def network(depth_mm: float = 8.0, radius_mm: float = 0.2) -> VesselNetwork:
    """A straight, slanted vessel."""
    return VesselNetwork.from_segments(
        np.array([[1.0, 3, 1], [9, 3, 1 + depth_mm]]),
        np.array([[0, 1]]),
        np.full(1, radius_mm),
        np.zeros(1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )


def recipe(folder: Path, vessels: VesselNetwork, **parts: Any) -> Recipe:
    write_network_csv(folder / "net.csv", vessels)
    data = {
        "schema": 1,
        "name": "one",
        "tissue": {"shape": "block", "size_mm": [10, 6, 10]},
        "vasculature": {"network": "net.csv", "unit": "mm"},
        "toolpath": EMBEDDED,
        "printer": GELATIN,
        **parts,
    }
    return parse_recipe(data, "one.yaml")


@pytest.mark.parametrize(
    ("parts", "vessels", "error", "why"),
    [
        (
            {},
            network(radius_mm=0.06),
            ToolpathError,
            r"diameter 0\.120 mm at \(1, 3, 1\) mm is thinner",
        ),
        (
            {"toolpath": {"method": "fresh"}, "printer": {}},
            network(radius_mm=0.06),
            ToolpathError,
            r"vessel 0: lumen of 0\.120 mm is narrower",
        ),
        (
            {"printer": {**GELATIN, "place_mm": [195, 50, 1]}},
            network(),
            SafetyError,
            "greatest x of the network: 204 mm, limit 200",
        ),
        (
            {"toolpath": {"method": "fresh"}, "printer": {"place_mm": [195, 50, 1]}},
            network(),
            SafetyError,
            "greatest x of the part: 205 mm, limit 200",
        ),
        (
            {"print_scale": 30.0, "toolpath": {**EMBEDDED, "needle": "18g"}},
            network(depth_mm=1.0),
            SafetyError,
            "length of the network in x: 240 mm, limit 200",
        ),
        (
            {
                "printer": {
                    **GELATIN,
                    "dish": "petri_35mm",
                    "dish_centre_mm": [100, 100],
                    "place_mm": [110, 97, 1],
                }
            },
            network(depth_mm=2.0),
            SafetyError,
            r"needle to the dish's wall: .* \(vessel 0\)",
        ),
        (
            {"printer": {"ink": "alginate_fresh", "bath": "cell_matrix"}},
            network(),
            SafetyError,
            "what sets the ink and the bath lacks",
        ),
        (
            {
                "toolpath": {"method": "fresh", "needle": "22g", "line_um": 320},
                "printer": {"ink": "collagen_fresh", "bath": "gelatin_support"},
            },
            network(),
            SafetyError,
            r"bore: 0.32 mm, limit 0.328 .* of at most 0.4 mm bore \(23g",
        ),
    ],
)
def test_a_part_that_cannot_be_printed_is_refused_before_it_is_designed(
    parts: dict[str, Any], vessels: VesselNetwork, error: type[Exception], why: str, tmp_path: Path
) -> None:
    made = recipe(tmp_path, vessels, **parts)
    with pytest.raises(error, match=why):
        toolpath_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


def test_step_without_its_extra_is_refused_before_anything_is_designed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "netgen", None)
    made = recipe(tmp_path, network(), solid={"formats": ["stl", "step"]})
    with pytest.raises(SolidError, match=r"pip install 'printctl\[step\]'"):
        design_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


def test_a_file_that_is_not_there_is_refused_first(tmp_path: Path) -> None:
    made = recipe(tmp_path, network(), flow={"outlets": "none.csv"})
    with pytest.raises(UsageError, match=r"none\.csv, which the recipe names, isn't there"):
        design_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


# --- printability limits of needle, bath and method
def context(part: Embedded | Fresh, print_scale: float = 1.0, **bath: float) -> Any:
    """As much of a run's context as is asked."""
    ink = load(Ink, "gelatin_sacrificial")
    return SimpleNamespace(
        recipe=SimpleNamespace(toolpath=part, print_scale=print_scale),
        needle=load(Needle, part.needle),
        ink=ink,
        bath=load(Bath, "cell_matrix").model_copy(update=bath),
    )


def test_a_weak_bath_limits_the_widest_vessel() -> None:
    weak = context(Embedded(method="embedded"), yield_stress_pa=0.02, density_g_cm3=1.05)
    limits = printability(weak)
    # 0.02 Pa / (0.07 × 20 kg/m³ × 9.81 m/s²)
    assert limits.widest_mm == pytest.approx(1.456, rel=1e-3)
    assert "1.46 mm, which the bath's yield stress holds" in limits.says


# --- print time against cell lifetime, and ink use, on a complete simulated job
def dry_run(folder: Path, **care: Any) -> dict[str, Any]:
    write_network_csv(folder / "two.csv", TWO)
    recipe = recipe_of(needle="22g", layer_um=150, line_um=400) | {"printer": {"care": care}}
    found = toolpath_recipe(
        parse_recipe(recipe, "test"), folder, folder, Console(file=io.StringIO())
    )
    summary: dict[str, Any] = found["dry_run"]
    return summary


SAID = {"viability_source": "our protocol"}
REFUSED = r"print time, of what the cells have.*our protocol"


def test_a_print_longer_than_its_cells_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SafetyError, match=REFUSED):
        dry_run(tmp_path, viability_min=0.5, **SAID)


@pytest.mark.slow
def test_a_print_as_long_as_half_its_cells_time_is_taken_as_long_as_twice_refused(
    tmp_path: Path,
) -> None:
    long = dry_run(tmp_path, viability_min=1000, **SAID)
    assert long["time_the_cells_have"] == "1000 min (our protocol)"
    minutes = long["print_time_s"] / 60
    assert long["changes_of_syringe"] == 0
    assert minutes > 0.5
    dry_run(tmp_path, viability_min=2 * minutes, **SAID)
    with pytest.raises(SafetyError, match=REFUSED):
        dry_run(tmp_path, viability_min=minutes / 2, **SAID)


@pytest.mark.slow
def test_ink_is_told_with_what_stays_behind(tmp_path: Path) -> None:
    found = dry_run(tmp_path)
    assert "not known" in found["time_the_cells_have"]
    # 20 µL of the syringe, and the bore of a 22G needle of half an inch.
    assert found["ink_left_per_filling_ul"] == pytest.approx(21.68, abs=0.01)
    assert found["ink_needed_ul"] == pytest.approx(
        found["ink_pushed_ul"] + found["ink_left_per_filling_ul"], abs=2e-3
    )
    assert found["fillings"] == 1


# --- pipeline stage that checks lumens in the G-code
LAYERS = 8
NONE = np.zeros(1, dtype=np.int64)


def context_lumens_stage(folder: Path, layers: list[Strokes], part: Fresh | Embedded) -> Any:
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
    return lumens.work(context_lumens_stage(folder, layers, part), lambda *_: None)


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
    said = context_lumens_stage(
        tmp_path, [tube(0.3)] * 2, Embedded(method="embedded", leave_out=True)
    )
    left = {"vessel": 0, "other": 7, "place_mm": [1.0, 2.0, 3.5], "apart_mm": 0.1, "needle_mm": 0.0}
    plan = {"left_out": [left], "cut_off": [5, 6]}
    said.manifest.stages["toolpath"] = SimpleNamespace(summary={"plan": plan})
    found, _ = lumens.work(said, lambda *_: None)
    assert found["passed"]
    note = next(text for text in found["notes"] if "leave_out" in text)
    assert "vessel 0 (too near to vessel 7 at (1.00, 2.00, 3.50) mm)" in note
    assert "without supply: 5, 6" in note


# --- trace from a place of the print to its G-code lines
def written(start: FloatArray, end: FloatArray, line: IntArray) -> Strands:
    return Strands.dosed(start, end, np.ones(len(line)), np.arange(len(line)), line)
