"""`printctl slice`: from a mesh file to G-code that passes the simulation."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold

from design.solids import Solid, block_solid, write_3mf, write_stl
from firmware_profiles import Printer, load
from gcode.dry_run.run import dry_run
from tests.design.toolpath.shapes import as_solid, block
from tests.printctl.cli.shell import Shell

UNIT = ("--unit", "mm")


@pytest.fixture
def cut(shell: Shell) -> Shell:
    """Slices in a folder with a box of 3 by 2 by 0.6 mm."""
    write_stl(Path("cube.stl"), block_solid(np.array([3.0, 2.0, 0.6])))
    return shell.of("slice")


def test_a_mesh_becomes_checked_gcode_in_the_middle_of_the_bed(cut: Shell) -> None:
    write_stl(Path("far.stl"), block_solid(np.array([3.0, 2.0, 0.6]), np.array([40.0, 50.0, 7.0])))
    told = cut.json("far.stl", *UNIT, "--out", "far.gcode")
    assert told["layers"] == 10
    assert told["written_ul"] == pytest.approx(3.6, rel=0.02)
    job = Path("far.gcode").read_bytes()
    made = dry_run(job, load(Printer, "generic_marlin"), (100.0, 100.0, 5.6)).executed
    moved = np.linalg.norm(made.end - made.start, axis=1) > 0
    written = made.end[(made.plunger_end > made.plunger_start) & moved]
    low, high = written[:, :2].min(axis=0), written[:, :2].max(axis=0)
    assert (low + high) / 2 == pytest.approx([100.0, 100.0], abs=0.02)
    assert high - low == pytest.approx([2.85, 1.85], abs=0.03)
    with np.load("far.map.npz") as lines:
        assert lines["source"].max() == 9


def test_a_part_stands_at_the_floor_clearance_of_its_bath_or_where_it_is_placed(cut: Shell) -> None:
    assert cut.json("cube.stl", *UNIT, "--out", "cube.gcode")["place_mm"] == [98.5, 99.0, 1.0]
    placed = cut.json("cube.stl", *UNIT, "--out", "cube.gcode", "--place", "50,60,2.5")
    assert placed["place_mm"] == [50.0, 60.0, 2.5]
    lines = Path("cube.gcode").read_text()
    assert min(float(z) for z in re.findall(r"Z([\d.]+)", lines)) == pytest.approx(2.56)


def test_a_place_out_of_reach_is_refused_with_one_that_is_not(cut: Shell) -> None:
    said = "puts the part at x 199 to 202 mm, .* 0 to 200 mm; --place 98.5,99,1 centres it"
    _, _, err = cut("cube.stl", *UNIT, "--out", "cube.gcode", "--place", "199,60,2.5")
    assert re.search(said, err)


@pytest.mark.parametrize(
    ("option", "command"),
    [
        ("--unit", "slice cube.stl --out a.gcode"),
        ("--unit", "lumens a.gcode --model cube.stl --filament-mm 1.75"),
        ("--unit", "view a.gcode --model cube.stl --filament-mm 1.75 --no-open"),
        ("--unit", "flow fork.csv"),
        ("--unit", "convert fork.csv fork.json"),
        ("--tissue-unit", "view fork.csv --unit mm --tissue cube.stl --no-open"),
        ("--tissue-unit", "measure fork.csv --unit mm --tissue cube.stl"),
    ],
)
def test_a_missing_unit_is_asked_for_in_one_way(
    option: str, command: str, cut: Shell, shell: Shell
) -> None:
    Path("a.gcode").write_text("G1 X1 Y1 Z0.2 E1\nG1 X9 E2\n")
    Path("fork.csv").write_text(HEADER + FORK)
    said = f"doesn't say the unit of its coordinates; give {option}, one of um, mm, cm, m, in"
    shell.refuses(said, *command.split())


def test_a_3mf_says_its_unit(cut: Shell) -> None:
    write_3mf(Path("cube.3mf"), block_solid(np.array([3.0, 2.0, 0.6])))
    assert cut("cube.3mf", "--out", "cube.gcode")[0] == 0
    assert Path("cube.gcode").stat().st_size > 1000


@pytest.mark.parametrize(
    ("shells", "part_ul", "common_ul"),
    [
        ([(0, 4), (0, 4)], 4 * 4 * 1.2, 19.2),
        ([(0, 4), (2, 4)], 6 * 4 * 1.2, 2 * 4 * 1.2),
        ([(0, 4), (4.5, 4)], 2 * 4 * 4 * 1.2, 0),
        ([(0, 4), (0, 4), (1, 1, -1), (1, 1, -1)], 4 * 4 * 1.2 - 0.6, 19.2 - 0.6),
        ([(0, 4), (1, 2, -1), (1.5, 1)], (16 - 4 + 1) * 0.6 + 16 * 0.6, 0),
    ],
)
def test_bodies_that_overlap_count_once_and_are_told(cut, shells, part_ul, common_ul):
    """Boxes by where they begin in x and how long they are; those turned inward are cavities."""
    solids = []
    for first, side, *inward in shells:
        half = 0.5 if side < 4 else 1.0
        corner = (first, 2 - side / 2, 0.6 * (1 - half))
        solids.append((block_solid((side, side, 1.2 * half), corner), bool(inward)))
    corners = np.vstack([one.vertices for one, _ in solids])
    faces = [
        (one.faces[:, ::-1] if inward else one.faces) + 8 * k
        for k, (one, inward) in enumerate(solids)
    ]
    write_stl(Path("bodies.stl"), Solid(corners, np.vstack(faces).astype(np.int32)))
    job = ("bodies.stl", *UNIT, "--out", "b.gcode", "--layer-um", "150", "--line-um", "250")
    told = cut.json(*job)
    assert told["part_ul"] == pytest.approx(part_ul, rel=1e-4)
    assert told["unfilled_percent"] < 5
    _, _, err = cut(*job)
    err = " ".join(err.split())
    assert ("overlap or occur twice" in err) == (common_ul > 0)
    assert common_ul == 0 or f"({common_ul:.4g} µL in common)" in err


def test_a_syringe_too_small_is_told(cut: Shell) -> None:
    write_stl(Path("large.stl"), block_solid(np.array([20.0, 20.0, 3.0])))
    coarse = ("--layer-um", "300", "--line-um", "600")
    code, _, err = cut("large.stl", *UNIT, "--out", "large.gcode", *coarse)
    assert code == 0
    assert "more than Hamilton" in err


@pytest.mark.parametrize("name", ["cube.stl", "./cube.stl"])
def test_a_mesh_is_never_written_over(cut: Shell, name: str) -> None:
    before = Path("cube.stl").read_bytes()
    said = "is what this command reads; give another name"
    cut.refuses(said, "cube.stl", *UNIT, "--out", name)
    assert Path("cube.stl").read_bytes() == before


@pytest.mark.parametrize(
    ("height", "told"),
    [
        (0.2, "0.2 mm high and its 3 layers 0.18 mm: 0.02 mm less than designed"),
        (1.0, "1 mm high and its 17 layers 1.02 mm: 0.02 mm more than designed"),
        (0.6, ""),
    ],
)
def test_a_height_that_layers_cant_make_is_told(cut: Shell, height: float, told: str) -> None:
    write_stl(Path("flat.stl"), block_solid(np.array([3.0, 2.0, height])))
    code, _, said = cut("flat.stl", *UNIT, "--out", "flat.gcode")
    assert code == 0
    assert told in said
    assert bool(told) == ("than designed" in said)


# --- `printctl slice --thinnest-layer-um`: adaptive layer heights in the file


@pytest.fixture
def sliced(tmp_path: Path, shell: Shell) -> bytes:
    """A foot with upright walls, a part of 50° above it, and a gap of 0.3 mm below its cap."""
    away = np.tan(np.radians(50.0))
    corners = [(x, y, 0.36) for x in (0, 3) for y in (0, 2)]
    corners += [(x, y, 0.96) for x in (0, 3 + 0.6 * away) for y in (0, 2)]
    body = block(3, 2, 0.36) + as_hull(corners) + block(3, 2, 0.3).translate([0, 0, 1.26])
    write_stl(tmp_path / "part.stl", as_solid(body))
    words = (*UNIT, "--out", "part.gcode", "--thinnest-layer-um", "20")
    code, out, _ = shell("slice", "part.stl", *words)
    assert code == 0
    assert "layers of 25 to 60 µm" in out
    return (tmp_path / "part.gcode").read_bytes()


def as_hull(corners: list[tuple[float, float, float]]) -> Manifold:
    return Manifold.hull_points(np.array(corners, dtype=float))


def test_each_layer_says_its_height_before_it_is_written(sliced: bytes) -> None:
    """By a reader of this test's own: from tip's height to tip's height where ink lies below."""
    said, z, e, top, found = np.nan, 0.0, 0.0, 0.0, []
    for line in sliced.decode().splitlines():
        words = {axis: float(value) for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", line)}
        if line.startswith(";HEIGHT:"):
            said = float(line[8:])
        elif line.startswith("G1") and "X" in words and words.get("E", e) > e and z > top:
            found.append((z, said))
            top = z
        z = words.get("Z", z)
        e = words.get("E", e)
    tops, heights = np.array(found).T
    assert heights[0] == pytest.approx(0.06)
    assert tops[0] == pytest.approx(1.0 + heights[0])  # above the floor's clearance
    gaps = np.diff(tops)
    below_cap = int(np.argmax(gaps))
    assert gaps[below_cap] > 0.3
    assert np.delete(gaps, below_cap) == pytest.approx(np.delete(heights[1:], below_cap))
    assert heights[below_cap + 1] == pytest.approx(0.06)


# --- `printctl slice` of several meshes and modifiers: heads and infill per region
OFFSET_MM = 40.0
"""Of the second head of two_syringe_marlin, along x."""
BORE_MM2 = np.pi / 4 * 4.61**2
TWO = ("--printer", "two_syringe_marlin", "--dish", "petri_60mm")


def rod(radius: float, sides: int) -> Manifold:
    return Manifold.cylinder(2.0, radius, radius, sides).translate([3.0, 2.0, -0.5])


@pytest.fixture
def assembly(cut: Shell) -> list[str]:
    """A block with a hole, a lining in it whose outside was made of other triangles, a core."""
    body = block(6, 4, 0.36) - rod(0.9, 96)
    lining = (rod(0.9, 67) - rod(0.4, 96)) ^ block(6, 4, 0.36)
    core = block(1, 1, 1).translate([4.5, 0.5, -0.3])
    for name, made in (("body", body), ("lining", lining), ("core", core)):
        write_stl(Path(f"{name}.stl"), as_solid(made))
    return ["body.stl", "lining.stl", "core.stl"]


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
    assembly: list[str], cut: Shell
) -> None:
    inks = ("--ink", "collagen_fresh,gelatin_sacrificial")
    told = cut.json(*assembly[:2], *UNIT, "--out", "part.gcode", *TWO, *inks)
    outer, inner = written(Path("part.gcode").read_text())
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
    assembly: list[str], cut: Shell
) -> None:
    """One ink: no wall along the border, so no place of it stays without a line."""
    assert cut(*assembly[:2], *UNIT, "--out", "part.gcode")[0] == 0
    rows, none = written(Path("part.gcode").read_text())
    assert not len(none)
    whole = 6 * 4 * 0.36 - np.pi * 0.4**2 * 0.36
    assert rows[:, 3].sum() == pytest.approx(whole, rel=0.02)
    near = np.abs(np.hypot(*(rows[:, :2] - [100.0, 100.0]).T) - 0.9) < 0.15
    # Pieces of a polygon are short, lines of infill are not; walls would be 2 times 34 mm long.
    assert rows[near & (rows[:, 2] < 0.3), 2].sum() < 2.0


