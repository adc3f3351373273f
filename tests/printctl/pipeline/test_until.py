"""Runs that end at a given stage, and their progress for other programs."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from design.network_files.csv_format import write_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.errors import RecipeError, SafetyError
from printctl.machine.link.care import Care
from printctl.machine.printing import Order
from printctl.pipeline.heads import Filled
from printctl.pipeline.lock import is_run_active, run_lock
from printctl.pipeline.run import toolpath_recipe
from printctl.pipeline.stages import printing
from printctl.recipe import Recipe, parse_recipe
from tests.printctl.cli.shell import Shell
from tests.printctl.corrections.feedback.small_run import TWO, recipe_of

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
    recipe = str(_recipe(tmp_path))
    command = (recipe, "--out", str(run), "--until", "flow", "--progress-file", str(told))
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
    recipe = str(_recipe(tmp_path, toolpath={"method": "fresh", "needle": "none_such"}))
    command = (recipe, "--out", str(tmp_path / "r"), "--until", "toolpath")
    code, _, err = shell(*command, "--progress-file", str(told))
    assert code == 2
    assert "none_such" in err
    assert _told(told)[-1]["result"] == "failed"
    assert "none_such" in _told(told)[-1]["message"]


def test_without_a_finished_print_there_is_none_to_take(shell: Shell, tmp_path: Path) -> None:
    write_network_csv(tmp_path / "two.csv", TWO)
    small = recipe_of(needle="22g", layer_um=150, line_um=400)
    recipe = str(_recipe(tmp_path, **small))
    code, _, err = shell(recipe, "--out", str(tmp_path / "r"), "--printed")
    assert code == 4
    assert "no finished print of part.gcode" in err


def test_a_design_ends_at_the_stage_that_is_named(shell: Shell, tmp_path: Path) -> None:
    run, recipe = tmp_path / "run", str(_recipe(tmp_path))
    shell.first = ("design",)
    code, out, _ = shell(recipe, "--out", str(run), "--until", "vasculature")
    assert (code, out.splitlines()[-2]) == (0, "done as far as vasculature")
    assert (run / "network.csv").is_file()
    assert not (run / "flow.csv").exists()
    code, _, err = shell(recipe, "--out", str(run), "--until", "flow")
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


def recipe(care: dict[str, Any] | None, **printer: Any) -> Recipe:
    data = deepcopy(GOOD)
    data["printer"] |= printer if care is None else {"care": care, **printer}
    return parse_recipe(data, "test.yaml")


def ordered(
    care: dict[str, Any] | None, folder: Path, monkeypatch: pytest.MonkeyPatch, reloads: list[int]
) -> Order:
    """The order that the print stage gives for a recipe, without printing it."""
    orders: list[Order] = []
    done = SimpleNamespace(state=SimpleNamespace(value="done"), lines_done=1, proved=True)
    client = SimpleNamespace(status=SimpleNamespace(ended=True))
    monkeypatch.setattr(printing, "find_or_start", lambda order, _: orders.append(order) or client)
    monkeypatch.setattr(printing, "follow", lambda client, report, bars: done)
    context: Any = SimpleNamespace(
        recipe=recipe(care, port="simulated"),
        folder=folder,
        printer=PRINTER,
        syringe=SYRINGE,
        loads=(Filled(SYRINGE, load(Ink, "collagen_fresh"), load(Needle, "fresh_150um")),),
        lift_mm=8.0,
        start_mm=np.array([100.0, 100, 20]),
        bars=None,
        printed=False,
        manifest=SimpleNamespace(
            stages={"dry run": SimpleNamespace(summary={"reload_at": reloads})}
        ),
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


def test_dead_man_may_stop_the_print(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order = ordered({"deadman_min": 5, "deadman_stops": True}, tmp_path, monkeypatch, [])
    assert order.care.deadman_stops
    with pytest.raises(RecipeError, match=r"printer\.care.*deadman_min"):
        recipe({"deadman_stops": True})


@pytest.mark.slow
def test_part_too_big_for_the_plunger_is_refused_or_printed_with_changes(tmp_path: Path) -> None:
    short = PRINTER.model_dump(mode="json", exclude_unset=True) | {"plunger_travel_mm": 10.0}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(short))
    profile, console = str(tmp_path / "short.yaml"), Console(quiet=True)
    with pytest.raises(SafetyError, match=r"say printer\.care\.reload: true: the syringe is then"):
        toolpath_recipe(recipe({}, profile=profile), tmp_path, tmp_path / "run", console)
    data = toolpath_recipe(
        recipe({"reload": True}, profile=profile), tmp_path, tmp_path / "run", console
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
        recipe(care)
