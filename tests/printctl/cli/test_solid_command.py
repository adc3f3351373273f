"""`printctl solid`, in an empty directory."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.printctl.cli.shell import Shell
from tests.printctl.cli.test_network_commands import FORK, HEADER


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    return Shell(monkeypatch, capsys, "solid", "a.csv", "--unit", "mm", "--out")


@pytest.mark.slow
def test_lumens_and_tubes_in_every_format_of_triangles(tmp_path: Path, shell: Shell) -> None:
    for name in ("l.stl", "l.3mf", "l.ply", "l.obj", "l.vtp"):
        code, out, _ = shell(name, "--fillet-ratio", "0.5")
        assert code == 0
        assert out.startswith(f"{name}: ")
        assert (tmp_path / name).is_file()
    code, out, _ = shell("t.stl", "--wall-mm", "0.2", "--json")
    found = json.loads(out)
    assert (code, found["genus"], found["crossing_faces"]) == (0, 2, 0)


def test_a_run_folder_s_lumens_have_its_fillets(tmp_path: Path, shell: Shell) -> None:
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
    of_run = Shell(shell.monkeypatch, shell.capsys, "solid", "run", "--out")
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
    words: tuple[str, ...], said: str, shell: Shell, tmp_path: Path
) -> None:
    code, _, err = shell(*words)
    assert code == 2
    assert said in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