def test_a_modifier_s_filling_holds_inside_it_alone(assembly: list[str], cut: Shell) -> None:
    words = (assembly[0], *UNIT, "--out")
    core = f"{assembly[2]}:infill-percent=25,infill-angles=45"
    assert cut(*words, "plain.gcode")[0] == 0
    assert cut(*words, "thinned.gcode", "--modifier", core)[0] == 0
    all_over, _ = written(Path("plain.gcode").read_text())
    rows, _ = written(Path("thinned.gcode").read_text())
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
        (("--thinnest-layer-um", "2"), "--thinnest-layer-um"),
    ],
)
def test_what_can_t_be_is_refused_with_its_remedy(
    assembly: list[str], cut: Shell, words: tuple[str, str], said: str
) -> None:
    cut.refuses(said, *assembly[:2], *UNIT, "--out", "part.gcode", *TWO, *words)
    assert not Path("part.gcode").exists()


def test_a_thinnest_layer_as_high_as_the_highest_is_refused(cut: Shell) -> None:
    words = ("cube.stl", *UNIT, "--out", "a.gcode", "--thinnest-layer-um", "60")
    cut.refuses("must be at least a step lower", *words, code=1)
    assert not Path("a.gcode").exists()


def test_lumens_reads_what_each_head_s_own_syringe_pushes(assembly: list[str], cut: Shell) -> None:
    """The lining's head holds another syringe: by the first one's bore the lumen would close in."""
    write_stl(Path("whole.stl"), as_solid(block(6, 4, 0.36) - rod(0.4, 96)))
    syringes = ("--syringe", "hamilton_1ml,hamilton_2_5ml")
    assert cut(*assembly[:2], *UNIT, "--out", "part.gcode", *TWO, *syringes)[0] == 0
    words = ("part.gcode", "--model", "whole.stl", *UNIT, *TWO[:2], *syringes)
    told = cut.of("lumens").json(*words)
    assert told["passed"]
    assert told["lumens"][0]["narrowest_mm"] == pytest.approx(0.8, abs=0.01)


