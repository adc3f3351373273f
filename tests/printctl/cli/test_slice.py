"""`printctl slice`: from a mesh file to G-code that passes the simulation."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from design.solids import block_solid, write_3mf, write_stl
from firmware_profiles import Printer, load
from printctl.cli.main import main
from sim.gcode.dry_run.run import dry_run


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["printctl", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_a_mesh_becomes_checked_gcode_in_the_middle_of_the_bed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model, out = tmp_path / "cube.stl", tmp_path / "cube.gcode"
    write_stl(model, block_solid(np.array([3.0, 2.0, 0.6]), np.array([40.0, 50.0, 7.0])))
    assert run(monkeypatch, "slice", str(model), "--unit", "mm", "--out", str(out), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["layers"] == 10
    assert told["written_ul"] == pytest.approx(3.6, rel=0.02)
    program = dry_run(out.read_bytes(), load(Printer, "generic_marlin"), (100.0, 100.0, 5.6))
    made = program.executed
    moved = np.linalg.norm(made.end - made.start, axis=1) > 0
    written = made.end[(made.plunger_end > made.plunger_start) & moved]
    low, high = written[:, :2].min(axis=0), written[:, :2].max(axis=0)
    assert (low + high) / 2 == pytest.approx([100.0, 100.0], abs=0.02)
    assert high - low == pytest.approx([2.85, 1.85], abs=0.03)
    with np.load(tmp_path / "cube.map.npz") as lines:
        assert lines["source"].max() == 9


def test_a_3mf_says_its_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, out = tmp_path / "cube.3mf", tmp_path / "cube.gcode"
    write_3mf(model, block_solid(np.array([3.0, 2.0, 0.6])))
    assert run(monkeypatch, "slice", str(model), "--out", str(out)) == 0
    assert out.stat().st_size > 1000


def test_a_syringe_too_small_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model, out = tmp_path / "cube.stl", tmp_path / "cube.gcode"
    write_stl(model, block_solid(np.array([20.0, 20.0, 3.0])))
    words = ["slice", str(model), "--unit", "mm", "--out", str(out), "--layer-um", "300"]
    assert run(monkeypatch, *words, "--line-um", "600") == 0
    assert "more than Hamilton" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["cube.stl", "./cube.stl"])
def test_a_mesh_is_never_written_over(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_stl(tmp_path / "cube.stl", block_solid(np.array([3.0, 2.0, 0.6])))
    before = (tmp_path / "cube.stl").read_bytes()
    assert run(monkeypatch, "slice", "cube.stl", "--unit", "mm", "--out", name) == 2
    assert "is what this command reads; give another name" in capsys.readouterr().err
    assert (tmp_path / "cube.stl").read_bytes() == before


@pytest.mark.parametrize(
    ("height", "told"),
    [
        (0.2, "0.2 mm high and its 3 layers 0.18 mm: 0.02 mm less than designed"),
        (1.0, "1 mm high and its 17 layers 1.02 mm: 0.02 mm more than designed"),
        (0.6, ""),
    ],
)
def test_a_height_that_layers_cant_make_is_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    height: float,
    told: str,
) -> None:
    model, out = tmp_path / "flat.stl", tmp_path / "flat.gcode"
    write_stl(model, block_solid(np.array([3.0, 2.0, height])))
    assert run(monkeypatch, "slice", str(model), "--unit", "mm", "--out", str(out)) == 0
    said = capsys.readouterr().err
    assert told in said
    assert bool(told) == ("than designed" in said)
