"""Wrong command-line input: one message, the right exit code, no traceback."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from design.solids import block_solid, write_stl
from printctl.cli.main import main


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("pause nothing", 1, "no print was started in nothing"),
        ("pause . --now --after layer", 2, "exclude each other"),
        ("resume .", 1, "no print was started in ."),
        ("status .", 1, "no print was started in ."),
        ("recover nothing", 1, "no print was started in nothing"),
        ("recover .", 1, "no print was started in ."),
        ("history rebuild nowhere", 2, "nowhere is no folder"),
        ("calibrate weigh none.csv", 2, "can't be read: No such file"),
        ("calibrate weigh bin.yaml", 2, "isn't a text file"),
        ("calibrate weigh bad.csv", 2, "line 2: mass_mg is 'abc'"),
        ("profiles check bin.yaml", 2, "isn't YAML"),
        ("profiles check foreign.yaml", 2, "no key of any sort of profile"),
        ("profiles check list.yaml", 2, "holds no keys"),
        ("profiles check needle.yaml", 2, "needle.yaml: name is missing"),
        ("profiles check bad.csv", 2, "ends in .yaml"),
        ("slice nothing.stl --unit mm --out a.gcode", 1, "No such file"),
        ("slice cube.stl --out a.gcode", 1, "doesn't say its unit"),
        ("slice cube.stl --unit mm --out .", 2, "is a folder"),
        ("slice cube.stl --unit m --out a.gcode", 2, "2000 mm long in x, more than the 200 mm"),
        ("slice cube.stl --unit um --out a.gcode", 1, "check the part's unit"),
        ("slice bin.yaml --unit mm --out a.gcode", 1, ".yaml isn't one of .stl"),
        ("slice cube.stl --unit mm --out a.gcode --infill gyroid", 1, "meet above 0.7"),
        ("simulate /dev/zero --printer generic_marlin", 2, "it is a device and no regular file"),
        ("simulate . --printer generic_marlin", 2, "it is a folder and no regular file"),
        ("simulate pipe.gcode --printer generic_marlin", 2, "it is a pipe and no regular file"),
        ("lumens pipe.gcode --printer generic_marlin --line-um 400", 2, "it is a pipe and no"),
        ("view pipe.gcode --printer generic_marlin", 2, "it is a pipe and no regular file"),
        ("print pipe.gcode --printer generic_marlin --port simulated", 2, "it is a pipe and no"),
        ("simulate nul.gcode --printer generic_marlin", 2, "line 2 of the G-code has a NUL"),
        (
            "print nul.gcode --printer generic_marlin --port simulated",
            2,
            "line 2 of the G-code has",
        ),
        ("view nul.gcode --printer generic_marlin", 2, "line 2 of the G-code has a NUL"),
        ("run r.yaml --out cube.stl", 2, "--out cube.stl: cube.stl is a file; give a folder's"),
        ("simulate a.gcode --out cube.stl/x", 2, "--out cube.stl/x: cube.stl is a file"),
        ("slice cube.stl --unit mm --out cube.stl/a.gcode", 2, "is a file, or lies in one"),
        ("slice cube.stl --unit mm --unit um --out a.gcode", 2, "--unit is given twice, and"),
        ("calibrate weigh bad.csv --write a --write a --write b", 2, "--write is given 3 times"),
        ("ports --printer nope", 2, "no printer profile 'nope'"),
    ],
)
def test_one_message_and_the_right_exit_code(
    words: str,
    code: int,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "bin.yaml").write_bytes(bytes(range(128, 256)))
    (tmp_path / "nul.gcode").write_bytes(b"G1 X1\nG1 X\0 Y2\n")
    (tmp_path / "foreign.yaml").write_text("foo: 1\n")
    (tmp_path / "list.yaml").write_text("- 1\n")
    (tmp_path / "needle.yaml").write_text("inner_mm: 0.2\nouter_mm: 0.4\n")
    (tmp_path / "bad.csv").write_text("travel_mm,mass_mg\n1,abc\n")
    write_stl(tmp_path / "cube.stl", block_solid(np.full(3, 2.0)))
    os.mkfifo(tmp_path / "pipe.gcode")
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path.with_name(tmp_path.name + "_data")))
    monkeypatch.setattr(sys, "argv", ["printctl", *words.split()])
    with pytest.raises(SystemExit) as left:
        main()
    told = capsys.readouterr()
    assert left.value.code == code
    assert message in told.err
    assert told.err.count("printctl:") == 1
    assert told.out == ""
    assert sorted(tmp_path.iterdir()) == before