# --- `printctl view FILE.gcode`, in an empty directory
THREE_LAYERS = """G21
G90
M82
G92 X0 Y0 Z9 E0
G0 Z0.1 F600
G1 X10 E0.01 F1200
G0 Z0.2
G1 X0 E0.02
G0 Z0.3
G1 X10 E0.03
"""
PNEUMATIC = """G92 X0 Y0 Z9
G0 Z0.1 F600
M106 P0 S255
G1 X10
M106 P0 S0
G0 Z0.2
M106 P0 S255
G1 X0
M106 P0 S0
"""


def test_a_page_stands_beside_the_file(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "part.gcode").write_text(THREE_LAYERS)
    code, out, err = shell("view", "part.gcode", "--no-open")
    assert code == 0
    assert out.startswith("part.view.html (")
    assert "4.61 mm" in err
    assert "Hamilton" in err
    text = (tmp_path / "part.view.html").read_text(encoding="utf-8")
    assert '"first":{"layer":1,' in text


@pytest.mark.parametrize("to", ["--out=a.html", "--png=a.png"])
def test_one_level_behind_a_line_that_cant_be_read_is_shown(shell: Shell, to: str) -> None:
    text = 'G21\nG90\nM82\nM862.3 P "MK3S"\nG1 Z0.3 F120\nG1 X10 Y10 F600\nG1 X30 E1 F300\n'
    Path("part.gcode").write_text(text)
    notes = shell.json("view", "part.gcode", "--no-open", to)["notes"]
    assert "line 4: 'M862.3 P" in notes[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--filament-mm", "1.75"), "1 mm of E is 2.405 µL (bore 1.75 mm: --filament-mm)"),
        (("--syringe", "hamilton_2_5ml"), "bore 7.28 mm"),
        ((), "neither the file nor --syringe"),
    ],
)
def test_the_bore_is_the_users_or_a_default_that_is_named(
    options: tuple[str, ...], words: str, shell: Shell
) -> None:
    Path("part.gcode").write_text(THREE_LAYERS)
    assert words in shell.json("view", "part.gcode", "--no-open", *options)["notes"][0]


