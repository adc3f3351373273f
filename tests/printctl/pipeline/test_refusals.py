"""Recipes refused before any computation, for their profiles or given network."""

from __future__ import annotations

import io
import json
import sys
from contextlib import nullcontext
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from design.errors import DesignError, ToolpathError
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from firmware_profiles import Bath, Ink, Needle, Printer, Syringe, load, supported_diameter_mm
from firmware_profiles.materials.bead import BeadSection
from printctl.checks.preflight.mounted import role_checks
from printctl.errors import RecipeError, SafetyError, UsageError
from printctl.machine.job.care import Care
from printctl.machine.process.orders import Order
from printctl.pipeline.checked_order import Plan
from printctl.pipeline.job.heads import Filled
from printctl.pipeline.printability import embedded_limits
from printctl.pipeline.refusals import refuse_before
from printctl.pipeline.running.lock import is_run_active, run_lock
from printctl.pipeline.running.run import RunOptions, design_recipe, run_recipe, toolpath_recipe
from printctl.pipeline.stages import printing
from printctl.pipeline.stages.paths import lumens
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.sections.toolpath import Embedded, Fresh
from registration.errors import ScanFileError
from sim.errors import ServeError
from tests.printctl.checks.lumens.small_gcode import BORE_MM, LAYER_MM, Strokes, gcode, tube
from tests.printctl.cli.shell import Shell
from tests.printctl.corrections.feedback.lab import TWO, recipe_of
from tests.printctl.networks import network_recipe, vessels

EMBEDDED = {"method": "embedded", "needle": "30g_50mm"}
CORDS = EMBEDDED | {"writes": "cords"}
FRESH = {"method": "fresh"}
GELATIN = {"ink": "gelatin_sacrificial", "bath": "cell_matrix"}


def network(depth_mm: float = 8.0, radius_mm: float = 0.2) -> VesselNetwork:
    """A straight, slanted vessel."""
    return vessels([[1, 3, 1], [9, 3, 1 + depth_mm]], radius=radius_mm)


def recipe(folder: Path, vessels: VesselNetwork, **parts: Any) -> Recipe:
    data = network_recipe(
        folder, vessels, (10, 6, 10), **{"toolpath": EMBEDDED, "printer": GELATIN, **parts}
    )
    return parse_recipe(data, "one.yaml")


def test_a_real_print_needs_a_real_scan(tmp_path: Path) -> None:
    """Refused before anything is made, when it would be printed; a design and rehearsal aren't."""
    data = yaml.safe_load((ROOT / "printctl" / "recipe" / "starter.yaml").read_text())
    data["printer"]["port"] = "/dev/ttyACM0"
    real = parse_recipe(data, "real.yaml")
    for how in (RunOptions(), RunOptions(until="print"), RunOptions(printed=True)):
        with pytest.raises(RecipeError, match=r"simulated scan.*ttyACM0.*scan\.file"):
            run_recipe(real, tmp_path, tmp_path / "run", Console(file=io.StringIO()), how)
    assert not (tmp_path / "run").exists()
    made = run_recipe(
        real, tmp_path, tmp_path / "run", Console(file=io.StringIO()), RunOptions(until="tissue")
    )
    assert "tissue" in made


