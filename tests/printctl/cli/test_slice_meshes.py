"""`printctl slice` of several meshes and modifiers: heads and infill per region."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold

from design.solids import write_stl
from printctl.cli.main import main
from tests.design.toolpath.shapes import as_solid, block

OFFSET_MM = 40.0
"""Of the second head of two_syringe_marlin, along x."""
BORE_MM2 = np.pi / 4 * 4.61**2
TWO = ("--printer", "two_syringe_marlin", "--dish", "petri_60mm")


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["printctl", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def rod(radius: float, sides: int) -> Manifold:
    return Manifold.cylinder(2.0, radius, radius, sides).translate([3.0, 2.0, -0.5])


@pytest.fixture
def assembly(tmp_path: Path) -> list[str]:
    """A block with a hole, a lining in it whose outside was made of other triangles, a core."""
    body = block(6, 4, 0.36) - rod(0.9, 96)
    lining = (rod(0.9, 67) - rod(0.4, 96)) ^ block(6, 4, 0.36)
    core = block(1, 1, 1).translate([4.5, 0.5, -0.3])
    paths = []
    for name, made in (("body", body), ("lining", lining), ("core", core)):
        write_stl(tmp_path / f"{name}.stl", as_solid(made))
        paths.append(str(tmp_path / f"{name}.stl"))
    return paths


def written(gcode: str) -> list[np.ndarray]:
    """Of each head, rows of x, y of the middle, length and volume of its lines."""
    head, at, found = 0, np.zeros(4), [[], []]
    for line in gcode.splitlines():
        words = {axis: float(value) for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", line)}
        new = at.copy()
        new[["XYZE".index(axis) for axis in words]] = list(words.values())
        if chosen := re.match(r"T(\d)", line):
            head = int(chosen[1])
        elif line.startswith("G92"):
            at = new
        elif re.match(r"G[01]\b", line):
            way = float(np.hypot(*(new - at)[:2]))
            if way > 1e-6 and new[3] > at[3]:
                middle = (new + at)[:2] / 2 + [head * OFFSET_MM, 0]
                found[head].append([*middle, way, (new[3] - at[3]) * BORE_MM2])
            at = new
    return [np.array(rows).reshape(-1, 4) for rows in found]


def test_each_mesh_is_written_by_its_own_head_within_itself(
    assembly: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "part.gcode"
    inks = ("--ink", "collagen_fresh,gelatin_sacrificial")
    words = ("slice", *assembly[:2], "--unit", "mm", "--out", str(out), *TWO, *inks, "--json")
    assert run(monkeypatch, *words) == 0
    told = json.loads(capsys.readouterr().out)
    outer, inner = written(out.read_text())
    centre = np.array(told["place_mm"][:2]) + [3.0, 2.0]
    away = np.hypot(*(inner[:, :2] - centre).T)
    # Half a line inside the lining's walls, but for the 67-gon's own sag of 1 µm.
    assert 0.4 + 0.06 < away.min() < away.max() < 0.9 - 0.06
    assert np.hypot(*(outer[:, :2] - centre).T).min() > 0.9 + 0.06
    lining = np.pi * (0.9**2 - 0.4**2) * 0.36
    block_ul = 6 * 4 * 0.36 - np.pi * 0.9**2 * 0.36
    assert inner[:, 3].sum() == pytest.approx(lining, rel=0.02)
    assert outer[:, 3].sum() == pytest.approx(block_ul, rel=0.02)
    assert [one["head"] for one in told["meshes"]] == [0, 1]
    assert [one["written_ul"] for one in told["heads"]] == pytest.approx(
        [outer[:, 3].sum(), inner[:, 3].sum()], rel=0.005
    )


def test_meshes_of_one_head_close_the_gap_between_their_triangles(
    assembly: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One ink: no wall along the border, so no place of it stays without a line."""
    out = tmp_path / "part.gcode"
    assert run(monkeypatch, "slice", *assembly[:2], "--unit", "mm", "--out", str(out)) == 0
    rows, none = written(out.read_text())
    assert not len(none)
    whole = 6 * 4 * 0.36 - np.pi * 0.4**2 * 0.36
    assert rows[:, 3].sum() == pytest.approx(whole, rel=0.02)
    near = np.abs(np.hypot(*(rows[:, :2] - [100.0, 100.0]).T) - 0.9) < 0.15
    # Pieces of a polygon are short, lines of infill are not; walls would be 2 times 34 mm long.
    assert rows[near & (rows[:, 2] < 0.3), 2].sum() < 2.0


