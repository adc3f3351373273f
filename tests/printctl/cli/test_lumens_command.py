"""`printctl lumens`: the command on G-code files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import firmware_profiles
from design.solids import write_stl
from tests.printctl.checks.lumens.small_gcode import (
    BORE_MM,
    LAYER_MM,
    LINE_MM,
    gcode,
    plunger_gcode,
    section,
    tube,
    valve_gcode,
)
from tests.printctl.checks.lumens.test_openings import LAYERS_MODEL as LAYERS
from tests.printctl.checks.lumens.test_openings import pipe
from tests.printctl.cli.shell import Shell
from tests.printctl.cli.test_slice import FORK
from tests.printctl.cli.test_slice import HEADER as HEADER_SOLID_COMMAND

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
E_MEANS = ("--filament-mm", str(BORE_MM))
PLUGGED = 6


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    """In a folder with a tube's G-code, good and plugged, its mesh and its network."""
    monkeypatch.chdir(tmp_path)
    walls = tube(0.3, centre=(20, 30))
    plug = [np.array([[19.6, y], [20.4, y]]) for y in 30 + 0.1 * np.arange(-3, 4)]
    (tmp_path / "good.gcode").write_bytes(gcode([walls] * LAYERS))
    (tmp_path / "plugged.gcode").write_bytes(
        gcode([[*walls, *(plug if k == PLUGGED else [])] for k in range(LAYERS)])
    )
    write_stl(tmp_path / "part.stl", pipe())
    top = LAYERS * LAYER_MM
    (tmp_path / "net.csv").write_text(HEADER + f"0,0,1,0,0,0,0,0,{top},0.3,0.3,channel,0\n")
    return Shell(monkeypatch, capsys, "lumens")


def test_a_good_print_passes_with_a_table(shell: Shell) -> None:
    code, out, err = shell("good.gcode", "--model", "part.stl", "--unit", "mm", *E_MEANS)
    assert code == 0, err
    assert "1 lumens among lines of 150 µm in layers of 60 µm" in out
    assert "part's origin at 20.000, 30.000, 0.000 mm" in out
    assert "0 closed, 0 leaking" in out


def test_a_closed_lumen_ends_with_3_and_is_named(shell: Shell) -> None:
    code, out, err = shell("plugged.gcode", "--model", "part.stl", "--unit", "mm", *E_MEANS)
    assert code == 3
    assert f"CLOSED lumen 0 in layer {PLUGGED + 1}" in out
    assert "closed: lumen 0 (1 of 1)" in err


def test_json_says_all_of_it_for_a_network(shell: Shell) -> None:
    code, out, _ = shell(
        "plugged.gcode", "--network", "net.csv", "--unit", "mm", "--place", "20,30,0", "--json",
        *E_MEANS,
    )  # fmt: skip
    found = json.loads(out)
    assert code == 3
    assert found["passed"] is False
    (lumen,) = found["lumens"]
    assert lumen["closed_layers"] == lumen["stepped"]["closed_layers"] == [PLUGGED]
    assert lumen["conductance"] == 0
    assert lumen["at_mm"][2] == pytest.approx((PLUGGED + 0.5) * LAYER_MM)
    assert found["summary"]["closed"] == 1


def test_the_model_gives_a_network_its_place(shell: Shell) -> None:
    command = ("good.gcode", "--network", "net.csv", "--unit", "mm", "--json", *E_MEANS)
    code, out, err = shell(*command, "--model", "part.stl")
    assert code == 0, err
    assert json.loads(out)["place_mm"] == pytest.approx([20, 30, 0], abs=1e-3)
    code, _, err = shell(*command)
    assert code == 2
    assert "--place" in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--model", "part.stl", "--unit", "mm"), "what E means must be said once"),
        (("--model", "part.stl", *E_MEANS), "unit"),
        (E_MEANS, "give --network or --model"),
    ],
)
def test_what_isnt_said_is_asked_for(shell: Shell, options: tuple[str, ...], said: str) -> None:
    code, _, err = shell("good.gcode", *options)
    assert code in (1, 2)
    assert said in err


NETWORK = "0,0,1,{x0},10,5,{x1},10,5,0.3,0.3,channel,0\n"


def embedded(tmp_path: Path, gap: float = 0.0) -> None:
    """A vessel of 10 mm, written in two passes with a gap between."""
    ends = [([[10, 10, 5], [15, 10, 5]], 0.6), ([[15 + gap, 10, 5], [20, 10, 5]], 0.6)]
    (tmp_path / "vessel.gcode").write_bytes(plunger_gcode(ends))
    (tmp_path / "vessel.csv").write_text(HEADER + NETWORK.format(x0=0, x1=10))


EMBEDDED = ("vessel.gcode", "--network", "vessel.csv", "--unit", "mm", "--embedded")


