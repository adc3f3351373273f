"""Runs that end at a given stage, and their progress for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from design.network_files.csv_format import write_network_csv
from printctl.pipeline.lock import is_run_active, run_lock
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
