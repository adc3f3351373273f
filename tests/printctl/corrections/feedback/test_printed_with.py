"""Compensation file from a run, applied to the next run's G-code."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from design.errors import ToolpathError
from printctl.corrections.feedback.evidence import read_print
from printctl.errors import SafetyError, UsageError
from printctl.run_folder.artefacts import NUMBERS
from printctl.run_folder.manifest import Manifest
from tests.printctl.cli.shell import Shell
from tests.printctl.corrections.feedback.lab import TWO, Lab, recipe_of, registered, run, small_run


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a registered run, `plain`, of a printer whose parts shrink and close in."""
    folder = small_run(tmp_path_factory)
    registered(folder / "plain", Lab(network=TWO, spread_mm=-0.05))
    return folder


@pytest.fixture
def shell(
    first: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(first)
    return Shell(monkeypatch, capsys, "compensate")


@pytest.fixture(scope="module")
def made(first: Path) -> dict[str, Any]:
    """A compensation of that design that changes nothing; tests change it."""
    design = read_print(first / "plain")
    return {
        "printctl_compensation": 1,
        "design": design.design.model_dump(mode="json"),
        "made_with": design.made_with.model_dump(mode="json"),
        "simulated": True,
        "prints": [design.facts.model_dump(mode="json")],
        "stretch": {"about_mm": [3.0, 2.0, 0.0]},
    }


def gcode(folder: Path, name: str) -> bytes:
    return (folder / name / "part.gcode").read_bytes()


def corners(data: bytes) -> np.ndarray:
    """Lowest and highest place of moves that write, x and y, mm."""
    at, found = {"X": np.nan, "Y": np.nan}, []
    for line in data.decode().splitlines():
        words = line.split(";")[0].split()
        if words and words[0] in ("G0", "G1"):
            moved = {word[0]: float(word[1:]) for word in words[1:] if word[0] in "XY"}
            at |= moved
            if moved and any(word[0] == "E" for word in words):
                found.append((at["X"], at["Y"]))
    return np.array([np.nanmin(found, axis=0), np.nanmax(found, axis=0)])


def printed(folder: Path, name: str, made: dict[str, Any], **changes: Any) -> dict[str, Any]:
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(made))
    data = recipe_of(**changes)
    data["toolpath"]["compensation"] = f"{name}.yaml"
    return run(folder, name, data)


@pytest.mark.slow
def test_a_compensation_that_changes_nothing_gives_the_same_bytes(
    first: Path, made: dict[str, Any]
) -> None:
    printed(first, "neutral", made)
    assert gcode(first, "neutral") == gcode(first, "plain")


def test_from_a_run_to_the_next_ones_gcode(first: Path, shell: Shell) -> None:
    code, out, err = shell("plain", "--out", "made.json", "--diameter-bias-um", "0,2")
    assert code == 0, err
    assert "x × 1.02" in out
    assert "no depth standard" in err
    factor = json.loads((first / "made.json").read_text())["stretch"]["factor"]
    assert factor[2] == 1
    np.testing.assert_allclose(np.array(factor[:2]) * 0.975, 1, atol=5e-3)
    data = recipe_of()
    data["toolpath"]["compensation"] = "made.json"
    found = run(first, "next", data)
    before, after = (np.ptp(corners(gcode(first, name)), axis=0) for name in ("plain", "next"))
    # A line's half width lies inside each face, whatever the part's size.
    np.testing.assert_allclose(after + 0.15, (before + 0.15) * factor[:2], atol=0.01)
    assert found["toolpath"]["compensation"].startswith("made.json: x × 1.02")
    # Half of 50 um; and what depth, which isn't corrected, takes of 0.7 mm: half of 1.25 %.
    offset = found["toolpath"]["corrections"]["radial"]["offset_um"]
    assert offset == pytest.approx(25 + 4.4, abs=1.5)
    # Lumens are held against what is to be written: 0.65 times the stretch, not 0.6.
    lumen = next(row for row in found["lumens"]["lumens"] if row["lumen"] == "0")
    assert lumen["designed_mm"] > 0.64
    manifest = Manifest.load(first / "next")
    assert "compensation.json" in manifest.stages["toolpath"].outputs
    # A print made with it is the base of what comes next.
    registered(first / "next", Lab(network=TWO, shrink=(1 / factor[0], 1 / factor[1], 0.975)))
    assert read_print(first / "next").base.stretch.factor == tuple(factor)


@pytest.mark.slow
def test_another_files_content_makes_the_toolpath_again(first: Path, made: dict[str, Any]) -> None:
    printed(first, "again", made)
    key = Manifest.load(first / "again").stages["toolpath"].key
    made = made | {"stretch": made["stretch"] | {"factor": [1.02, 1.0, 1.0]}}
    printed(first, "again", made)
    assert Manifest.load(first / "again").stages["toolpath"].key != key
    assert np.ptp(corners(gcode(first, "again")), axis=0)[0] > 5.95
    bytes_before = gcode(first, "again")
    shutil.rmtree(first / "again")
    printed(first, "again", made)
    assert gcode(first, "again") == bytes_before