def test_an_embedded_print_is_measured_along_its_vessels(shell: Shell, tmp_path: Path) -> None:
    embedded(tmp_path)
    code, out, err = shell(*EMBEDDED, *E_MEANS)
    assert code == 0, err
    assert "1 vessels written in 2 passes of filament, median 600 µm" in out
    assert "part's origin at 10.000, 0.000, 0.000 mm" in out
    assert "0 not written through, 0 of 0 joints broken, 0 merging (0 across trees)" in out
    assert "sacrificial" in out


def test_a_vessel_that_isnt_written_through_ends_with_3(shell: Shell, tmp_path: Path) -> None:
    embedded(tmp_path, gap=1.0)
    code, out, err = shell(*EMBEDDED, *E_MEANS)
    assert code == 3
    assert "NOT WRITTEN THROUGH vessel 0, at 5." in out
    assert "not written through: vessel 0 (1 of 1)" in err


def test_what_says_nothing_of_filaments_is_asked_for(shell: Shell, tmp_path: Path) -> None:
    embedded(tmp_path)
    for more, told in (
        (("--model", "part.stl", *E_MEANS), "--network"),
        (("--network", "vessel.csv", "--line-um", "150"), "--syringe"),
    ):
        code, _, err = shell("vessel.gcode", "--unit", "mm", "--embedded", *more)
        assert code == 2
        assert told in err


def test_a_valves_file_is_read_by_its_flow(shell: Shell, tmp_path: Path) -> None:
    head = firmware_profiles.load(firmware_profiles.Printer, "pneumatic_marlin").pneumatic
    assert head is not None
    passes = [
        (np.hstack([ring, np.full((len(ring), 1), (k + 1) * LAYER_MM)]), 10.0)
        for k in range(LAYERS)
        for ring in tube(0.3, centre=(20, 30))
    ]
    (tmp_path / "air.gcode").write_bytes(valve_gcode(passes, head.opens, head.closes, 0.03))
    command = ("air.gcode", "--model", "part.stl", "--unit", "mm", "--printer", "pneumatic_marlin")
    code, out, err = shell(*command, "--flow-ul-s", f"{10 * section(LINE_MM):.6g}")
    assert code == 0, err
    assert "1 lumens among lines of 150 µm in layers of 60 µm" in out
    for more, told in (
        ((), "--flow-ul-s"),
        (E_MEANS, "has no plunger"),
        (("--ink", "fibrinogen_fresh"), "--needle"),
    ):
        code, _, err = shell(*command, *more)
        assert code == 2
        assert told in err
    code, _, err = shell("good.gcode", "--model", "part.stl", "--flow-ul-s", "1", *E_MEANS)
    assert code == 2
    assert "has a plunger" in err


# --- `printctl solid`, in an empty directory
@pytest.fixture
def shell_solid_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(HEADER_SOLID_COMMAND + FORK)
    return Shell(monkeypatch, capsys, "solid", "a.csv", "--unit", "mm", "--out")


@pytest.mark.slow
def test_lumens_and_tubes_in_every_format_of_triangles(
    tmp_path: Path, shell_solid_command: Shell
) -> None:
    for name in ("l.stl", "l.3mf", "l.ply", "l.obj", "l.vtp"):
        code, out, _ = shell_solid_command(name, "--fillet-ratio", "0.5")
        assert code == 0
        assert out.startswith(f"{name}: ")
        assert (tmp_path / name).is_file()
    code, out, _ = shell_solid_command("t.stl", "--wall-mm", "0.2", "--json")
    found = json.loads(out)
    assert (code, found["genus"], found["crossing_faces"]) == (0, 2, 0)


def test_a_run_folder_s_lumens_have_its_fillets(tmp_path: Path, shell_solid_command: Shell) -> None:
    """A run folder was refused as a broken network's file."""
    (tmp_path / "run").mkdir()
    (tmp_path / "a.csv").rename(tmp_path / "run" / "network.csv")
    recipe = {
        "schema": 1,
        "name": "fork",
        "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
        "vasculature": {"design": "planar_four_vessel"},
        "solid": {"fillet_ratio": 0.5},
    }
    facts = {"schema": 1, "facts": {"recipe": recipe}, "stages": {}}
    (tmp_path / "run" / "manifest.json").write_text(json.dumps(facts))
    of_run = Shell(
        shell_solid_command.monkeypatch, shell_solid_command.capsys, "solid", "run", "--out"
    )
    volumes = []
    for ratio in ((), ("--fillet-ratio", "0.5"), ("--fillet-ratio", "0")):
        code, out, err = of_run("l.stl", "--json", *ratio)
        assert code == 0, err
        volumes.append(json.loads(out)["volume"])
    assert volumes[0] == volumes[1] > volumes[2]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a.iges",), "give a file that ends in .step"),
        (("a.step", "--wall-mm", "1"), "STEP has sharp lumens"),
    ],
)
def test_what_cant_be_made_is_wrong_use(
    words: tuple[str, ...], said: str, shell_solid_command: Shell, tmp_path: Path
) -> None:
    code, _, err = shell_solid_command(*words)
    assert code == 2
    assert said in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