def test_a_pneumatic_job_is_shown_with_its_printer(shell: Shell) -> None:
    Path("air.gcode").write_text(PNEUMATIC)
    words = ("view", "air.gcode", "--no-open")
    told = shell.json(*words, "--printer", "pneumatic_marlin", "--flow-ul-s", "0.1")
    assert "0.1 µL/s" in told["notes"][0]
    shell.refuses("--printer", *words)


CASES: tuple[tuple[tuple[str, ...], str], ...] = (
    (("neither", ".gcode"), "view picture.png"),
    (("NUL",), "view fake.gcode"),
    (("empty",), "view empty.gcode"),
    (("line 1", "isn't a command"), "view text.gcode"),
    (("none.gcode", "No such file"), "view none.gcode"),
    (("run folder",), "view folder.gcode"),
    (("3 layers",), "view part.gcode --layer 4"),
    (("--unit", "for a network"), "view part.gcode --unit mm"),
    (("--layer", "for G-code"), "view . --layer 2"),
    (("kind", ";TYPE:", "width"), "view part.gcode --colour kind"),
    (("radius", "width"), "view part.gcode --colour radius"),
    (("--filament-mm", "--syringe"), "view part.gcode --filament-mm 2 --syringe hamilton_1ml"),
    (("plunger",), "view part.gcode --flow-ul-s 1"),
    (("--flow-ul-s",), "view part.gcode --printer pneumatic_marlin --filament-mm 1.75"),
    (("never opened",), "view part.gcode --printer pneumatic_marlin"),
    ((".png",), "view part.gcode --png picture.jpg"),
)