def test_a_modifier_s_filling_holds_inside_it_alone(
    assembly: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, thinned = tmp_path / "plain.gcode", tmp_path / "thinned.gcode"
    words = ("slice", assembly[0], "--unit", "mm", "--out")
    core = f"{assembly[2]}:infill-percent=25,infill-angles=45"
    assert run(monkeypatch, *words, str(plain)) == 0
    assert run(monkeypatch, *words, str(thinned), "--modifier", core) == 0
    all_over, (rows, _) = written(plain.read_text())[0], written(thinned.read_text())
    assert all_over[:, 3].sum() - rows[:, 3].sum() == pytest.approx(0.75 * 0.36, rel=0.25)
    inside = (np.abs(rows[:, :2] - [102.0, 99.0]) < 0.5).all(axis=1)
    long = rows[:, 2] > 0.6
    # Three slanted lines a layer in the core; elsewhere those along x and y.
    assert 6 <= (inside & long).sum() <= 36
    assert rows[~inside, 3].sum() == pytest.approx(all_over[:, 3].sum() - 0.36, rel=0.02)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--heads", "0,2"), "has no head 2, only 0 to 1"),
        (("--heads", "0"), "names 1, for 2 meshes"),
        (("--line-um", "150,5"), "--line-um 5 lies outside 10 to 5000"),
        (("--ink", "collagen_fresh,collagen_fresh,collagen_fresh"), "names 3"),
        (("--modifier", "core.stl"), "doesn't say what it changes"),
        (("--modifier", "core.stl:walls=3"), "'walls' can't be changed in a place"),
        (("--modifier", "core.stl:infill-percent=120"), "must be a number within 0 to 100"),
        (("--modifier", "core.stl:head=2"), "the printer has 2, counted from 0"),
        (("--modifier", "core.stl:infill-angles=45/nan"), "write degrees, layer after layer"),
    ],
)
def test_what_can_t_be_is_refused_with_its_remedy(
    assembly: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, str],
    said: str,
) -> None:
    out = tmp_path / "part.gcode"
    known = ("slice", *assembly[:2], "--unit", "mm", "--out", str(out), *TWO)
    assert run(monkeypatch, *known, *words) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


def test_a_modifier_beside_the_part_is_refused(
    assembly: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    away = tmp_path / "away.stl"
    write_stl(away, as_solid(block(1, 1, 1).translate([20, 0, 0])))
    known = ("slice", assembly[0], "--unit", "mm", "--out", str(tmp_path / "part.gcode"))
    assert run(monkeypatch, *known, "--modifier", f"{away}:infill-percent=10") == 2
    assert "lies outside of the part (x 20 to 21" in " ".join(capsys.readouterr().err.split())


def test_lumens_reads_what_each_head_s_own_syringe_pushes(
    assembly: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The lining's head holds another syringe: by the first one's bore the lumen would close in."""
    out, whole = tmp_path / "part.gcode", tmp_path / "whole.stl"
    write_stl(whole, as_solid(block(6, 4, 0.36) - rod(0.4, 96)))
    syringes = ("--syringe", "hamilton_1ml,hamilton_2_5ml")
    known = ("slice", *assembly[:2], "--unit", "mm", "--out", str(out), *TWO, *syringes)
    assert run(monkeypatch, *known) == 0
    capsys.readouterr()
    words = ("lumens", str(out), "--model", str(whole), "--unit", "mm", *TWO[:2], *syringes)
    assert run(monkeypatch, *words, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["passed"]
    assert told["lumens"][0]["narrowest_mm"] == pytest.approx(0.8, abs=0.01)
