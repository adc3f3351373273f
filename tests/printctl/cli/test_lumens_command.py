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
from tests.printctl.cli.test_slice import FORK, HEADER

E_MEANS = ("--filament-mm", str(BORE_MM))
PLUGGED = 6


@pytest.fixture
def lumens(shell: Shell) -> Shell:
    """In a folder with a tube's G-code, good and plugged, its mesh and its network."""
    walls = tube(0.3, centre=(20, 30))
    plug = [np.array([[19.6, y], [20.4, y]]) for y in 30 + 0.1 * np.arange(-3, 4)]
    Path("good.gcode").write_bytes(gcode([walls] * LAYERS))
    Path("plugged.gcode").write_bytes(
        gcode([[*walls, *(plug if k == PLUGGED else [])] for k in range(LAYERS)])
    )
    write_stl(Path("part.stl"), pipe())
    top = LAYERS * LAYER_MM
    Path("net.csv").write_text(HEADER + f"0,0,1,0,0,0,0,0,{top},0.3,0.3,channel,0\n")
    return shell.of("lumens")


def test_a_good_print_passes_with_a_table(lumens: Shell) -> None:
    code, out, err = lumens("good.gcode", "--model", "part.stl", "--unit", "mm", *E_MEANS)
    assert code == 0, err
    assert "1 lumens among lines of 150 µm in layers of 60 µm" in out
    assert "part's origin at 20.000, 30.000, 0.000 mm" in out
    assert "0 closed, 0 leaking" in out


def test_a_closed_lumen_ends_with_3_and_is_named(lumens: Shell) -> None:
    code, out, err = lumens("plugged.gcode", "--model", "part.stl", "--unit", "mm", *E_MEANS)
    assert code == 3
    assert f"CLOSED lumen 0 in layer {PLUGGED + 1}" in out
    assert "closed: lumen 0 (1 of 1)" in err


def test_json_says_all_of_it_for_a_network(lumens: Shell) -> None:
    given = ("--network", "net.csv", "--unit", "mm", "--place", "20,30,0", *E_MEANS)
    code, out, _ = lumens("plugged.gcode", *given, "--json")
    found = json.loads(out)
    assert code == 3
    assert found["passed"] is False
    (lumen,) = found["lumens"]
    assert lumen["closed_layers"] == lumen["stepped"]["closed_layers"] == [PLUGGED]
    assert lumen["conductance"] == 0
    assert lumen["at_mm"][2] == pytest.approx((PLUGGED + 0.5) * LAYER_MM)
    assert found["summary"]["closed"] == 1


def test_the_model_gives_a_network_its_place(lumens: Shell) -> None:
    command = ("good.gcode", "--network", "net.csv", "--unit", "mm", *E_MEANS)
    told = lumens.json(*command, "--model", "part.stl")
    assert told["place_mm"] == pytest.approx([20, 30, 0], abs=1e-3)
    lumens.refuses("--place", *command)


NETWORKED = ("--network", "net.csv", "--unit", "mm")
MODEL = ("--model", "part.stl", "--unit", "mm")


@pytest.mark.parametrize(
    ("options", "said", "code"),
    [
        (MODEL, "what E means must be said once", 2),
        (("--model", "part.stl", *E_MEANS), "--unit", 2),
        (E_MEANS, "give --network or --model", 2),
        (("--model", "part.stl", "--flow-ul-s", "1", *E_MEANS), "has a plunger", 2),
        ((*MODEL, "--embedded", *E_MEANS), "--network", 2),
        (
            ("--network", "net.csv", "--unit", "mm", "--embedded", "--line-um", "150"),
            "--syringe",
            2,
        ),
    ],
)
def test_what_isnt_said_is_asked_for(
    lumens: Shell, options: tuple[str, ...], said: str, code: int
) -> None:
    lumens.refuses(said, "good.gcode", *options, code=code)


NETWORK = "0,0,1,{x0},10,5,{x1},10,5,0.3,0.3,channel,0\n"