@pytest.mark.parametrize(("words", "command"), CASES, ids=[case[1] for case in CASES])
def test_wrong_input_is_told_in_one_message_and_leaves_nothing(
    words: tuple[str, ...], command: str, tmp_path: Path, shell: Shell
) -> None:
    Path("part.gcode").write_text(THREE_LAYERS)
    Path("text.gcode").write_text("hello\nthere\n")
    Path("empty.gcode").write_text("")
    for name in ("picture.png", "fake.gcode"):
        Path(name).write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")
    Path("folder.gcode").mkdir()
    before = sorted(tmp_path.iterdir())
    shell.refuses(words, *command.split())
    assert sorted(tmp_path.iterdir()) == before


def test_the_models_outline_goes_onto_a_picture_and_a_page(shell: Shell) -> None:
    Path("part.gcode").write_text(THREE_LAYERS)
    write_stl(Path("part.stl"), block_solid((10, 0.2, 0.3)))
    view, model = shell.of("view", "part.gcode"), ("--model", "part.stl", *UNIT)
    assert view("--png", "a.png", *model, "--place", "0,-0.1,0")[0] == 0
    assert view("--no-open", *model, "--place", "0,-0.1,0")[0] == 0
    page = Path("part.view.html").read_text()
    assert page.count('class="outline"') == 3
    assert '"colour":"line"' in page.replace(" ", "")
    for words, said in (
        ((*model, "--place", "0,-0.1,1"), ("layer 2", "--place 0,-0.1,1")),
        (("--place", "0,0,0"), "it is of the --model"),
        ((*model, "--colour", "speed"), "both colour the picture"),
    ):
        view.refuses(said, "--png", "b.png", *words)
    assert not Path("b.png").exists()


# --- `printctl view`, `convert` and `measure`, in an empty directory
HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
FORK = (
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n"
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n"
    "2,1,3,7,7,3,4,7,7,0.39,0.39,artery,0\n"
)