def test_a_wrong_fault_file_is_refused_before_the_tissue(tmp_path: Path) -> None:
    data = yaml.safe_load((ROOT / "printctl" / "recipe" / "starter.yaml").read_text())
    data["printer"]["faults"] = "faults.yaml"
    (tmp_path / "faults.yaml").write_text("ink: [{fault: clogg}]\n")
    how = RunOptions(until="tissue")
    with pytest.raises(ServeError, match=r"fault file .*faults\.yaml"):
        run_recipe(
            parse_recipe(data, "r.yaml"),
            tmp_path,
            tmp_path / "run",
            Console(file=io.StringIO()),
            how,
        )
    assert not (tmp_path / "run").exists()


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
            r"needle to dish wall: .* \(vessel 0\)",
        ),
        (
            {"printer": {"ink": "alginate_fresh", "bath": "cell_matrix"}},
            network(),
            SafetyError,
            "gelation triggers missing in the bath",
        ),
        (
            {
                "toolpath": {"method": "fresh", "needle": "22g", "line_um": 320},
                "printer": {"ink": "collagen_fresh", "bath": "gelatin_support"},
            },
            network(),
            SafetyError,
            r"bore: 0.32 mm, limit 0.328 .* bore up to 0.4 mm \(23g",
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


@pytest.mark.parametrize(
    ("toolpath", "ink", "bath", "why"),
    [
        (EMBEDDED, "collagen_fresh", "cell_matrix", "solid cords, .* gelatin_sacrificial"),
        (EMBEDDED, "gelatin_sacrificial", "gelatin_support", "matrix bath .*cell_matrix"),
        (FRESH, "gelatin_sacrificial", "gelatin_support", r"structural ink \(.*collagen_fresh"),
        (FRESH, "collagen_fresh", "cell_matrix", r"support bath \(shipped: gelatin_support\)"),
        (CORDS, "gelatin_sacrificial", "cell_matrix", "use a structural ink"),
        (CORDS, "collagen_fresh", "cell_matrix", None),
        (CORDS, "collagen_fresh", "gelatin_support", None),
        (EMBEDDED, "gelatin_sacrificial", "cell_matrix", None),
    ],
)
def test_ink_and_bath_must_suit_what_is_printed(
    tmp_path: Path, toolpath: dict[str, Any], ink: str, bath: str, why: str | None
) -> None:
    made = recipe(tmp_path, network(), toolpath=toolpath, printer={"ink": ink, "bath": bath})
    with nullcontext() if why is None else pytest.raises(SafetyError, match=why):
        refuse_before(made, tmp_path)


def test_embedded_vessels_get_a_sacrificial_ink_and_a_matrix_where_none_is_named(
    tmp_path: Path,
) -> None:
    made = recipe(tmp_path, network(), printer={})
    assert (made.printer.ink, made.printer.bath) == ("gelatin_sacrificial", "cell_matrix")


def test_an_ink_without_a_role_is_a_warning(tmp_path: Path) -> None:
    unknown = load(Ink, "collagen_fresh").model_copy(update={"role": None})
    (check,) = role_checks([unknown, unknown], load(Bath, "cell_matrix"), "vessels")
    assert not check.refuses
    assert "set role in the ink profile" in check.sentence()


@pytest.mark.parametrize(
    ("module", "extra", "keys"),
    [
        ("netgen", "step", {"solid": {"formats": ["stl", "step"]}}),
        ("ngsolve", "flow3d", {"flow": {"three_d": {}}}),
        ("h5py", "scans", {"scan": {"file": "later.h5"}, "printer": {"port": "/dev/ttyACM0"}}),
    ],
)
def test_a_missing_extra_is_refused_before_anything_is_designed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, extra: str, keys: dict[str, Any]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    made = recipe(tmp_path, network(), **keys)
    with pytest.raises((DesignError, ScanFileError), match=rf"pip install 'printctl\[{extra}\]'"):
        run_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


def test_a_file_that_is_not_there_is_refused_first(tmp_path: Path) -> None:
    made = recipe(tmp_path, network(), flow={"outlets": "none.csv"})
    with pytest.raises(UsageError, match=r"none\.csv, which the recipe names, isn't there"):
        design_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


# --- printability limits of needle, bath and method
def test_a_weak_bath_limits_the_widest_vessel() -> None:
    weak = load(Bath, "cell_matrix").model_copy(
        update={"yield_stress_pa": 0.02, "density_g_cm3": 1.05}
    )
    part = Embedded(method="embedded")
    held = supported_diameter_mm(weak, load(Ink, "gelatin_sacrificial"))
    limits = embedded_limits(part, 1.0, load(Needle, part.needle), held)
    # 0.02 Pa / (0.07 × 20 kg/m³ × 9.81 m/s²)
    assert limits.widest_mm == pytest.approx(1.456, rel=1e-3)
    assert "1.46 mm, which the bath's yield stress holds" in limits.source


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
REFUSED = r"print time vs\. cell viability limit.*our protocol"


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


def context_lumens_stage(folder: Path, layers: list[Strokes], part: Fresh | Embedded) -> Any:
    (folder / "part.gcode").write_bytes(gcode(layers))
    return SimpleNamespace(
        folder=folder,
        recipe=SimpleNamespace(toolpath=part, print_scale=1.0),
        tissue=SimpleNamespace(grid=None),
        stand=SimpleNamespace(),  # as on a plate, where nothing is planned again
        printer=load(Printer, "generic_marlin"),
        syringe=SimpleNamespace(inner_mm=BORE_MM),
        ink=SimpleNamespace(
            name="ink", flow_factor=1.0, smallest_gap_mm=None, bead_section=BeadSection()
        ),
        place_mm=np.array([20.0, 30.0, 0.0]),
        start_mm=np.zeros(3),
        flow_ul_s=None,
        written_network=vessels([[0, 0, 0], [0, 0, LAYERS * LAYER_MM]], radius=0.3),
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


# --- runs that end at a given stage, and their progress for other programs
PLANAR: dict[str, Any] = {
    "schema": 1,
    "name": "planar",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
}


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(monkeypatch, capsys, "run")


def _recipe(folder: Path, **more: Any) -> Path:
    path = folder / "planar.yaml"
    path.write_text(yaml.safe_dump({**PLANAR, **more}), encoding="utf-8")
    return path


def _told(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_a_run_ends_at_the_stage_that_is_named(shell: Shell, tmp_path: Path) -> None:
    run, told = tmp_path / "run", tmp_path / "progress.jsonl"
    path = str(_recipe(tmp_path))
    command = (path, "--out", str(run), "--until", "flow", "--progress-file", str(told))
    code, out, _ = shell(*command)
    assert (code, out.splitlines()[-2]) == (0, "done as far as flow")
    assert (run / "flow.csv").is_file()
    assert not (run / "solid.stl").exists()
    steps = _told(told)
    assert steps[0]["stages"] == ["tissue", "vasculature", "flow"]
    assert [step["name"] for step in steps if step["event"] == "done"] == steps[0]["stages"]
    assert steps[-1]["event"] == "end"
    assert steps[-1]["result"] == "done"


def test_a_failed_run_says_why_in_its_last_line(shell: Shell, tmp_path: Path) -> None:
    told = tmp_path / "p.jsonl"
    path = str(_recipe(tmp_path, toolpath={"method": "fresh", "needle": "none_such"}))
    command = (path, "--out", str(tmp_path / "r"), "--until", "toolpath")
    code, _, err = shell(*command, "--progress-file", str(told))
    assert code == 2
    assert "none_such" in err
    assert _told(told)[-1]["result"] == "failed"
    assert "none_such" in _told(told)[-1]["message"]


def test_without_a_finished_print_there_is_none_to_take(shell: Shell, tmp_path: Path) -> None:
    write_network_csv(tmp_path / "two.csv", TWO)
    small = recipe_of(needle="22g", layer_um=150, line_um=400)
    path = str(_recipe(tmp_path, **small))
    code, _, err = shell(path, "--out", str(tmp_path / "r"), "--printed")
    assert code == 4
    assert "no finished print of part.gcode" in err


def test_a_design_ends_at_the_stage_that_is_named(shell: Shell, tmp_path: Path) -> None:
    run, path = tmp_path / "run", str(_recipe(tmp_path))
    shell.first = ("design",)
    code, out, _ = shell(path, "--out", str(run), "--until", "vasculature")
    assert (code, out.splitlines()[-2]) == (0, "done as far as vasculature")
    assert (run / "network.csv").is_file()
    assert not (run / "flow.csv").exists()
    code, _, err = shell(path, "--out", str(run), "--until", "flow")
    assert code == 0
    assert "unchanged" in err
    assert (run / "flow.csv").is_file()


# --- lock of a run folder
def test_a_lock_tells_whether_a_run_is_going_on(tmp_path: Path) -> None:
    assert not is_run_active(tmp_path)
    with run_lock(tmp_path):
        assert is_run_active(tmp_path)
    assert not is_run_active(tmp_path)


# --- recipe settings on print supervision reach the link process
ROOT = Path(__file__).parents[3]
GOOD = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")


def cared_recipe(care: dict[str, Any] | None, **printer: Any) -> Recipe:
    data = deepcopy(GOOD)
    data["printer"] |= printer if care is None else {"care": care, **printer}
    return parse_recipe(data, "test.yaml")


def ordered(
    care: dict[str, Any] | None, folder: Path, monkeypatch: pytest.MonkeyPatch, reloads: list[int]
) -> Order:
    """The order that the print stage gives for a recipe, without printing it."""
    plan = Plan(25.0, reload_at=tuple(reloads))
    orders: list[Order] = []
    done = SimpleNamespace(state=SimpleNamespace(value="done"), lines_done=1, proved=True)
    client = SimpleNamespace(status=SimpleNamespace(ended=True))
    monkeypatch.setattr(printing, "find_or_start", lambda order, *_: orders.append(order) or client)
    monkeypatch.setattr(printing, "follow", lambda *given: done)
    context: Any = SimpleNamespace(
        recipe=cared_recipe(care, port="simulated"),
        rehearsal_speed=None,
        folder=folder,
        printer=PRINTER,
        bath=load(Bath, "gelatin_support"),
        dish=None,
        stand=None,
        bath_depth_mm=None,
        loads=(Filled(SYRINGE, load(Ink, "collagen_fresh"), load(Needle, "fresh_150um")),),
        start_mm=np.array([100.0, 100, 20]),
        bars=None,
        printed=False,
        manifest=SimpleNamespace(stages={"dry run": SimpleNamespace(summary=plan.to_dict())}),
    )
    monkeypatch.setattr(printing, "executed_facts", lambda context: {})
    printing.work(context, lambda share, text="": None)
    return orders[0]


@pytest.mark.parametrize(
    ("key", "value", "field", "expected"),
    [
        ("checkpoint_every_s", 0, "checkpoint_s", 0.0),
        ("checkpoint_every_s", None, "checkpoint_s", None),
        ("deadman_min", 20, "deadman_s", 1200.0),
        ("silent_limit_s", 300, "silent_limit_s", 300.0),
        ("noise_limit", 60, "noise_limit", 60),
    ],
)
def test_each_choice_is_given_on(
    key: str, value: Any, field: str, expected: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ordered({key: value}, tmp_path, monkeypatch, [])
    assert getattr(order.care, field) == expected
    assert getattr(Care(), field) != expected


def test_ink_pushed_after_a_pause_and_planned_changes_are_given_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ordered({"prime_ul": 2.0, "reload": True}, tmp_path, monkeypatch, [120, 240])
    assert order.retreat.prime_mm * np.pi * SYRINGE.inner_mm**2 / 4 == pytest.approx(2.0)
    assert order.care.reload_at == (120, 240)
    assert order.retreat.lift_mm == 25.0


def test_dead_man_may_stop_the_print(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order = ordered({"deadman_min": 5, "deadman_stops": True}, tmp_path, monkeypatch, [])
    assert order.care.deadman_stops
    with pytest.raises(RecipeError, match=r"printer\.care.*deadman_min"):
        cared_recipe({"deadman_stops": True})


@pytest.mark.slow
def test_part_too_big_for_the_plunger_is_refused_or_printed_with_changes(tmp_path: Path) -> None:
    short = PRINTER.model_dump(mode="json", exclude_unset=True) | {"plunger_travel_mm": 10.0}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(short))
    profile, console = str(tmp_path / "short.yaml"), Console(quiet=True)
    with pytest.raises(SafetyError, match=r"say printer\.care\.reload: true: the syringe is then"):
        toolpath_recipe(cared_recipe({}, profile=profile), tmp_path, tmp_path / "run", console)
    data = toolpath_recipe(
        cared_recipe({"reload": True}, profile=profile), tmp_path, tmp_path / "run", console
    )
    assert len(data["dry_run"]["reload_at"]) >= 2


@pytest.mark.parametrize(
    ("care", "message"),
    [
        ({"checkpoint_every_s": -1}, r"printer\.care\.checkpoint_every_s.*-1"),
        ({"deadman_min": 2000}, r"printer\.care\.deadman_min.*1440.*2000"),
        ({"prime_ul": -0.1}, r"printer\.care\.prime_ul.*-0\.1"),
        ({"deadman": 3}, r"printer\.care\.deadman.*remove it"),
    ],
)
def test_wrong_choice_names_place_value_and_limit(care: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        cared_recipe(care)


@pytest.mark.parametrize("method", ["embedded", "fresh"])
def test_toolpath_builds_a_solid_for_layers_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell, method: str
) -> None:
    monkeypatch.chdir(tmp_path)
    printer = GELATIN if method == "embedded" else {}
    way = EMBEDDED if method == "embedded" else FRESH
    made = network_recipe(tmp_path, network(2.0, 0.4), (10, 6, 4), toolpath=way, printer=printer)
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(made))
    data = shell.of("toolpath").json("one.yaml", "--out", "one.gcode")
    assert ("solid" in data) == (method == "fresh")
    whole = shell.json("one.yaml", "--until", "lumens", "--out", "run")
    assert "solid" in whole
    assert data["toolpath"] == whole["toolpath"]


def test_a_writing_speed_that_air_overrides_is_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    monkeypatch.chdir(tmp_path)
    air = {"profile": "pneumatic_marlin", "ink": "fibrinogen_fresh", "bath": "gelatin_thrombin"}
    said = "toolpath.write_speed_mm_s (7 mm/s) isn't used for"
    for speed, times in (({"write_speed_mm_s": 7}, 1), ({}, 0)):
        way = FRESH | {"needle": "fresh_150um", "layer_um": 60, "line_um": 150} | speed
        made = network_recipe(tmp_path, network(1, 0.4), (10, 6, 3), toolpath=way, printer=air)
        (tmp_path / "one.yaml").write_text(yaml.safe_dump(made))
        code, out, err = shell.of("toolpath")("one.yaml", "--out", "one.gcode", "--json")
        assert code == 0, err
        assert " ".join(err.split()).count(said) == times
        assert len(json.loads(out)["toolpath"].get("notes", ())) == times
