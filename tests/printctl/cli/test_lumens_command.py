"""`printctl lumens` by the command line's own entry."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import firmware_profiles
from design.solids import write_stl
from tests.printctl.cli.shell import Shell
from tests.printctl.lumens.small_gcode import BORE_MM, LAYER_MM, gcode, tube
from tests.printctl.lumens.test_model import LAYERS, pipe

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
    assert f"CLOSED lumen 0 in layer {PLUGGED}" in out
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


def test_a_wrong_place_is_doubted(shell: Shell) -> None:
    code, _, err = shell(
        "good.gcode", "--network", "net.csv", "--unit", "mm", "--place", "20.6,30,0", *E_MEANS
    )
    assert code == 3
    assert "does the part stand where --place says" in err


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


def test_an_inks_flow_factor_scales_the_lines(shell: Shell, tmp_path: Path) -> None:
    profile = Path(firmware_profiles.__file__).parent / "data" / "inks" / "collagen_fresh.yaml"
    (tmp_path / "thin.yaml").write_text(f"{profile.read_text()}\nflow_factor: 0.8\n")
    command = ("good.gcode", "--model", "part.stl", "--unit", "mm", "--place", "20,30,0", "--json")
    _, out, err = shell(*command, *E_MEANS, "--ink", "thin.yaml")
    assert json.loads(out)["line_um"] == pytest.approx(120, abs=0.1), err