@pytest.mark.slow
def test_embedded_vessels_are_moved_and_widened(first: Path) -> None:
    run(first, "filaments", recipe_of("embedded"))
    registered(first / "filaments", Lab(network=TWO))
    origin = read_print(first / "filaments")
    made = {
        "printctl_compensation": 1,
        "design": origin.design.model_dump(mode="json"),
        "made_with": origin.made_with.model_dump(mode="json"),
        "simulated": True,
        "prints": [origin.facts.model_dump(mode="json")],
        "stretch": {"about_mm": [3.0, 2.0, 0.0], "factor": [1.05, 1.0, 1.0]},
        "vessels": [{"vessel": 1, "diameter_um": 80.0}],
    }
    found = printed(first, "wider", made, method="embedded")
    before = json.loads((first / "filaments" / "manifest.json").read_text())
    was = before["stages"]["toolpath"]["summary"]["plan"]["design_ul"]
    # Along x: as much longer; radii as the other axes, and vessel 1 from 0.8 to 0.88 mm.
    more = 1.05 * (0.6**2 + 0.88**2) / (0.6**2 + 0.8**2)
    assert found["toolpath"]["plan"]["design_ul"] / was == pytest.approx(more, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"design": {"network_sha256": "0" * 64}}, UsageError, "another design: its network"),
        ({"design": {"bounds_mm": [[0, 0, 0], [6, 4, 3]]}}, UsageError, "differ .* 1000 um"),
        ({"made_with": {"method": "embedded"}}, UsageError, "measured on prints by embedded"),
        ({"stretch": {"factor": [1.2, 1, 1]}}, ToolpathError, "1.200 times as long along x"),
        ({"nodes": [{"node": 9, "offset_um": [0, 5, 0]}]}, ToolpathError, "node 9"),
        ({"schema": 3}, UsageError, "schema: is no key here"),
        ({"stretch": {"factor": [1, 1]}}, UsageError, "stretch.factor"),
    ],
)
def test_what_does_not_fit_is_refused(
    first: Path, made: dict[str, Any], changes: dict[str, Any], error: type[Exception], says: str
) -> None:
    bad = dict(made)
    for key, value in changes.items():
        bad[key] = made[key] | value if isinstance(value, dict) else value
    with pytest.raises(error, match=says):
        printed(first, "bad", bad)


def with_thin_wall(made: dict[str, Any]) -> dict[str, Any]:
    """0.45 mm between 0.6 and 1.0 mm: each 0.12 wider and 0.12 nearer."""
    offsets = [(0, 140), (1, 140), (2, -140), (3, -140)]
    return made | {
        "nodes": [{"node": node, "offset_um": [0, um, 0]} for node, um in offsets],
        "radial": {"offset_um": 60.0},
    }


def test_a_wall_of_less_than_a_line_is_refused(first: Path, made: dict[str, Any]) -> None:
    bad = with_thin_wall(made)
    with pytest.raises(ToolpathError, match="um of wall between them"):
        printed(first, "near", bad, line_um=320)


def test_a_simulated_scans_compensation_is_not_printed_for_real(
    first: Path, made: dict[str, Any]
) -> None:
    (first / "sim.yaml").write_text(yaml.safe_dump(made))
    data = recipe_of(compensation="sim.yaml")
    data["printer"]["port"] = "/dev/ttyACM0"
    data["scan"] = {"file": "later.tif"}
    with pytest.raises(SafetyError, match="simulated scan"):
        run(first, "real", data)


@pytest.mark.slow
def test_a_print_with_the_recipes_own_numbers_is_composed_with(first: Path) -> None:
    own = {"shrink_percent": [2.0, 1.0, 0.0], "radial_um": 12.0}
    run(first, "own", recipe_of(compensate=own))
    registered(first / "own", Lab(network=TWO))
    base = read_print(first / "own").base
    np.testing.assert_allclose(base.stretch.factor, [1 / 0.98, 1 / 0.99, 1])
    assert base.radial_mm == pytest.approx(0.012)


@pytest.mark.parametrize(
    ("said", "code", "says"),
    [
        (["nowhere", "--out", "a.yaml"], 2, "isn't a folder"),
        (["plain", "--out", "a.txt"], 2, ".yaml or .json"),
        (["plain", "--out", "a.yaml", "--gain", "1.5"], 2, "at most 1"),
        (["plain", "--out", "a.yaml", "--diameter-bias-um", "12"], 2, "BIAS,INTERVAL"),
        (["plain", "--out", "a.yaml", "--depth-standard", " "], 2, "is empty"),
        (["plain", "--out", "a.yaml", "--without-vessel", "7"], 2, "vessels 0 to 1"),
        (["plain", "plain", "--out", "a.yaml"], 2, "counts once"),
        (["bare", "--out", "a.yaml"], 2, "has no registration.json"),
        ([".", "--out", "a.yaml"], 2, "has no registration.json"),
    ],
)
def test_wrong_use_ends_in_a_message(
    first: Path, shell: Shell, said: list[str], code: int, says: str
) -> None:
    if said[0] == "bare" and not (first / "bare").exists():
        shutil.copytree(first / "plain", first / "bare")
        (first / "bare" / NUMBERS).unlink()
    found, _, err = shell(*said)
    assert found == code
    assert says in err
    assert "Traceback" not in err
    assert not (first / "a.yaml").exists()


def test_an_ambiguous_pose_and_a_changed_file_are_refused(first: Path, shell: Shell) -> None:
    shutil.copytree(first / "plain", first / "doubtful")
    path = first / "doubtful" / NUMBERS
    numbers = json.loads(path.read_text())
    path.write_text(json.dumps(numbers | {"ambiguity": {"flag": True, "margin": 1.1}}))
    code, _, err = shell("doubtful", "--out", "a.yaml")
    assert (code, "isn't as the run wrote it" in err) == (2, True)
    manifest = Manifest.load(first / "doubtful")
    del manifest.stages["registration"].outputs[NUMBERS]
    manifest.save()
    code, _, err = shell("doubtful", "--out", "a.yaml")
    assert (code, "pose is ambiguous (margin 1.10)" in err) == (1, True)
