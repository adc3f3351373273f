"""`printctl view FILE.gcode`, in an empty directory."""

import json
from pathlib import Path

import pytest

from design.solids import block_solid, write_stl

from .test_network_commands import Shell, shell  # noqa: F401

LAYERS = """G21
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


def test_a_page_stands_beside_the_file(tmp_path: Path, shell: Shell) -> None:  # noqa: F811
    (tmp_path / "part.gcode").write_text(LAYERS)
    code, out, err = shell("view", "part.gcode", "--no-open")
    assert code == 0
    assert out.startswith("part.view.html (")
    assert "4.61 mm" in err
    assert "Hamilton" in err
    text = (tmp_path / "part.view.html").read_text(encoding="utf-8")
    assert '"first":{"layer":1,' in text


@pytest.mark.parametrize("to", ["--out=a.html", "--png=a.png"])
def test_one_level_behind_a_line_that_cant_be_read_is_shown(
    tmp_path: Path,
    shell: Shell,  # noqa: F811
    to: str,
) -> None:
    text = 'G21\nG90\nM82\nM862.3 P "MK3S"\nG1 Z0.3 F120\nG1 X10 Y10 F600\nG1 X30 E1 F300\n'
    (tmp_path / "part.gcode").write_text(text)
    code, out, _ = shell("view", "part.gcode", "--no-open", to, "--json")
    assert code == 0
    assert "line 4: 'M862.3 P" in json.loads(out)["notes"][0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--filament-mm", "1.75"), "1 mm of E is 2.405 µL (bore 1.75 mm: --filament-mm)"),
        (("--syringe", "hamilton_2_5ml"), "bore 7.28 mm"),
        ((), "neither the file nor --syringe"),
    ],
)
def test_the_bore_is_the_users_or_a_default_that_is_named(
    options: tuple[str, ...],
    words: str,
    tmp_path: Path,
    shell: Shell,  # noqa: F811
) -> None:
    (tmp_path / "part.gcode").write_text(LAYERS)
    code, out, _ = shell("view", "part.gcode", "--no-open", "--json", *options)
    assert code == 0
    assert words in json.loads(out)["notes"][0]


def test_a_pneumatic_job_is_shown_with_its_printer(tmp_path: Path, shell: Shell) -> None:  # noqa: F811
    (tmp_path / "air.gcode").write_text(PNEUMATIC)
    command = ("view", "air.gcode", "--no-open", "--printer", "pneumatic_marlin", "--json")
    code, out, _ = shell(*command, "--flow-ul-s", "0.1")
    assert code == 0
    assert "0.1 µL/s" in json.loads(out)["notes"][0]
    code, _, err = shell("view", "air.gcode", "--no-open")
    assert code == 2
    assert "--printer" in err


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
    words: tuple[str, ...],
    command: str,
    tmp_path: Path,
    shell: Shell,  # noqa: F811
) -> None:
    (tmp_path / "part.gcode").write_text(LAYERS)
    (tmp_path / "text.gcode").write_text("hello\nthere\n")
    (tmp_path / "empty.gcode").write_text("")
    for name in ("picture.png", "fake.gcode"):
        (tmp_path / name).write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")
    (tmp_path / "folder.gcode").mkdir()
    before = sorted(tmp_path.iterdir())
    ended, out, err = shell(*command.split())
    assert ended == 2
    assert out == ""
    for word in words:
        assert word in err
    assert sorted(tmp_path.iterdir()) == before


def test_the_models_outline_goes_onto_a_picture_and_a_page(tmp_path: Path, shell: Shell) -> None:  # noqa: F811
    (tmp_path / "part.gcode").write_text(LAYERS)
    write_stl(tmp_path / "part.stl", block_solid((10, 0.2, 0.3)))
    model = ("--model", "part.stl", "--unit", "mm")
    code, _, _ = shell("view", "part.gcode", "--png", "a.png", *model, "--place", "0,-0.1,0")
    assert code == 0
    code, _, err = shell("view", "part.gcode", "--png", "b.png", *model, "--place", "0,-0.1,1")
    assert code == 2
    assert "layer 2" in err
    assert "--place 0,-0.1,1" in err
    code, _, _ = shell("view", "part.gcode", "--no-open", *model, "--place", "0,-0.1,0")
    assert code == 0
    page = (tmp_path / "part.view.html").read_text()
    assert page.count('class="outline"') == 3
    assert '"colour":"line"' in page.replace(" ", "")
    for words, said in (
        (("--png", "b.png", "--place", "0,0,0"), "it is of the --model"),
        (("--png", "b.png", *model, "--colour", "speed"), "both colour the picture"),
    ):
        code, _, err = shell("view", "part.gcode", *words)
        assert code == 2
        assert said in " ".join(err.split())
    assert not (tmp_path / "b.png").exists()