def embedded(tmp_path: Path, gap: float = 0.0) -> None:
    """A vessel of 10 mm, written in two passes with a gap between."""
    ends = [([[10, 10, 5], [15, 10, 5]], 0.6), ([[15 + gap, 10, 5], [20, 10, 5]], 0.6)]
    (tmp_path / "vessel.gcode").write_bytes(plunger_gcode(ends))
    (tmp_path / "vessel.csv").write_text(HEADER + NETWORK.format(x0=0, x1=10))


EMBEDDED = ("vessel.gcode", "--network", "vessel.csv", "--unit", "mm", "--embedded")


def test_an_embedded_print_is_measured_along_its_vessels(lumens: Shell, tmp_path: Path) -> None:
    embedded(tmp_path)
    code, out, err = lumens(*EMBEDDED, *E_MEANS)
    assert code == 0, err
    assert "1 vessels written in 2 passes of filament, median 600 µm" in out
    assert "part's origin at 10.000, 0.000, 0.000 mm" in out
    assert "0 not written through, 0 of 0 joints broken, 0 merging (0 across trees)" in out
    assert "sacrificial" in out


def test_a_vessel_that_isnt_written_through_ends_with_3(lumens: Shell, tmp_path: Path) -> None:
    embedded(tmp_path, gap=1.0)
    code, out, err = lumens(*EMBEDDED, *E_MEANS)
    assert code == 3
    assert "NOT WRITTEN THROUGH vessel 0, at 5." in out
    assert "not written through: vessel 0 (1 of 1)" in err


def test_a_valves_file_is_read_by_its_flow(lumens: Shell, tmp_path: Path) -> None:
    head = firmware_profiles.load(firmware_profiles.Printer, "pneumatic_marlin").pneumatic
    assert head is not None
    passes = [
        (np.hstack([ring, np.full((len(ring), 1), (k + 1) * LAYER_MM)]), 10.0)
        for k in range(LAYERS)
        for ring in tube(0.3, centre=(20, 30))
    ]
    (tmp_path / "air.gcode").write_bytes(valve_gcode(passes, head.opens, head.closes, 0.03))
    command = ("air.gcode", "--model", "part.stl", "--unit", "mm", "--printer", "pneumatic_marlin")
    code, out, err = lumens(*command, "--flow-ul-s", f"{10 * section(LINE_MM):.6g}")
    assert code == 0, err
    assert "1 lumens among lines of 150 µm in layers of 60 µm" in out
    for more, told in (
        ((), "--flow-ul-s"),
        (E_MEANS, "has no plunger"),
        (("--ink", "fibrinogen_fresh"), "--needle"),
    ):
        lumens.refuses(told, *command, *more)


# --- `printctl solid`, in an empty directory
@pytest.fixture
def solid(shell: Shell) -> Shell:
    Path("a.csv").write_text(HEADER + FORK)
    return shell.of("solid", "a.csv", "--unit", "mm", "--out")


@pytest.mark.slow
def test_lumens_and_tubes_in_every_format_of_triangles(tmp_path: Path, solid: Shell) -> None:
    for name in ("l.stl", "l.3mf", "l.ply", "l.obj", "l.vtp"):
        code, out, _ = solid(name, "--fillet-ratio", "0.5")
        assert code == 0
        assert out.startswith(f"{name}: ")
        assert (tmp_path / name).is_file()
    found = solid.json("t.stl", "--wall-mm", "0.2")
    assert (found["genus"], found["crossing_faces"]) == (2, 0)


def test_a_run_folder_s_lumens_have_its_fillets(tmp_path: Path, solid: Shell) -> None:
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
    of_run = solid.of("solid", "run", "--out", "l.stl")
    volumes = [
        of_run.json(*ratio)["volume"]
        for ratio in ((), ("--fillet-ratio", "0.5"), ("--fillet-ratio", "0"))
    ]
    assert volumes[0] == volumes[1] > volumes[2]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a.iges",), "give a file that ends in .step"),
        (("a.step", "--wall-mm", "1"), "STEP has sharp lumens"),
    ],
)
def test_what_cant_be_made_is_wrong_use(
    words: tuple[str, ...], said: str, solid: Shell, tmp_path: Path
) -> None:
    solid.refuses(said, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