def test_a_network_goes_round_the_formats(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    way = ["a.csv", "b.vtp", "c.json", "d.swc", "e.npz", "f.csv"]
    for source, target in pairwise(way):
        unit = ("--unit", "mm") if source[-3:] in ("csv", "vtp") else ()
        code, out, _ = shell("convert", source, target, *unit)
        assert code == 0
        assert out == f"{target}: 3 vessels, 6 points\n"
    rows = [line.split(",") for line in (tmp_path / "f.csv").read_text().splitlines()[1:]]
    assert sorted(float(row[9]) for row in rows) == pytest.approx([0.39, 0.4, 0.5])
    _, _, err = shell("convert", "a.csv", "paths", "--unit", "mm")
    assert len(list((tmp_path / "paths").glob("*.pth"))) == 2
    assert "no radii" in err


def test_x_cavates_networks_are_read_joined_and_told_of(tmp_path: Path, shell: Shell) -> None:
    trunk = "Vessel: 0, Number of Points: 2\n\n0, 0, 0, 0.1\n4, 0, 0, 0.1\n"
    branch = "Vessel: 1, Number of Points: 2\n1, 0.05, 0, 0.04\n1, 2, 0, 0.04"
    (tmp_path / "a.txt").write_text(trunk + branch)
    (tmp_path / "ends.txt").write_text("inlet\n4, 0, 0\noutlet\n0, 0, 0")
    code, out, err = shell("convert", "a.txt", "b.csv", "--inlet-outlet", "ends.txt")
    assert (code, out) == (0, "b.csv: 3 vessels, 6 points\n")
    assert "0.500 mm at most" in " ".join(err.split())
    rows = [line.split(",") for line in (tmp_path / "b.csv").read_text().splitlines()[1:]]
    assert [float(word) for word in rows[0][3:9]] == [40, 0, 0, 10, 0, 0]
    code, _, err = shell("solid", "a.txt", "--out", "a.stl")
    assert code == 0
    assert "lie: 1, by 0.500" in " ".join(err.split())


NETWORK_CASES: tuple[tuple[int, tuple[str, ...], str], ...] = (
    (2, ("--unit",), "convert a.csv a.vtp"),
    (2, ("a.csv", "another name"), "convert a.csv a.csv --unit mm"),
    (2, (".obj",), "convert a.csv a.obj --unit mm"),
    (2, ("none.csv",), "convert none.csv a.json --unit mm"),
    (1, ("b.csv", "line 3", "NaN"), "convert b.csv b.json --unit mm"),
    (1, ("c.csv", "UTF-8"), "view c.csv --unit mm"),
    (1, ("d.vtp", "not XML"), "measure d.vtp --unit mm --tissue ."),
    (1, ("e.txt", "line 1", "announces 2 points and has 1"), "view e.txt"),
    (1, ("long.txt", "200 mm long", "--unit"), "view long.txt"),
    (2, (".txt", "a.csv"), "convert a.csv a.json --unit mm --inlet-outlet e.txt"),
    (2, ("none.txt",), "convert e.txt a.json --inlet-outlet none.txt"),
    (2, ("run folder",), "view ."),
    (2, ("deviation", "registered scan", "radius"), "view a.csv --unit mm --colour deviation"),
    (2, ("--colour", "colourful"), "view a.csv --unit mm --colour colourful"),
    (2, (".png",), "view a.csv --unit mm --png picture.jpg"),
    (2, ("--tissue",), "measure a.csv --unit mm"),
    (2, ("--tissue-unit",), "measure a.csv --unit mm --tissue t.stl"),
    (1, ("t.stl",), "measure a.csv --unit mm --tissue t.stl --tissue-unit mm"),
    (2, ("t.stl",), "view a.csv --unit mm --tissue t.stl --tissue-unit mm --no-open"),
)


@pytest.mark.parametrize(
    ("code", "words", "command"), NETWORK_CASES, ids=[case[2] for case in NETWORK_CASES]
)
def test_wrong_networks_are_told_in_one_message_and_leave_nothing(
    code: int, words: tuple[str, ...], command: str, tmp_path: Path, shell: Shell
) -> None:
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    (tmp_path / "b.csv").write_text(HEADER + FORK.replace("0.4,0.4", "nan,0.4"))
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "d.vtp").write_text("no xml at all")
    (tmp_path / "e.txt").write_text("Vessel: 0, Number of Points: 2\n0, 0, 0, 0.1")
    (tmp_path / "long.txt").write_text("Vessel: 0, Number of Points: 2\n0, 0, 0, 1\n20, 0, 0, 1")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    shell.refuses(words, *command.split(), code=code)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_page_isnt_opened_where_nobody_sees_it(
    tmp_path: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    assert shell("view", "a.csv", "--unit", "mm")[0] == 0
    assert shell("view", "a.csv", "--unit", "mm", "--no-open")[0] == 0
    assert opened == []
    code, out, err = shell("view", "a.csv", "--unit", "mm", "--open")
    assert code == 0
    assert opened == [(tmp_path / "a.view.html").as_uri()]
    assert out.startswith("a.view.html (")
    assert "0.25 mL/min" in err
